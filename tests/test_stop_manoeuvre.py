"""The stop as the vehicle feels it: the whole loop, the simulated vehicle, and what is on the line between them."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import dropwhile, pairwise, takewhile
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.harness import Drive, Pair, ms, pure_pursuit, reference, straight
from vehicle_iface import Reason, StopSteering, compose
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile
from vehicle_iface.safety.modes import Mode
from vehicle_iface.status import Gear, VehicleMode
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryReader, TelemetryWriter
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.shapes import make_route
from vehicle_iface.trajectories.source import FixedTrajectory


class Nothing:
    """A source that never gives a trajectory."""

    def next(self, now_ns: int, state: object) -> None:  # noqa: ARG002
        return None

    def restart(self) -> None:
        pass


def with_behavior(**changes: Any) -> VehicleDatabase:
    """The reference vehicle, stopped in another way."""
    profile = reference().profile
    return load_database(
        msgspec.structs.replace(profile, behavior=msgspec.structs.replace(profile.behavior, **changes))
    )


def with_handover(warning_s: float, *, holds: bool) -> VehicleDatabase:
    """The reference vehicle, with another way to be given back."""
    profile = reference().profile
    handover = msgspec.structs.replace(profile.handover, warning_s=warning_s, hold_until_warned=holds)
    return load_database(msgspec.structs.replace(profile, handover=handover))


def driving(sign: float = 1.0, speed_mps: float = 5.0, **more: Any) -> Drive:
    """Along a line at that speed, forwards or backwards."""
    return Drive(FixedTrajectory(straight(speed_mps=sign * speed_mps)), **more).engage(0.95 * speed_mps)


def passes(drive: Drive, seconds: float) -> Iterator[tuple[float, Pair]]:
    """The speed that each command of the next seconds was computed from, and that command."""
    end_ns = drive.clock.t_ns + ms(1000.0 * seconds)
    while drive.clock.t_ns < end_ns and not drive.loop.shutdown.is_done:
        since = len(drive.sent)
        drive.step()
        yield from ((drive.state.speed_mps, pair) for pair in drive.pairs(since))


def stopping(drive: Drive, seconds: float = 4.0) -> list[tuple[float, Pair]]:
    """The same for the commands of the next stop."""
    begun = dropwhile(lambda one: not one[1]["SAFE_STOP"], passes(drive, seconds))
    return list(takewhile(lambda one: one[1]["SAFE_STOP"], begun))


def invalid(drive: Drive) -> None:
    drive.send_line("pose_valid 0")


def lost(drive: Drive) -> None:
    drive.send_line("mute STATE on")


def ended(drive: Drive) -> None:
    drive.loop.shutdown.request()


CAUSES = {"invalid": invalid, "lost": lost, "ended": ended}


# How it brakes


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("cause", CAUSES)
def test_a_stop_never_pushes_comes_on_by_the_jerk_and_reaches_the_safe_deceleration(cause: str, sign: float) -> None:
    drive = driving(sign)
    CAUSES[cause](drive)
    found = stopping(drive, 2.5)
    before_ns = max(pair.at_ns for pair in drive.pairs() if pair.at_ns < found[0][1].at_ns)
    assert all(speed * pair["ACCEL_REQUEST"] <= 0.0 for speed, pair in found)
    assert max(abs(pair["ACCEL_REQUEST"]) for _, pair in found) == pytest.approx(3.0)
    rising = [-sign * min(30.0e-9 * (pair.at_ns - before_ns), 3.0) for _, pair in found]
    assert [pair["ACCEL_REQUEST"] for _, pair in found[:12]] == pytest.approx(rising[:12])
    for (_, before), (_, after) in pairwise(found):
        granted_mps2 = 30.0e-9 * (after.at_ns - before.at_ns)
        assert abs(after["ACCEL_REQUEST"] - before["ACCEL_REQUEST"]) <= granted_mps2 + 2e-3


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_brake_is_let_up_with_the_speed_and_the_vehicle_stands_without_a_jolt(sign: float) -> None:
    """Against the same stop without the ease; it may cost a tenth of a second and five centimetres."""
    jolts_mps2, took_s, went_m = [], [], []
    for ease_s in (0.1, 0.2):
        drive = driving(sign, database=with_behavior(stop_release_time_constant_s=ease_s))
        drive.send_line("pose_valid 0")
        begin_m, felt = drive.vehicle.state.x_m, 0.0
        begin_ns = drive.clock.t_ns
        while drive.vehicle.state.speed_mps != 0.0:
            felt = drive.vehicle.state.accel_mps2
            drive.step()
        jolts_mps2.append(abs(felt))
        took_s.append((drive.clock.t_ns - begin_ns) * 1e-9)
        went_m.append(abs(drive.vehicle.state.x_m - begin_m))
    assert jolts_mps2[1] < 0.6 * jolts_mps2[0]
    assert took_s[1] <= took_s[0] + 0.1
    assert went_m[1] <= went_m[0] + 0.05


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_vehicle_that_has_come_to_rest_is_held_by_safe_stop_and_asked_for_nothing(sign: float) -> None:
    drive = driving(sign)
    drive.send_line("pose_valid 0")
    drive.run_until(lambda: drive.vehicle.state.speed_mps == 0.0, 5.0)
    place_m, since = drive.vehicle.state.x_m, len(drive.sent)
    drive.run_s(2.0)
    held = drive.pairs(since)
    assert {(p["ENABLE"], p["SAFE_STOP"], p["ACCEL_REQUEST"]) for p in held} == {(1, 1, 0.0)}
    assert drive.vehicle.state.x_m == place_m
    assert {body["HAZARD_LIGHTS"] for body in drive.named("BODY_COMMAND", since)} == {1}


def test_a_vehicle_that_stands_from_the_first_command_on_is_asked_for_nothing() -> None:
    drive = Drive(Nothing()).engage()
    found = list(passes(drive, 1.0))
    assert {(p["SAFE_STOP"], p["REASON"], p["ACCEL_REQUEST"]) for _, p in found} == {(1, Reason.NO_TRAJECTORY, 0.0)}
    assert drive.vehicle.state.x_m == 0.0


@pytest.mark.parametrize(("sign", "gear"), [(1.0, Gear.DRIVE), (-1.0, Gear.REVERSE)])
def test_a_profile_may_ask_for_a_brake_that_holds_against_the_gear(sign: float, gear: Gear) -> None:
    drive = driving(sign, speed_mps=2.0, database=with_behavior(hold_deceleration_mps2=0.5))
    drive.send_line("pose_valid 0")
    drive.run_until(lambda: drive.vehicle.state.speed_mps == 0.0, 5.0)
    drive.run_s(0.3)
    place_m, since = drive.vehicle.state.x_m, len(drive.sent)
    drive.run_s(1.0)
    assert drive.vehicle.gear is gear
    assert {pair["ACCEL_REQUEST"] for pair in drive.pairs(since)} == {-sign * 0.5}
    assert drive.vehicle.state.x_m == place_m


def test_a_stop_out_of_full_acceleration_drops_the_drive_at_once() -> None:
    drive = Drive(FixedTrajectory(straight(speed_mps=15.0))).engage(2.0)
    assert drive.last()["ACCEL_REQUEST"] > 0.5
    drive.send_line("pose_valid 0")
    assert stopping(drive, 0.1)[0][1]["ACCEL_REQUEST"] == pytest.approx(-0.3)


def test_a_stop_that_ends_drives_on_from_the_brake_that_was_on() -> None:
    drive = driving()
    drive.send_line("pose_valid 0")
    drive.run_s(0.3)
    drive.send_line("pose_valid 1")
    found = list(passes(drive, 0.5))
    first = next(k for k, (_, pair) in enumerate(found) if not pair["SAFE_STOP"])
    assert found[first][1]["ACCEL_REQUEST"] == pytest.approx(-2.7)


@pytest.mark.parametrize("deceleration_mps2", [1.0, 2.0, 5.0])
def test_the_safe_deceleration_of_the_controller_is_that_of_the_bus(deceleration_mps2: float) -> None:
    drive = driving(controller=pure_pursuit(safe_deceleration_mps2=deceleration_mps2))
    drive.send_line("pose_valid 0")
    found = stopping(drive, 1.0)
    assert min(pair["ACCEL_REQUEST"] for _, pair in found) == pytest.approx(-deceleration_mps2)


# Where it steers


def in_a_curve(policy: StopSteering) -> Drive:
    """Round a circle to the left, at speed."""
    drive = Drive(RecedingRoute(make_route("circle")), controller=pure_pursuit(stop_steering=policy)).engage(3.0)
    drive.run_until(lambda: drive.vehicle.state.front_wheel_angle_rad > 0.1, 10.0)
    drive.run_s(1.0)
    return drive


def stall(drive: Drive) -> None:
    """The link takes nothing for three commands, and says that it is not clean for a while."""
    drive.line.full = True
    drive.run_s(0.04)
    drive.line.full = False


def steered(drive: Drive, seconds: float) -> list[float]:
    """The front wheels of the stop's commands."""
    return [pair["FRONT_WHEEL_ANGLE_REQUEST"] for _, pair in stopping(drive, seconds)]


