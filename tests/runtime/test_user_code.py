"""Whatever a user's controller, hook or source does, the loop goes on and the vehicle has an answer."""

import asyncio
import dataclasses
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from tests.harness import Drive, ms, reference, straight
from vehicle_iface import BehaviorConfig, Command, ControllerBase, Reason, StopSteering, Trajectory, VehicleState
from vehicle_iface.codec.database import load_database
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.publisher import TelemetryPublisher
from vehicle_iface.safety.modes import Mode
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import Snapshot


class _Handy(ControllerBase):
    def compute_command_impl(self, state: VehicleState) -> Command:
        return Command(stamp_ns=state.stamp_ns, accel_mps2=1.0, front_wheel_angle_rad=0.0, speed_mps=5.0)

    def stop_steering_impl(self, state: VehicleState) -> tuple[float, float]:
        raise KeyError("table", state)


class _Broken:
    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:
        raise ValueError(now_ns, state)

    def restart(self) -> None:
        raise ValueError("again")


def test_a_stop_steering_hook_that_raises_anything_is_a_straight_stop() -> None:
    drive = Drive(controller=_Handy(BehaviorConfig(stop_steering=StopSteering.TRACK))).engage(3.0)
    drive.send_line("pose_valid 0")
    drive.run_s(0.5)
    assert drive.last()["SAFE_STOP"] == 1
    assert drive.last()["FRONT_WHEEL_ANGLE_REQUEST"] == 0.0


@pytest.mark.parametrize("ahead_s", [9.99, 10.01, 1.7e9])
def test_a_trajectory_that_was_stamped_by_another_clock_is_rejected(
    ahead_s: float, caplog: pytest.LogCaptureFixture
) -> None:
    class Ahead(_Broken):
        def restart(self) -> None:
            pass

        def next(self, now_ns: int, _state: VehicleState) -> Trajectory | None:
            return dataclasses.replace(straight(speed_mps=5.0), stamp_ns=now_ns + round(ahead_s * 1e9))

    drive = Drive(Ahead())
    drive.run_s(1.0)
    is_rejected = ahead_s > 10.0
    assert (drive.loop.details().loop["trajectories_rejected"] > 0) is is_rejected
    assert ("ahead of time.monotonic_ns()" in caplog.text) is is_rejected
    assert (drive.loop.reason is Reason.NO_TRAJECTORY) is is_rejected


def test_a_source_that_raises_stops_the_vehicle_and_not_the_loop() -> None:
    drive = Drive(_Broken())
    drive.run_s(1.0)
    assert drive.last()["SAFE_STOP"] == 1
    assert drive.loop.reason is Reason.NO_TRAJECTORY


class _Worse(_Broken):
    """Gives something too fast twice before it breaks."""

    def __init__(self) -> None:
        self.left = 2

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:
        self.left -= 1
        return straight(speed_mps=25.0) if self.left >= 0 else super().next(now_ns, state)

    def restart(self) -> None:
        """As if nothing had been."""


def test_the_first_thing_that_a_source_raises_is_logged_with_its_place_whatever_was_refused_before(
    caplog: pytest.LogCaptureFixture,
) -> None:
    drive = Drive(_Worse())
    drive.run_s(1.0)
    assert drive.loop.details().loop["trajectories_rejected"] > 10
    assert caplog.text.count("no new trajectory; the old one stays in force") == 1
    assert "raise ValueError(now_ns, state)" in caplog.text


@pytest.mark.parametrize("seconds", [0.07, 0.09, 2.0])
def test_after_a_stall_only_the_newest_sample_is_answered(seconds: float) -> None:
    drive = Drive().engage(3.0)
    drive.stall(seconds)
    since = len(drive.sent)
    drive.run_s(0.5)
    assert max(Counter(pair.step for pair in drive.pairs(since)).values()) == 1


def test_a_bus_that_takes_nothing_for_100_ms_silences_and_latches() -> None:
    drive = Drive().engage(3.0)
    drive.line.full = True
    drive.run_s(0.3)
    assert drive.mode() is Mode.SILENT
    assert drive.loop.reason is Reason.LINK_DOWN
    drive.line.full = False
    since = len(drive.sent)
    drive.run_s(1.0)
    assert drive.pairs(since) == []


class _Thinks(_Handy):
    """Takes its time for each command, while the vehicle goes on sending."""

    drive: Drive | None = None
    takes_s = 0.0

    def __init__(self) -> None:
        super().__init__()
        self.ages_ns: list[int] = []
        """Of the states that it was asked for a command for, when it was asked."""

    def compute_command_impl(self, state: VehicleState) -> Command:
        if self.drive is not None:
            self.ages_ns.append(self.drive.clock.t_ns - state.stamp_ns)
            self.drive.stall(self.takes_s)
        return super().compute_command_impl(state)


