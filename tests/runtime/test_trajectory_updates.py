"""Which trajectories reach the controller while the vehicle drives."""

import logging
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from msgspec import UNSET

from tests.harness import Drive, pure_pursuit, reference, straight
from vehicle_iface import ControllerBase, PurePursuit, Trajectory, VehicleState
from vehicle_iface.pieces import PIECE
from vehicle_iface.runtime import trajectory_updates
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.trajectory_updates import (
    AT_ONCE_AT_RESTART,
    LOGGED_NS,
    PAUSE_NS,
    SHARE_NS,
    TrajectoryUpdater,
)
from vehicle_iface.safety.deviation import DeviationMonitor
from vehicle_iface.trajectories import RecedingRoute, drop_backward_steps, make_route
from vehicle_iface.trajectories.cleaning import find_backward_step_in_pieces
from vehicle_iface.trajectories.mailbox import Mailbox
from vehicle_iface.trajectories.source import FixedTrajectory, TrajectorySource
from vehicle_iface.units import NS_PER_S

STATE = VehicleState(stamp_ns=0, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0)


class Desk:
    """An updater with its mailbox. Its clock stands still unless another one is given."""

    def __init__(
        self,
        source: TrajectorySource | None = None,
        clock: "StepClock | None" = None,
        controller: ControllerBase | None = None,
    ) -> None:
        self.mailbox, self.controller, self.counts = Mailbox(), controller or pure_pursuit(), Counters()
        profile = reference().profile
        self.updater = TrajectoryUpdater(
            source or self.mailbox,
            self.controller,
            self.counts,
            deviation=DeviationMonitor(profile.deviation, speed_max_mps=profile.limits.speed_max_mps),
            limits=profile.limits,
            wheelbase_m=profile.geometry.wheelbase_m,
            now_ns=(clock or StepClock(0)).now_ns,
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
    for number, name in enumerate(("figure8", "three_point_turn", "stop_and_go")):
        desk.mailbox.put(make_route(name).to_trajectory())
        polls_until_taken(desk, number * NS_PER_S)
        pieces = Desk(RecedingRoute(make_route(name)))
        assert pieces.updater.poll(0, STATE, restart=False)
        assert pieces.counts.trajectories_rejected == 0


def test_the_same_points_at_another_time_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at: list[Trajectory] = []

    def noted(trajectory: Trajectory) -> object:
        looked_at.append(trajectory)
        return find_backward_step_in_pieces(trajectory)

    monkeypatch.setattr(trajectory_updates, "find_backward_step_in_pieces", noted)
    desk, sound = Desk(), straight(length_m=100.0)
    for _ in range(3):
        desk.mailbox.put(sound)
        assert desk.updater.poll(0, STATE, restart=True)
    assert len(looked_at) == 1
    assert desk.takes(replace(sound, y_m=np.zeros(len(sound))))
    assert len(looked_at) == 2


class StepClock:
    """Advances by a fixed time with each reading."""

    def __init__(self, step_ns: int) -> None:
        self.step_ns, self.t_ns = step_ns, 0

    def now_ns(self) -> int:
        self.t_ns += self.step_ns
        return self.t_ns


PASS_NS = 10_000_000
LONG = replace(straight(length_m=20_000.0), stamp_ns=5)
"""20 001 points."""


def slow_desk(source: TrajectorySource | None = None) -> Desk:
    """A desk on which one piece of a check is all that a pass has time for."""
    return Desk(source, StepClock(SHARE_NS))


def trajectory_of(desk: Desk) -> Trajectory | None:
    return desk.controller.trajectory


def points_in_check(desk: Desk) -> int | None:
    return desk.updater.points_in_check


def polls_until_taken(desk: Desk, begun_ns: int, *, at_most: int = 1000) -> int:
    for number in range(1, at_most + 1):
        if desk.updater.poll(begun_ns + number * PASS_NS, STATE, restart=False):
            return number
    raise AssertionError(f"not taken in {at_most} passes")


def test_a_long_trajectory_is_driven_after_its_whole_check_and_the_old_one_until_then() -> None:
    desk, old = slow_desk(), straight(length_m=100.0)
    assert desk.takes(old)
    assert not desk.takes(LONG)
    assert points_in_check(desk) == len(LONG)
    assert trajectory_of(desk) is old
    passes = polls_until_taken(desk, 0)
    assert passes > len(LONG) // PIECE
    assert trajectory_of(desk) is LONG
    assert points_in_check(desk) is None
    assert desk.counts.trajectories == 2


def test_between_two_passes_with_pieces_of_a_check_is_a_pause() -> None:
    desk = slow_desk()
    desk.takes(LONG)
    admission = desk.updater._admission
    assert admission is not None
    counted = Counted(admission.pieces)
    admission.pieces = counted
    for at_ns in range(0, PAUSE_NS, PAUSE_NS // 10):
        assert not desk.updater.poll(at_ns, STATE, restart=False)
    assert counted.count == 0
    desk.updater.poll(PAUSE_NS, STATE, restart=False)
    assert counted.count == 1


class Counted:
    """An iterator that counts its steps."""

    def __init__(self, inner: Iterator[None]) -> None:
        self._inner, self.count = inner, 0

    def __iter__(self) -> "Counted":
        return self

    def __next__(self) -> None:
        self.count += 1
        return next(self._inner)


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("speed_mps", 25.0, "speed_mps[20000] = 25: must be in [-20.0, 20.0]"),
        ("x_m", 19_998.995, "point 20000 lies 0.005 m behind point 19999"),
    ],
)
def test_a_fault_in_the_last_point_of_a_long_trajectory_rejects_it(
    field: str, value: float, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    desk, old = slow_desk(), straight(length_m=100.0)
    assert desk.takes(old)
    values = getattr(LONG, field).copy()
    values[-1] = value
    assert not desk.takes(replace(LONG, **{field: values}))
    with pytest.raises(AssertionError, match="not taken"):
        polls_until_taken(desk, 0, at_most=400)
    assert desk.controller.trajectory is old
    assert desk.counts.trajectories_rejected == 1
    assert text in caplog.text
    assert desk.updater.points_in_check is None


def test_an_empty_trajectory_ends_the_check_of_a_long_one_and_stops_the_vehicle() -> None:
    desk = slow_desk()
    assert not desk.takes(LONG)
    assert desk.takes(Trajectory.empty(stamp_ns=0))
    assert desk.updater.points_in_check is None
    with pytest.raises(AssertionError, match="not taken"):
        polls_until_taken(desk, 0, at_most=100)
    assert desk.controller.trajectory is not None
    assert len(desk.controller.trajectory) == 0


def test_of_long_trajectories_that_come_during_a_check_the_newest_follows() -> None:
    desk = slow_desk()
    others = [replace(LONG, stamp_ns=stamp_ns) for stamp_ns in (1, 2)]
    assert not desk.takes(LONG)
    for other in others:
        assert not desk.takes(other)
    passes = polls_until_taken(desk, 0)
    assert desk.controller.trajectory is LONG
    polls_until_taken(desk, passes * PASS_NS)
    assert desk.controller.trajectory is others[1]
    assert desk.counts.trajectories == 2


class Given:
    """A source of one trajectory, stamped with the time of each request after a start."""

    def __init__(self, trajectory: Trajectory) -> None:
        self._trajectory, self.requested = trajectory, True

    def next(self, now_ns: int, _: VehicleState) -> Trajectory | None:
        if not self.requested:
            return None
        self.requested = False
        return replace(self._trajectory, stamp_ns=now_ns)

    def restart(self) -> None:
        self.requested = True


def test_after_a_restart_a_long_trajectory_is_waited_for_without_the_old_one() -> None:
    desk = slow_desk(Given(LONG))
    polls_until_taken(desk, 0)
    assert desk.updater.poll(10**12, STATE, restart=True)
    assert desk.controller.trajectory is None
    polls_until_taken(desk, 10**12)
    assert len(desk.controller.trajectory or ()) == len(LONG)


@pytest.mark.parametrize(("points", "at_once"), [(AT_ONCE_AT_RESTART, True), (AT_ONCE_AT_RESTART + 1, False)])
def test_after_a_restart_a_trajectory_of_1024_points_is_in_force_at_once(points: int, at_once: bool) -> None:
    desk = slow_desk(Given(straight(length_m=points - 1.0)))
    polls_until_taken(desk, 0)
    assert desk.updater.poll(10**12, STATE, restart=True)
    assert (trajectory_of(desk) is not None) is at_once


def test_the_time_of_a_source_begins_when_its_trajectory_comes_into_force_and_that_of_a_planner_does_not() -> None:
    desk = slow_desk(Given(LONG))
    passes = polls_until_taken(desk, 0)
    assert desk.controller.trajectory is not None
    assert desk.controller.trajectory.stamp_ns == passes * PASS_NS
    planned = slow_desk()
    assert not planned.takes(replace(LONG, stamp_ns=7))
    polls_until_taken(planned, 0)
    assert planned.controller.trajectory is not None
    assert planned.controller.trajectory.stamp_ns == 7


def test_a_trajectory_that_is_known_at_the_start_is_checked_before_the_first_pass() -> None:
    desk = slow_desk(FixedTrajectory(LONG))
    assert desk.updater.poll(0, STATE, restart=False)
    assert desk.updater.poll(0, STATE, restart=True)
    assert len(desk.controller.trajectory or ()) == len(LONG)


def test_a_trajectory_known_at_the_start_that_is_not_feasible_is_rejected_by_the_loop() -> None:
    desk = slow_desk(FixedTrajectory(straight(length_m=100.0, speed_mps=25.0)))
    assert desk.counts.trajectories_rejected == 0
    assert not desk.updater.poll(0, STATE, restart=False)
    assert desk.counts.trajectories_rejected == 1


def test_a_check_longer_than_half_a_second_is_logged_at_its_end_too(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    desk = slow_desk()
    desk.takes(LONG)
    polls_until_taken(desk, LOGGED_NS)
    begun, ended = caplog.messages
    assert begun == "a trajectory of 20001 points is being checked; it is not driven yet"
    assert re.fullmatch(r"the trajectory of 20001 points is in force: its check took \d\.\d s", ended)


def test_telemetry_says_that_a_trajectory_is_being_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    mailbox = Mailbox()
    drive = Drive(mailbox).engage()
    assert drive.loop.details().trajectory_being_checked is UNSET
    monkeypatch.setattr(trajectory_updates, "SHARE_NS", 0)
    mailbox.put(replace(LONG, stamp_ns=drive.clock.now_ns()))
    drive.run_s(0.05)
    assert drive.loop.details().trajectory_being_checked == "20001 points"
    drive.run_until(lambda: drive.controller.trajectory is not None, within_s=5.0)
    assert drive.loop.details().trajectory_being_checked is UNSET


class Preparing(PurePursuit):
    """Notes what it prepares."""

    def __init__(self) -> None:
        super().__init__()
        self.notes: list[str] = []

    def prepare_new_trajectory(self, trajectory: Trajectory) -> Iterator[None]:
        for number in range(3):
            self.notes.append(f"piece {number} of {len(trajectory)}")
            yield

    def check_new_trajectory(self, trajectory: Trajectory) -> bool:  # noqa: ARG002
        self.notes.append("check")
        return True


@pytest.mark.parametrize("trajectory", [LONG, straight(length_m=10.0)], ids=["long", "short"])
def test_a_controller_prepares_in_pieces_before_it_gets_the_trajectory(trajectory: Trajectory) -> None:
    controller = Preparing()
    desk = Desk(clock=StepClock(SHARE_NS), controller=controller)
    if not desk.takes(trajectory):
        polls_until_taken(desk, 0)
    count = len(trajectory)
    assert controller.notes == [*(f"piece {number} of {count}" for number in range(3)), "check"]