Happening = Callable[[Drive], None]


def each(*happenings: Happening) -> Happening:
    """One after the other."""

    def happen(drive: Drive) -> None:
        for happening in happenings:
            happening(drive)

    return happen


def said(line: str) -> Happening:
    return lambda drive: drive.send_line(line)


GOOD: dict[str, Happening] = {"ended": ended, "stalled": stall}
BAD: dict[str, Happening] = {
    "invalid": invalid,
    "lost": lost,
    "jumps": said("jump 40 0"),
    "no status": said("mute VEHICLE_STATUS on"),
    "frame": said("frame ODOM"),
    "ended without a state": each(lost, ended),
    "ended without a pose": each(invalid, ended),
    "ended in another frame": each(said("frame ODOM"), ended),
    "stalled without a pose": each(invalid, stall),
}


@pytest.mark.parametrize("cause", [*GOOD, *BAD])
def test_a_straight_stop_turns_the_wheels_back_whatever_it_stops_for(cause: str) -> None:
    drive = in_a_curve(StopSteering.STRAIGHT)
    (GOOD | BAD)[cause](drive)
    angles_rad = steered(drive, 0.7)
    assert angles_rad[0] > 0.05
    assert all(after <= before + 1e-9 for before, after in pairwise(angles_rad))
    assert angles_rad[-1] == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("cause", ["ended", "stalled", "invalid", "lost"])