def test_with_a_controller_that_takes_most_of_its_budget_nothing_is_driven_by_an_old_state(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    controller = _Thinks()
    drive = Drive(controller=controller).engage(3.0)
    ages_ns: dict[Reason, list[int]] = {}
    send = drive.line.send

    def send_and_note_age(*frames: Any) -> int:
        if drive.loop._cycle.last is not None and len(frames) == 2:
            safe = drive.loop._cycle.last.permitted
            ages_ns.setdefault(safe.reason, []).append(drive.clock.t_ns - safe.stamp_ns)
        return send(*frames)

    monkeypatch.setattr(drive.line, "send", send_and_note_age)
    controller.drive, controller.takes_s = drive, 0.045
    too_old = drive.loop.details().loop["samples_expired"]
    drive.run_s(1.0)
    assert ages_ns[Reason.STATE_STALE]
    assert max(ages_ns[Reason.NOMINAL]) <= ms(100)
    assert max(ages_ns[Reason.STATE_STALE]) > ms(100)
    assert ms(90) < max(controller.ages_ns) <= ms(100)  # those that grow older behind the others are not answered
    assert drive.loop.details().loop["samples_expired"] > too_old


@pytest.mark.parametrize("error", [SystemExit(0), asyncio.CancelledError()], ids=["exit", "cancelled"])
def test_a_source_or_hook_that_wants_to_end_the_program_does_not(
    error: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ends(*_: object) -> None:
        raise error

    drive = Drive().engage(3.0)
    monkeypatch.setattr(drive.source, "next", ends)
    drive.run_s(0.1)
    monkeypatch.undo()
    monkeypatch.setattr(drive.controller, "check_new_trajectory", ends)
    drive.source.restart()
    drive.run_s(0.1)
    assert drive.loop.details().loop["trajectories_rejected"] >= 11
    assert drive.loop.reason is Reason.NOMINAL


def test_a_tracking_hook_that_wants_to_end_the_program_is_a_straight_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    def ends(_: VehicleState) -> tuple[float, float]:
        raise SystemExit(1)

    drive = Drive(controller=_Handy(BehaviorConfig(stop_steering=StopSteering.TRACK))).engage(3.0)
    monkeypatch.setattr(drive.controller, "stop_steering_impl", ends)
    drive.loop.shutdown.request()
    drive.run_s(0.5)
    assert (drive.last()["SAFE_STOP"], drive.last()["FRONT_WHEEL_ANGLE_REQUEST"]) == (1, 0.0)


class _Page:
    """A telemetry writer that keeps the newest snapshot."""

    newest: Snapshot

    def publish(self, snapshot: Snapshot) -> None:
        self.newest = snapshot

    def publish_trajectory(self, _: Trajectory | None) -> int:
        return 1


class _Looks(_Handy):
    """Says where it looks ahead to, or what else is in its mind."""

    point: Any = (7.0, -2)

    @property
    def lookahead_point(self) -> Any:
        if isinstance(self.point, BaseException):
            raise self.point
        return self.point


@pytest.mark.parametrize(
    "nonsense",
    [
        *(ValueError("x"), SystemExit(1), asyncio.CancelledError(), 3.0, "ab", (1.0,), (1.0, 2.0, 3.0)),
        *((float("nan"), 0.0), (0.0, float("inf")), (None, None)),
    ],
    ids=repr,
)
def test_any_look_ahead_of_a_controller_is_drawn_or_logged_once(
    nonsense: Any, caplog: pytest.LogCaptureFixture
) -> None:
    controller, page = _Looks(), _Page()
    controller.set_trajectory(straight())
    publisher = TelemetryPublisher(page, controller, Counters())  # type: ignore[arg-type]
    for point, is_drawn in ((None, 0), ((7.0, -2), 1), (nonsense, 0), (nonsense, 0)):
        controller.point = point
        _publish(publisher)
        assert page.newest.has_lookahead == is_drawn
        assert (page.newest.lookahead_x_m, page.newest.lookahead_y_m) == ((7.0, -2.0) if is_drawn else (0.0, 0.0))
    assert [record.message for record in caplog.records] == [
        "lookahead_point is not a pair of finite numbers; not drawn (logged once)"
    ]


def _publish(publisher: TelemetryPublisher) -> None:
    state = VehicleState(stamp_ns=0, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0)
    publisher.publish_snapshot(
        0, controller_state=ControllerState.ENGAGED, reason=Reason.NOMINAL, state=state, status=None, decision=None
    )


def test_a_count_or_index_beyond_its_signal_is_sent_as_the_greatest(tmp_path: Path) -> None:
    profile = reference().profile
    dbc = Path(profile.dbc).read_text(encoding="utf-8")
    for was, becomes in (
        ("56|8@1+ (1,0) [0|255]", "56|7@1+ (1,0) [0|127]"),
        ("24|16@1+ (1,0) [0|65535]", "24|6@1+ (1,0) [1|60]"),
    ):
        assert was in dbc
        dbc = dbc.replace(was, becomes)
    (tmp_path / "reference.dbc").write_text(dbc, encoding="utf-8")
    (tmp_path / "few.toml").write_text(Path(profile.file).read_text(encoding="utf-8"), encoding="utf-8")
    drive = Drive(database=load_database(load_profile(tmp_path / "few.toml"))).engage(3.0)
    said = [report.frame.data for report in drive.named("CONTROLLER_STATUS")]
    assert (min(data[3] & 0x3F for data in said), said[-1][7]) == (1, 0)
    drive.loop._counters.commands_late = 1000
    drive.run_s(20.0)
    last = drive.named("CONTROLLER_STATUS")[-1].frame.data
    assert (last[3] & 0x3F, last[7]) == (60, 127)
