"""What a trajectory may ask for."""

from typing import Any

import numpy as np
import pytest
from harness import Drive, reference, straight

from vehicle_iface import Trajectory
from vehicle_iface.safety.feasible import refusal
from vehicle_iface.trajectories.source import FixedTrajectory

LIMITS = reference().profile.limits


def path(**columns: Any) -> Trajectory:
    given: dict[str, Any] = {
        "time_from_start_ns": np.arange(4) * 10**9,
        "x_m": np.arange(4.0),
        "y_m": np.zeros(4),
        "heading_rad": np.zeros(4),
        "speed_mps": np.ones(4),
    }
    return Trajectory(stamp_ns=0, **given | columns)


@pytest.mark.parametrize("sign", [-1, 1])
def test_at_the_limits_it_may_be_followed_and_beyond_them_the_point_is_named(sign: int) -> None:
    at = np.array([0.0, 0.0, sign * 20.0, 0.0])
    assert refusal(path(speed_mps=at), LIMITS) == ""
    assert refusal(path(speed_mps=at * 1.001), LIMITS) == f"speed_mps[2] = {sign * 20.02}: must be in [-20.0, 20.0]"
    angle = np.array([0.0, sign * 0.6, 0.0, 0.0])
    assert refusal(path(front_wheel_angle_rad=angle), LIMITS) == ""
    assert refusal(path(front_wheel_angle_rad=angle * 1.01), LIMITS).startswith("front_wheel_angle_rad[1] = ")


def test_an_empty_one_may_be_followed_and_a_million_points_may() -> None:
    assert refusal(Trajectory.empty(stamp_ns=0), LIMITS) == ""
    assert refusal(straight(length_m=1e6), LIMITS) == ""


def test_a_loop_does_not_take_one_that_is_too_fast_and_says_so() -> None:
    drive = Drive(FixedTrajectory(straight(speed_mps=25.0)))
    drive.run_s(1.0)
    assert drive.controller.trajectory is None
    assert drive.loop.details()["loop"]["trajectories_rejected"] >= 1


def test_a_billionth_beyond_a_limit_is_rounding_and_more_is_not() -> None:
    assert refusal(path(speed_mps=np.full(4, 20.0 * (1.0 + 1e-9))), LIMITS) == ""
    assert refusal(path(speed_mps=np.full(4, 20.0 * (1.0 + 1.2e-9))), LIMITS).startswith("speed_mps[0] = ")