def test_a_holding_stop_leaves_the_wheels_where_they_are(cause: str) -> None:
    drive = in_a_curve(StopSteering.HOLD)
    (GOOD | BAD)[cause](drive)
    angles_rad = steered(drive, 0.7)
    assert angles_rad == pytest.approx([angles_rad[0]] * len(angles_rad), abs=0.01)


@pytest.mark.parametrize("cause", BAD)
def test_a_tracking_stop_is_a_straight_one_while_the_state_is_not_good(cause: str) -> None:
    drive = in_a_curve(StopSteering.TRACK)
    BAD[cause](drive)
    assert steered(drive, 0.7)[-1] == pytest.approx(0.0, abs=0.02)


def stands(drive: Drive) -> bool:
    return drive.vehicle.state.speed_mps == 0.0


def test_a_tracking_stop_stays_on_the_path_to_standstill() -> None:
    off_m = {}
    for policy in StopSteering:
        drive = in_a_curve(policy)
        drive.loop.shutdown.request()
        drive.run_until(partial(stands, drive), 5.0)
        circle = make_route("circle")
        at = drive.vehicle.state
        off_m[policy] = float(min((circle.x_m - at.x_m) ** 2 + (circle.y_m - at.y_m) ** 2)) ** 0.5
    assert off_m[StopSteering.TRACK] < 0.1
    assert off_m[StopSteering.STRAIGHT] > 3.0 * off_m[StopSteering.TRACK]


