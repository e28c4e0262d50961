"""Inputs that are good and bad in turns do not keep a vehicle moving that should stop, in virtual time."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise

import pytest

from tests.harness import Drive, Pair, ms, pure_pursuit, reference, straight
from vehicle_iface import Command, ControllerBase, Reason, Trajectory, VehicleState
from vehicle_iface.drivable import build_route
from vehicle_iface.frame import CanFrame
from vehicle_iface.safety.modes import Mode
from vehicle_iface.status import Gear
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.source import FixedTrajectory

DECELERATION_MPS2 = 3.0
RECOVERY = reference().profile.recovery


class AlternatingSource:
    """Gives a trajectory with each sample: the first of two, or by turns."""

    def __init__(self, good: Trajectory, bad: Trajectory) -> None:
        self.trajectories = (good, bad)
        self.alternates = False
        self._count = 0

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:  # noqa: ARG002
        self._count += 1
        return self.trajectories[self._count // 5 % 2 if self.alternates else 0]

    def restart(self) -> None:
        pass


class AlternatingController(ControllerBase):
    """Drives on; by turns it raises."""

    def __init__(self) -> None:
        super().__init__()
        self.alternates = False
        self._count = 0

    def compute_command_impl(self, state: VehicleState) -> Command:
        self._count += 1
        if self.alternates and self._count % 3 == 0:
            raise ValueError("one in three")
        return Command(stamp_ns=state.stamp_ns, accel_mps2=0.3, front_wheel_angle_rad=0.0, speed_mps=5.0)


def every(count: int, bad: str, good: str) -> Callable[[Drive, int], None]:
    """Of so many samples one is bad."""
    return lambda drive, tick: drive.send_line(bad if tick % count == 0 else good)


def set_source(drive: Drive, _: int) -> None:
    assert isinstance(drive.source, AlternatingSource)
    drive.source.alternates = True


def set_controller(drive: Drive, _: int) -> None:
    assert isinstance(drive.controller, AlternatingController)
    drive.controller.alternates = True


def jump_about(drive: Drive, tick: int) -> None:
    drive.vehicle.signal_faults["x_m"] = (lambda x_m: x_m + 4.0) if tick % 2 == 0 else (lambda x_m: x_m)


def lose_samples(drive: Drive, tick: int) -> None:
    """Nothing for 60 ms, then one sample, again and again."""
    drive.send_line("mute STATE off" if tick % 7 == 6 else "mute STATE on")


def lose_status(drive: Drive, tick: int) -> None:
    """Nothing for 120 ms, then one status."""
    drive.send_line("mute VEHICLE_STATUS off" if tick % 14 >= 12 else "mute VEHICLE_STATUS on")


FLAPPING: Mapping[str, tuple[Reason, Callable[[Drive, int], None]]] = {
    "pose invalid in one of two": (Reason.STATE_INVALID, every(2, "pose_valid 0", "pose_valid 1")),
    "pose invalid in one of three": (Reason.STATE_INVALID, every(3, "pose_valid 0", "pose_valid 1")),
    "pose invalid in one of forty": (Reason.STATE_INVALID, every(40, "pose_valid 0", "pose_valid 1")),
    "frame of reference in one of two": (Reason.FRAME_MISMATCH, every(2, "frame ODOM", "frame MAP")),
    "frame of reference in one of three": (Reason.FRAME_MISMATCH, every(3, "frame ODOM", "frame MAP")),
    "position jumps in one of two": (Reason.STATE_INVALID, jump_about),
    "samples 70 ms apart": (Reason.STATE_STALE, lose_samples),
    "status 140 ms apart": (Reason.STATE_STALE, lose_status),
    "trajectory in two frames": (Reason.FRAME_MISMATCH, set_source),
    "trajectory or an empty one": (Reason.EMPTY_TRAJECTORY, set_source),
    "controller raises in one of three": (Reason.CONTROLLER_ERROR, set_controller),
}


def driving(name: str) -> Drive:
    """A vehicle at 4 m/s and more."""
    good = straight(time_s=1e3)
    if "trajectory" in name:
        bad = straight(time_s=1e3, frame_id="odom") if "frames" in name else Trajectory.empty(stamp_ns=0)
        return Drive(AlternatingSource(good, bad)).engage(4.0)
    controller = AlternatingController() if "controller" in name else pure_pursuit()
    return Drive(FixedTrajectory(good), controller=controller).engage(4.0)


@pytest.mark.parametrize("name", FLAPPING)
def test_an_input_that_flaps_stops_the_vehicle_as_one_that_is_bad_all_the_time(name: str) -> None:
    reason, flap = FLAPPING[name]
    drive = driving(name)
    speed_mps = drive.vehicle.state.speed_mps
    since, begin_s = len(drive.sent), drive.now_s
    tick = 0
    while drive.vehicle.state.speed_mps > 0.0:
        flap(drive, tick)
        drive.step()
        tick += 1
        assert drive.now_s - begin_s < speed_mps / DECELERATION_MPS2 + 1.0, drive.loop.reason.name
    pairs: list[Pair] = drive.pairs(since)
    stops = [pair for pair in pairs if pair["SAFE_STOP"]]
    first = pairs.index(stops[0])
    assert all(pair["SAFE_STOP"] for pair in pairs[first:])
    assert reason in {Reason(int(pair["REASON"])) for pair in stops}
    for _ in range(300):  # and there it stays
        flap(drive, tick)
        drive.step()
        tick += 1
        assert drive.vehicle.state.speed_mps == 0.0


def stops_of(drive: Drive, bad: str, good: str, times: int, wait_s: float) -> None:
    """The input is bad for a moment, again and again."""
    for _ in range(times):
        drive.send_line(bad)
        drive.run_s(0.05)
        drive.send_line(good)
        drive.run_s(wait_s)


def test_the_fourth_stop_within_twenty_seconds_latches_until_armed_again(caplog: pytest.LogCaptureFixture) -> None:
    drive = Drive(FixedTrajectory(straight(time_s=1e3))).engage(4.0)
    stops_of(drive, "pose_valid 0", "pose_valid 1", times=3, wait_s=3.0)
    assert drive.mode() is Mode.ENGAGED
    assert drive.last()["SAFE_STOP"] == 0
    with caplog.at_level(logging.WARNING):
        stops_of(drive, "pose_valid 0", "pose_valid 1", times=1, wait_s=5.0)
    assert "the stop is latched (STATE_INVALID)" in caplog.text
    assert drive.mode() is Mode.HALTED
    assert drive.vehicle.state.speed_mps == 0.0
    assert (drive.last()["ENABLE"], drive.last()["SAFE_STOP"]) == (1, 1)
    drive.run_s(30.0)
    assert drive.mode() is Mode.HALTED
    drive.loop.arming.request()
    drive.run_until(lambda: drive.vehicle.state.speed_mps > 2.0, 5.0)
    assert drive.mode() is Mode.ENGAGED
    assert drive.loop.summary().latched_fault is None


def test_a_latched_stop_is_not_armed_while_the_vehicle_moves(caplog: pytest.LogCaptureFixture) -> None:
    drive = Drive(FixedTrajectory(straight(speed_mps=10.0, time_s=1e3))).engage(9.0)
    stops_of(drive, "pose_valid 0", "pose_valid 1", times=4, wait_s=0.6)
    assert drive.mode() is Mode.HALTING
    with caplog.at_level(logging.WARNING):
        drive.loop.arming.request()
        drive.run_s(0.02)
    assert "not armed: the stop is latched, and the vehicle does not stand yet" in caplog.text
    assert drive.mode() is Mode.HALTING


def test_a_run_that_ends_in_a_latched_stop_ends_in_a_fault() -> None:
    drive = Drive(FixedTrajectory(straight(time_s=1e3))).engage(4.0)
    stops_of(drive, "pose_valid 0", "pose_valid 1", times=4, wait_s=1.0)
    drive.loop.shutdown.request()
    drive.run_s(10.0)
    assert drive.loop.shutdown.is_done
    assert drive.loop.shutdown.ended_in_fault
    assert drive.loop.summary().latched_fault == "STATE_INVALID"


def test_a_driver_takes_over_from_a_latched_stop() -> None:
    drive = Drive(FixedTrajectory(straight(time_s=1e3))).engage(4.0)
    stops_of(drive, "pose_valid 0", "pose_valid 1", times=4, wait_s=1.0)
    drive.send_line("throttle 1")
    drive.run_s(0.05)
    assert drive.mode() is Mode.OVERRIDDEN
    assert drive.last()["ENABLE"] == 0


# Sources of motion


@pytest.mark.parametrize("gear", [Gear.PARK, Gear.NEUTRAL, Gear.REVERSE])
def test_a_gear_that_contradicts_the_motion_stops_the_vehicle_for_good(
    gear: Gear, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = Drive(FixedTrajectory(straight(time_s=1e3))).engage(4.0)
    report = drive.vehicle._report
    monkeypatch.setattr(drive.vehicle, "_report", lambda: replace(report(), gear=gear))
    took_s = drive.run_until(lambda: drive.last()["SAFE_STOP"] == 1, 1.0)
    assert 0.2 <= took_s <= 0.35
    assert drive.loop.reason is Reason.STATE_INVALID
    drive.run_until(lambda: drive.vehicle.state.speed_mps == 0.0, 3.0)
    drive.run_s(1.0)
    assert drive.mode() is Mode.HALTED
    assert drive.loop.summary().disagreements["gear and motion disagree"] == 1


def test_a_change_of_gear_at_standstill_is_no_contradiction() -> None:
    """The three-point turn shifts twice."""
    drive = Drive(RecedingRoute(build_route("three_point_turn", reference().profile)))
    drive.run_s(45.0)
    assert sum(drive.loop.summary().disagreements.values()) == 0
    assert {Gear.REVERSE, Gear.DRIVE} <= {Gear(int(pair["GEAR_REQUEST"])) for pair in drive.pairs()}


# Frames that are held up, signals that flood


@pytest.mark.parametrize("held", [30, 40])
def test_frames_that_were_held_up_are_not_answered_in_a_burst(held: int) -> None:
    """Held up upstream of this machine: their stamps are those of their arrival, as fast as the bus carries them."""
    drive = Drive(FixedTrajectory(straight(time_s=1e3))).engage(4.0)
    frames: list[CanFrame] = []
    while len(frames) < 3.5 * held:
        drive.clock.sleep_until(drive.vehicle.next_due_ns)
        frames += drive.vehicle.advance(drive.clock.t_ns)
        drive.step()
    since, released_ns = len(drive.sent), drive.clock.t_ns
    for frame in frames:
        drive.clock.t_ns += ms(0.23)
        drive.line.inject(frame)
        drive.step()
    drive.run_s(0.3)
    pairs = drive.pairs(since)
    gaps_ns = [after.at_ns - before.at_ns for before, after in pairwise(pairs)]
    burst_ns = ms(0.23) * len(frames)
    in_burst = [pair for pair in pairs if pair.at_ns <= released_ns + burst_ns]
    assert len(in_burst) <= 2 * burst_ns // ms(10) + 1  # one for the time, and one for a sample
    assert max(gaps_ns) <= ms(21)
    assert all(pair["SAFE_STOP"] for pair in pairs if pair.at_ns <= released_ns + ms(100))
    assert drive.loop._counters.samples_held_up >= held
    assert drive.loop.summary().drops == {}
    assert sum(drive.loop.summary().implausible.values()) == 0
    assert drive.mode() is Mode.ENGAGED
    assert drive.last()["SAFE_STOP"] == 0


def test_a_flood_of_requests_to_arm_is_logged_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    drive = Drive(FixedTrajectory(straight(time_s=1e3))).engage(4.0)
    with caplog.at_level(logging.WARNING):
        for _ in range(250):
            drive.loop.arming.request()
            drive.step()
    refusals = [text for text in caplog.messages if text.startswith("not armed: it drives")]
    assert 2 <= len(refusals) <= 4
    assert "more refusals since the last" in refusals[-1]
    assert drive.mode() is Mode.ENGAGED
