"""A fixed trajectory as a source."""

import numpy as np

from vehicle_iface.state import VehicleState
from vehicle_iface.trajectories import FixedTrajectory, TrajectorySource, make_route
from vehicle_iface.trajectory import Trajectory

STATE = VehicleState(stamp_ns=0, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0)


def test_a_fixed_trajectory_is_given_once_stamped_at_the_first_call() -> None:
    trajectory = make_route("line").to_trajectory(stamp_ns=5)
    source: TrajectorySource = FixedTrajectory(trajectory)
    given = source.next(1_000, STATE)
    assert given is not None
    assert given.stamp_ns == 1_000
    assert source.next(2_000, STATE) is None
    assert trajectory.stamp_ns == 5


def test_a_restarted_source_gives_it_again_with_the_new_instant() -> None:
    source = FixedTrajectory(make_route("line").to_trajectory())
    source.next(1_000, STATE)
    source.restart()
    given = source.next(3_000, STATE)
    assert given is not None
    assert given.stamp_ns == 3_000


def test_restamping_a_trajectory_shares_its_locked_arrays() -> None:
    trajectory = make_route("line").to_trajectory()
    given = FixedTrajectory(trajectory).next(9, STATE)
    assert isinstance(given, Trajectory)
    assert np.shares_memory(given.x_m, trajectory.x_m)
    assert not given.x_m.flags.writeable