def test_a_tracking_stop_steers_while_the_link_does_not_take_everything() -> None:
    drive = in_a_curve(StopSteering.TRACK)
    stall(drive)
    angles_rad = steered(drive, 0.3)
    assert angles_rad == pytest.approx([angles_rad[0]] * len(angles_rad), abs=0.03)
    assert angles_rad[-1] > 0.1


@pytest.mark.parametrize("policy", list(StopSteering))
def test_the_profile_chooses_the_steering(policy: StopSteering) -> None:
    profile = with_behavior(stop_steering=policy.value).profile
    assert compose.build_controller("pure_pursuit", profile).behavior.stop_steering is policy


# Giving control back


def snapshots(drive: Drive, address: Path, seconds: float) -> list[Snapshot]:
    """What the page gets to know, pass by pass."""
    found = []
    with TelemetryReader(str(address)) as reader:
        end_ns = drive.clock.t_ns + ms(1000.0 * seconds)
        while drive.clock.t_ns < end_ns and not drive.loop.shutdown.is_done:
            drive.step()
            reader.poll()
            newest = reader.newest()
            assert newest is not None
            found.append(newest)
    return found


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[TelemetryWriter]:
    with TelemetryWriter(str(tmp_path / "telemetry"), SessionInfo(channel="vcan0", bus="embedded")) as writer:
        yield writer


def test_before_a_planned_end_the_driver_is_warned_and_not_one_frame_differs(writer: TelemetryWriter) -> None:
    plain, planned = driving(), driving(telemetry=writer)
    planned.loop.shutdown.schedule(planned.clock.t_ns + ms(5000))
    found = snapshots(planned, writer.path, 5.0)
    plain.run_s(5.0)
    warned = [snapshot for snapshot in found if snapshot.handover_pending]
    assert len(found) - len(warned) == pytest.approx(200, abs=2)
    assert warned[0].handover_in_ns == pytest.approx(ms(3000), abs=ms(20))
    assert warned[-1].handover_in_ns < ms(20)
    assert [sent.frame for sent in plain.sent] == [sent.frame for sent in planned.sent]


def test_the_reference_vehicle_is_released_at_standstill_and_the_driver_is_warned_meanwhile(
    writer: TelemetryWriter,
) -> None:
    drive = driving(telemetry=writer)
    drive.loop.shutdown.request()
    found = snapshots(drive, writer.path, 5.0)
    ending = [snapshot for snapshot in found if snapshot.reason == Reason.SHUTDOWN]
    stopping = [snapshot for snapshot in ending if snapshot.controller_state == 4]
    assert all(snapshot.handover_pending and snapshot.handover_in_ns == 0 for snapshot in stopping[1:])
    pairs = drive.pairs()
    standing_ns = next(s.stamp_ns for s in stopping if abs(s.speed_mps) <= 0.01)
    let_go_ns = next(pair.at_ns for pair in pairs if not pair["ENABLE"] and pair["REASON"] == Reason.SHUTDOWN)
    assert let_go_ns - standing_ns <= ms(40)


@pytest.mark.parametrize("speed_mps", [5.0, 1.0])
def test_a_vehicle_that_can_be_held_is_held_until_the_warning_ends(speed_mps: float) -> None:
    drive = driving(speed_mps=speed_mps, database=with_handover(3.0, holds=True))
    since = len(drive.sent)
    drive.loop.shutdown.request()
    took_s = drive.run_until(lambda: drive.mode() is Mode.RELEASED, 10.0)
    assert took_s == pytest.approx(3.0, abs=0.04)
    ending = [pair for pair in drive.pairs(since) if pair["REASON"] == Reason.SHUTDOWN]
    held = [pair for pair in ending if pair["ENABLE"]]
    assert all(pair["SAFE_STOP"] for pair in held)
    assert held[-1]["ACCEL_REQUEST"] == 0.0
    drive.run_until(lambda: drive.loop.shutdown.is_done, 0.3)
    assert drive.vehicle.mode is VehicleMode.READY


