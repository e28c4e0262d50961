"""Which trajectories reach the controller while the vehicle drives."""

from dataclasses import replace

import numpy as np
import pytest

from tests.harness import pure_pursuit, reference, straight
from vehicle_iface import Trajectory, VehicleState
from vehicle_iface.runtime import trajectory_updates
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.trajectory_updates import TrajectoryUpdater
from vehicle_iface.trajectories import RecedingRoute, drop_backward_steps, make_route
from vehicle_iface.trajectories.cleaning import find_backward_step
from vehicle_iface.trajectories.mailbox import Mailbox
from vehicle_iface.trajectories.source import TrajectorySource

STATE = VehicleState(stamp_ns=0, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0)


class Desk:
    """An updater with its mailbox."""

    def __init__(self, source: TrajectorySource | None = None) -> None:
        self.mailbox, self.controller, self.counts = Mailbox(), pure_pursuit(), Counters()
        profile = reference().profile
        self.updater = TrajectoryUpdater(
            source or self.mailbox,
            self.controller,
            self.counts,
            limits=profile.limits,
            wheelbase_m=profile.geometry.wheelbase_m,
        )

    def takes(self, trajectory: Trajectory) -> bool:
        self.mailbox.put(trajectory)
        return self.updater.poll(0, STATE, restart=False)


def test_a_trajectory_that_steps_back_is_refused_with_the_point_and_the_way_to_clean_it(
    caplog: pytest.LogCaptureFixture,
) -> None:
    desk, sound = Desk(), straight(length_m=100.0)
    assert desk.takes(sound)
    x_m = sound.x_m.copy()
    x_m[60] = x_m[59] - 0.005
    stepping = replace(sound, x_m=x_m)
    assert not desk.takes(stepping)
    assert desk.controller.trajectory is sound
    assert desk.counts.trajectories_rejected == 1
    assert caplog.messages == [
        "trajectory rejected, the old one stays in force: point 60 lies 0.005 m behind point 59 in the direction of "
        "travel, where a vehicle that drives on would never pass it: "
        "vehicle_iface.trajectories.drop_backward_steps takes recording noise out"
    ]
    assert desk.takes(drop_backward_steps(stepping).trajectory)


def test_no_route_whole_or_piece_by_piece_is_refused() -> None:
    desk = Desk()
    for name in ("figure8", "three_point_turn", "stop_and_go"):
        assert desk.takes(make_route(name).to_trajectory())
        pieces = Desk(RecedingRoute(make_route(name)))
        assert pieces.updater.poll(0, STATE, restart=False)
        assert pieces.counts.trajectories_rejected == 0


def test_the_same_points_at_another_time_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at: list[Trajectory] = []

    def noted(trajectory: Trajectory) -> object:
        looked_at.append(trajectory)
        return find_backward_step(trajectory)

    monkeypatch.setattr(trajectory_updates, "find_backward_step", noted)
    desk, sound = Desk(), straight(length_m=100.0)
    for _ in range(3):
        desk.mailbox.put(sound)
        assert desk.updater.poll(0, STATE, restart=True)
    assert len(looked_at) == 1
    assert desk.takes(replace(sound, y_m=np.zeros(len(sound))))
    assert len(looked_at) == 2