def test_a_warning_that_was_given_while_driving_holds_nothing_up() -> None:
    drive = driving(database=with_handover(3.0, holds=True))
    drive.loop.shutdown.schedule(drive.clock.t_ns + ms(3000))
    drive.run_s(3.0)
    drive.loop.shutdown.request()
    assert drive.run_until(lambda: drive.mode() is Mode.RELEASED, 10.0) < 2.3
    assert abs(drive.vehicle.state.speed_mps) < 0.05


@pytest.mark.parametrize("order", ["brake 1", "throttle 1", "steer 3", "fault 7", "emergency_stop"])
def test_neither_driver_nor_fault_waits_for_the_warning(order: str) -> None:
    drive = driving(speed_mps=1.0, database=with_handover(9.0, holds=True))
    drive.loop.shutdown.request()
    drive.run_s(2.0)
    assert drive.last()["ENABLE"] == 1
    drive.send_line(order)
    assert drive.run_until(lambda: drive.last()["ENABLE"] == 0, 0.1) <= 0.04


def test_a_second_request_does_not_wait_for_the_warning() -> None:
    drive = driving(database=with_handover(9.0, holds=True))
    drive.loop.shutdown.request()
    drive.run_s(0.3)
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 0.05)
    assert drive.last()["ENABLE"] == 0


def test_a_vehicle_that_does_not_come_to_rest_is_released_after_ten_seconds_all_the_same() -> None:
    drive = driving(database=with_handover(9.9, holds=True))
    drive.vehicle._car._target_mps2 = lambda *_: 0.1  # type: ignore[method-assign]  # brakes that do nothing
    drive.loop.shutdown.request()
    assert 10.0 <= drive.run_until(lambda: drive.loop.shutdown.is_done, 12.0) <= 10.3


def test_without_control_there_is_no_warning_to_take_over(writer: TelemetryWriter) -> None:
    drive = Drive(armed=False, telemetry=writer)
    drive.loop.shutdown.schedule(drive.clock.t_ns + ms(1000))
    assert not any(snapshot.handover_pending for snapshot in snapshots(drive, writer.path, 0.9))


def test_a_profile_may_bind_the_warning_to_a_signal(tmp_path: Path) -> None:
    """The highest bit of DEADLINE_MISSES, here made a signal of its own."""
    profile = reference().profile
    dbc = Path(profile.dbc).read_text(encoding="utf-8")
    misses = next(line for line in dbc.splitlines() if line.strip().startswith("SG_ DEADLINE_MISSES"))
    fewer = misses.replace("56|8@", "56|7@").replace("255]", "127]")
    bit = ' SG_ HANDOVER : 63|1@1+ (1,0) [0|1] "" VEHICLE'
    (tmp_path / "reference.dbc").write_text(dbc.replace(misses, f"{fewer}\n{bit}"), encoding="utf-8")
    toml = Path(profile.file).read_text(encoding="utf-8")
    last = 'deadline_misses = "CONTROLLER_STATUS.DEADLINE_MISSES"'
    (tmp_path / "warns.toml").write_text(
        toml.replace(last, f'{last}\nhandover = "CONTROLLER_STATUS.HANDOVER"'), encoding="utf-8"
    )
    drive = driving(database=load_database(load_profile(tmp_path / "warns.toml")))
    drive.run_s(1.0)
    assert {report["DEADLINE_MISSES"] for report in drive.named("CONTROLLER_STATUS")} == {0}
    drive.loop.shutdown.request()
    drive.run_s(0.3)
    assert drive.named("CONTROLLER_STATUS")[-1]["DEADLINE_MISSES"] == 128
