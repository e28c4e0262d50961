"""The whole loop with a vehicle on its bus, in virtual time: what the contract's page says, read off the frames."""

import math
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from vehicle_bus_contract.reference import CONTROLLER_SENDS

from tests.contract_frames import pack
from tests.harness import (
    Drive,
    Pair,
    counters_step_by_one,
    ms,
    pure_pursuit,
    reference,
    straight,
)
from vehicle_iface import Command, ControllerBase, Reason, Trajectory, VehicleState, clock, compose, drivable
from vehicle_iface.cli.run import run_for
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.control.tracking import point_at, tracking_error
from vehicle_iface.errors import BusError, SignalError
from vehicle_iface.frame import CanFrame
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim import engagement as sim_engagement
from vehicle_iface.sim.engagement import Event as VehicleEvent
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.sim.vehicle import SimulatedVehicle
from vehicle_iface.status import ControllerState, Gear, VehicleMode
from vehicle_iface.telemetry import SessionInfo, TelemetryWriter
from vehicle_iface.trajectories.csv_file import save_csv
from vehicle_iface.trajectories.mailbox import Mailbox
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.shapes import ROUTES, make_route
from vehicle_iface.trajectories.source import FixedTrajectory
from vehicle_iface.units import s_from_ns

NO_REQUEST = 7


class Silent:
    """A source that never gives a trajectory."""

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:  # noqa: ARG002
        return None

    def restart(self) -> None:
        pass


class Moody(ControllerBase):
    """Drives on until it is asked for something else."""

    def __init__(self) -> None:
        super().__init__()
        self.mood: Any = None
        self.stamps_ns: list[int] = []

    def compute_command_impl(self, state: VehicleState) -> Command:
        self.stamps_ns.append(state.stamp_ns)
        if isinstance(self.mood, Exception):
            raise self.mood
        accel_mps2 = 1.0 if self.mood is None else self.mood
        return Command(stamp_ns=0, accel_mps2=accel_mps2, front_wheel_angle_rad=0.0, speed_mps=5.0)

    def check_new_trajectory(self, trajectory: Trajectory) -> bool:
        return len(trajectory) != 2


class Recorded(ControllerBase):
    """Answers each sample with a number that is read off that sample."""

    def __init__(self) -> None:
        super().__init__()
        self.angles_rad: list[float] = []

    def compute_command_impl(self, state: VehicleState) -> Command:
        tenths_of_ms = state.stamp_ns // 1_000_000 % 1000
        self.angles_rad.append(tenths_of_ms * 1e-4)
        return Command(stamp_ns=0, accel_mps2=0.5, front_wheel_angle_rad=self.angles_rad[-1], speed_mps=5.0)


class Alternating(ControllerBase):
    """Drives on until it alternates between the extremes."""

    def __init__(self) -> None:
        super().__init__()
        self.alternates = False
        self._sign = 1.0

    def compute_command_impl(self, state: VehicleState) -> Command:  # noqa: ARG002
        if not self.alternates:
            return Command(stamp_ns=0, accel_mps2=1.0, front_wheel_angle_rad=0.0, speed_mps=5.0)
        self._sign = -self._sign
        return Command(stamp_ns=0, accel_mps2=self._sign * 6.0, front_wheel_angle_rad=self._sign * 0.6, speed_mps=5.0)


def has(pair: Pair, *, enable: int, stop: int, reason: Reason) -> bool:
    """Whether both commands have these values."""
    assert pair.steer["ENABLE"] == pair.drive["ENABLE"]
    return (pair["ENABLE"], pair["SAFE_STOP"], pair["REASON"]) == (enable, stop, reason)


def cruising(**more: Any) -> Drive:
    return Drive(**more).engage(3.0)


def hazards(drive: Drive, since: int) -> set[float]:
    return {body["HAZARD_LIGHTS"] for body in drive.named("BODY_COMMAND", since)}


def after(drive: Drive, seconds: float) -> list[Pair]:
    """The command pairs of the next seconds, of which there are some."""
    since = len(drive.sent)
    drive.run_s(seconds)
    pairs = drive.pairs(since)
    assert pairs
    return pairs


# Commands


def test_each_complete_sample_is_answered_by_one_pair_with_that_samples_content() -> None:
    controller = Recorded()
    drive = Drive(controller=controller).engage()
    since, done = len(drive.sent), len(controller.angles_rad)
    completed = drive.loop._assembler.completed
    drive.run_s(2.0)
    pairs = drive.pairs(since)
    assert len(pairs) == drive.loop._assembler.completed - completed == 200
    requested_rad = [min(angle, 0.6) for angle in controller.angles_rad[done:]]
    assert len(requested_rad) == len(pairs)
    exact = sum(
        math.isclose(pair["FRONT_WHEEL_ANGLE_REQUEST"], request_rad, abs_tol=1e-9)
        for pair, request_rad in zip(pairs, requested_rad, strict=True)
    )
    assert exact > 100  # where it differs the rate limit cut it: the content jumps once a second


def test_every_frame_is_intact_and_every_counter_steps_by_one_and_never_repeats() -> None:
    drive = cruising()
    drive.run_s(3.0)
    assert counters_step_by_one(drive.sent)
    assert {sent.name for sent in drive.sent} == set(CONTROLLER_SENDS)


def test_commands_come_at_the_samples_rate_and_not_in_bursts() -> None:
    drive = cruising()
    pairs = after(drive, 5.0)
    assert len(pairs) == 500
    assert max(Counter(pair.step for pair in pairs).values()) == 1
    steps_ns = {b.at_ns - a.at_ns for a, b in pairwise(pairs)}
    assert steps_ns == {ms(10)}


def test_body_and_status_come_ten_times_a_second() -> None:
    drive = cruising()
    since = len(drive.sent)
    drive.run_s(5.0)
    assert len(drive.named("BODY_COMMAND", since)) == 50
    assert len(drive.named("CONTROLLER_STATUS", since)) == 50


# Engagement


def test_an_unarmed_loop_sends_no_frame_whatever_happens() -> None:
    drive = Drive(armed=False)
    drive.run_s(2.0)
    drive.loop.arming.request()
    drive.run_s(2.0)
    drive.send_line("mute STATE on")
    drive.run_s(1.0)
    drive.send_line("mute STATE off")
    drive.send_line("brake 1")
    drive.run_s(1.0)
    drive.loop.shutdown.request()
    drive.run_s(1.0)
    assert drive.sent == []
    assert drive.loop.shutdown.is_done
    assert drive.vehicle.counters["to_autonomous"] == 0


def test_it_engages_after_half_a_second_of_fresh_samples_when_the_vehicle_is_ready() -> None:
    drive = Drive()
    took_s = drive.run_until(lambda: drive.mode() is Mode.ENGAGING, 2.0)
    assert 0.5 <= took_s <= 0.54
    assert all(has(pair, enable=0, stop=0, reason=Reason.NOT_ENGAGED) for pair in drive.pairs()[:-1])
    drive.run_until(lambda: drive.mode() is Mode.ENGAGED, 0.1)
    enabled = [pair for pair in drive.pairs() if pair["ENABLE"]]
    assert 3 <= len(enabled) <= 6
    assert drive.vehicle.mode is VehicleMode.AUTONOMOUS


def test_an_arming_that_changes_nothing_is_answered_by_why(caplog: pytest.LogCaptureFixture) -> None:
    drive = Drive().engage()
    drive.loop.arming.request()
    drive.run_s(0.1)
    assert [text for text in caplog.messages if "not armed" in text] == ["not armed: it drives"]
    assert drive.last()["ENABLE"] == 1


def test_a_vehicle_in_manual_is_not_engaged_until_it_is_ready() -> None:
    drive = Drive(mode=VehicleMode.MANUAL)
    drive.run_s(2.0)
    assert drive.mode() is Mode.STANDBY
    assert not any(pair["ENABLE"] for pair in drive.pairs())
    drive.send_line("ready")
    assert drive.run_until(lambda: drive.mode() is Mode.ENGAGED, 1.0) < 0.2


def test_a_vehicle_that_never_becomes_autonomous_is_given_up_after_three_seconds() -> None:
    drive = Drive()
    drive.run_until(lambda: drive.mode() is Mode.ENGAGING, 1.0)
    drive.vehicle._watch.reset_streak()
    took_s = 0.0
    while drive.mode() is Mode.ENGAGING:
        drive.vehicle._watch.reset_streak()
        drive.step()
        took_s += 0.01
        assert took_s < 4.0
    assert 2.9 <= took_s <= 3.1
    assert all(has(p, enable=0, stop=0, reason=Reason.VEHICLE_NOT_AUTONOMOUS) for p in after(drive, 1.0)[1:])


def test_the_gear_is_asked_for_until_it_is_in_and_never_again() -> None:
    drive = Drive().engage(1.0)
    requests = [pair["GEAR_REQUEST"] for pair in drive.pairs() if pair["ENABLE"]]
    assert requests[0] == Gear.DRIVE
    changed = requests.index(NO_REQUEST)
    assert set(requests[:changed]) == {Gear.DRIVE}
    assert set(requests[changed:]) == {NO_REQUEST}
    assert drive.vehicle.counters["gear_refusals"] == 0


def test_backwards_it_requests_reverse_and_drives_backwards() -> None:
    drive = Drive(FixedTrajectory(straight(speed_mps=-3.0))).engage(2.0)
    requests = {pair["GEAR_REQUEST"] for pair in drive.pairs() if pair["ENABLE"]}
    assert requests == {Gear.REVERSE, NO_REQUEST}
    assert drive.vehicle.state.speed_mps < -1.9
    assert drive.last()["SPEED_REQUEST"] == pytest.approx(-3.0)


def test_the_trajectorys_time_begins_with_the_engagement() -> None:
    drive = Drive(FixedTrajectory(straight(length_m=50.0, time_s=5.0)), mode=VehicleMode.MANUAL)
    drive.run_s(20.0)
    drive.send_line("ready")
    drive.engage(1.0)
    drive.run_s(1.0)
    assert has(drive.last(), enable=1, stop=0, reason=Reason.NOMINAL)


# Stops


def stopped(drive: Drive, reason: Reason, within_s: float = 0.15) -> int:
    """Wait for the stop and for standstill, and check both; the number of the first frame of the stop."""
    drive.run_until(lambda: drive.last()["SAFE_STOP"] == 1, within_s)
    since = len(drive.sent)
    drive.run_until(lambda: drive.vehicle.state.speed_mps == 0.0, 10.0)
    drive.run_s(1.0)
    pairs = drive.pairs(since)
    assert all(has(pair, enable=1, stop=1, reason=reason) for pair in pairs)
    assert all(-3.0 - 1e-9 <= pair["ACCEL_REQUEST"] <= 3.0 for pair in pairs)
    assert {pair["GEAR_REQUEST"] for pair in pairs} == {NO_REQUEST}
    assert drive.vehicle.state.speed_mps == 0.0
    assert drive.vehicle.mode is VehicleMode.AUTONOMOUS
    report = drive.named("CONTROLLER_STATUS")[-1]
    assert (report["STATE"], report["REASON"]) == (ControllerState.STOPPING, reason)
    return since


def test_without_a_trajectory_it_engages_and_stands() -> None:
    drive = Drive(Silent())
    drive.engage()
    stopped(drive, Reason.NO_TRAJECTORY)
    assert hazards(drive, len(drive.sent) - 100) == {1}


def test_an_empty_trajectory_stops() -> None:
    mailbox = Mailbox()
    drive = Drive(mailbox)
    drive.run_s(0.1)
    mailbox.put(replace_stamp(straight(time_s=1e4), drive))
    drive.engage(3.0)
    mailbox.put(Trajectory.empty(stamp_ns=drive.clock.t_ns))
    since = stopped(drive, Reason.EMPTY_TRAJECTORY)
    assert 1 in hazards(drive, since)


def replace_stamp(trajectory: Trajectory, drive: Drive) -> Trajectory:
    return replace(trajectory, stamp_ns=drive.clock.t_ns)


def test_the_end_in_space_stops_without_hazard_lights_and_holds() -> None:
    drive = Drive(FixedTrajectory(straight(length_m=20.0, speed_mps=2.0, time_s=1e4))).engage(1.5)
    since = stopped(drive, Reason.PAST_END_SPACE, within_s=30.0)
    assert hazards(drive, since) == {0}


def test_the_end_in_time_stops_without_hazard_lights() -> None:
    drive = Drive(FixedTrajectory(straight(time_s=5.0))).engage(3.0)
    since = stopped(drive, Reason.PAST_END_TIME, within_s=6.0)
    assert hazards(drive, since) == {0}


def drives_on_after(drive: Drive, hold: str) -> None:
    """The stop goes on for the profile's time after its cause, and no longer."""
    hold_s = getattr(reference().profile.recovery, hold)
    took_s = drive.run_until(lambda: drive.last()["SAFE_STOP"] == 0, hold_s + 0.1)
    assert took_s >= hold_s - 0.011


def test_another_frame_of_reference_stops_and_the_same_one_again_drives_on() -> None:
    drive = cruising()
    drive.send_line("frame ODOM")
    since = stopped(drive, Reason.FRAME_MISMATCH)
    assert hazards(drive, since) == {1}
    drive.send_line("frame MAP")
    drives_on_after(drive, "frame_mismatch_s")


def test_a_pose_that_is_not_valid_stops_and_a_valid_one_drives_on() -> None:
    drive = cruising()
    drive.send_line("pose_valid 0")
    since = stopped(drive, Reason.STATE_INVALID)
    assert hazards(drive, since) == {1}
    drive.send_line("pose_valid 1")
    drives_on_after(drive, "state_invalid_s")


@pytest.mark.parametrize("mood", [ValueError("mistake"), RuntimeError(), math.nan, math.inf, "fast"])
def test_a_controller_that_raises_or_returns_an_invalid_command_stops(mood: object) -> None:
    controller = Moody()
    drive = cruising(controller=controller)
    controller.mood = mood
    since = stopped(drive, Reason.CONTROLLER_ERROR)
    assert hazards(drive, since) == {1}
    controller.mood = None
    drives_on_after(drive, "controller_error_s")


def test_a_controller_far_out_of_limits_is_limited_and_counted() -> None:
    controller = Moody()
    drive = cruising(controller=controller)
    controller.mood = 1e300
    pairs = after(drive, 0.5)
    assert max(pair["ACCEL_REQUEST"] for pair in pairs) == pytest.approx(3.0)
    assert has(pairs[-1], enable=1, stop=0, reason=Reason.NOMINAL)
    assert drive.loop.summary().limited["accel_mps2"] > 0


def test_50_ms_without_a_sample_stop_from_the_last_state_at_the_command_period() -> None:
    drive = cruising()
    last_ns = drive.state.stamp_ns
    drive.send_line("mute STATE on")
    pairs = after(drive, 0.4)
    assert 0 < pairs[0].at_ns - last_ns - ms(50) <= ms(20)
    assert all(has(pair, enable=1, stop=1, reason=Reason.STATE_STALE) for pair in pairs)
    assert {b.at_ns - a.at_ns for a, b in pairwise(pairs)} == {ms(10)}
    assert pairs[-1]["ACCEL_REQUEST"] == pytest.approx(-3.0)
    assert counters_step_by_one(drive.sent)
    drive.send_line("mute STATE off")
    drives_on_after(drive, "state_stale_s")
    assert drive.mode() is Mode.ENGAGED


def test_500_ms_without_a_sample_silence_for_good_until_armed_again() -> None:
    drive = cruising()
    drive.send_line("mute STATE on")
    last_ns = drive.state.stamp_ns
    drive.run_until(lambda: drive.mode() is Mode.SILENT, 1.0)
    assert 0 < drive.clock.t_ns - last_ns - ms(500) <= ms(20)
    count = len(drive.sent)
    drive.run_s(1.0)
    assert drive.vehicle.mode is VehicleMode.FAULT
    drive.send_line("mute STATE off")
    drive.run_s(3.0)
    assert len(drive.sent) == count
    drive.send_line("reset")
    drive.send_line("ready")
    drive.run_s(2.0)
    assert len(drive.sent) == count
    drive.loop.arming.request()
    assert 0.5 <= drive.run_until(lambda: drive.mode() is Mode.ENGAGED, 2.0) <= 0.7
    assert counters_step_by_one(drive.sent)


def test_a_status_that_stays_away_stops() -> None:
    drive = cruising()
    drive.send_line("mute VEHICLE_STATUS on")
    drive.run_until(lambda: drive.last()["SAFE_STOP"] == 1, 0.25)
    assert has(drive.last(), enable=1, stop=1, reason=Reason.STATE_STALE)


def test_lost_and_damaged_samples_are_driven_through_while_the_state_is_young() -> None:
    drive = cruising()
    for order in ("corrupt POSE 3", "skip_counter STATE 2", "corrupt STATE 2"):
        drive.send_line(order)
        pairs = after(drive, 1.0)
        assert all(has(pair, enable=1, stop=0, reason=Reason.NOMINAL) for pair in pairs)


# Letting go


@pytest.mark.parametrize("order", ["brake 1", "throttle 1", "steer 3.0", "steer -3.0"])
def test_after_a_takeover_the_controller_is_released_until_armed_again(order: str) -> None:
    drive = cruising()
    drive.send_line(order)
    pairs = after(drive, 0.03)
    assert has(pairs[-1], enable=0, stop=0, reason=Reason.DRIVER_OVERRIDE)
    word, _ = order.split()
    drive.send_line(f"{word} 0")
    drive.send_line("ready")
    assert all(has(p, enable=0, stop=0, reason=Reason.DRIVER_OVERRIDE) for p in after(drive, 3.0))
    drive.loop.arming.request()
    drive.run_until(lambda: drive.mode() is Mode.ENGAGED, 1.0)
    assert has(drive.last(), enable=1, stop=0, reason=Reason.NOMINAL)


@pytest.mark.parametrize("order", ["brake 1", "throttle 1", "steer 3.0", "steer -3.0"])
def test_a_vehicle_that_stays_autonomous_while_its_driver_acts_is_released(
    order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SimulatedVehicle, "is_driver_active", False)
    drive = cruising()
    drive.send_line(order)
    pairs = after(drive, 0.04)
    assert has(pairs[-1], enable=0, stop=0, reason=Reason.DRIVER_OVERRIDE)
    assert drive.mode() is Mode.OVERRIDDEN


@pytest.mark.parametrize("order", ["steer 2.9", "steer -2.9"])
def test_a_hand_that_rests_on_the_wheel_does_not_take_over(order: str) -> None:
    drive = cruising()
    drive.send_line(order)
    assert all(has(pair, enable=1, stop=0, reason=Reason.NOMINAL) for pair in after(drive, 1.0))


@pytest.mark.parametrize("order", ["fault 7", "emergency_stop"])
def test_a_fault_of_the_vehicle_is_latched(order: str) -> None:
    drive = cruising()
    drive.send_line(order)
    assert has(after(drive, 0.05)[-1], enable=0, stop=0, reason=Reason.VEHICLE_FAULT)
    drive.send_line("reset")
    drive.send_line("ready")
    assert all(has(p, enable=0, stop=0, reason=Reason.VEHICLE_FAULT) for p in after(drive, 2.0))
    drive.loop.shutdown.request()
    drive.run_s(1.0)
    assert drive.loop.shutdown.is_done
    assert drive.loop.shutdown.ended_in_fault


def test_a_vehicle_that_drops_out_to_ready_by_itself_is_released_for_good() -> None:
    drive = cruising()
    assert drive.vehicle._apply(VehicleEvent.RELEASED)
    drive.run_until(lambda: drive.last()["ENABLE"] == 0, 0.2)
    assert all(has(p, enable=0, stop=0, reason=Reason.VEHICLE_NOT_AUTONOMOUS) for p in after(drive, 2.0))
    assert drive.mode() is Mode.FAULT


@pytest.mark.parametrize("name", ["DRIVE_COMMAND", "STEER_COMMAND"])
def test_another_commander_silences_at_once_and_for_good(name: str) -> None:
    drive = cruising()
    drive.line.inject(pack(name, 3, ENABLE=1))
    drive.step()
    count = len(drive.sent)
    drive.run_s(2.0)
    assert len(drive.sent) == count
    assert (drive.mode(), drive.loop.reason) == (Mode.SILENT, Reason.DUPLICATE_COMMANDER)
    assert drive.vehicle.mode is VehicleMode.FAULT
    assert drive.loop.details().loop["foreign_commands"] == 1


@pytest.fixture
def lenient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The vehicle's own watchdog is satisfied: another commander drives it."""
    monkeypatch.setattr(sim_engagement, "WATCHDOG_PERIODS", 10**5)


def silenced(drive: Drive, count: int) -> bool:
    """Whether nothing more has left, and the vehicle is driven on by the other one, who now says so."""
    drive.run_s(0.15)
    drive.line.inject(pack("STEER_COMMAND", 3, ENABLE=1))
    drive.run_s(2.0)
    assert drive.vehicle.mode is VehicleMode.AUTONOMOUS
    assert (drive.mode(), drive.loop.reason) == (Mode.SILENT, Reason.DUPLICATE_COMMANDER)
    return len(drive.sent) == count


@pytest.mark.usefixtures("lenient")
@pytest.mark.parametrize("silence_s", [0.0, 0.19, 0.25, 2.0])
def test_a_vehicle_with_another_commander_is_left_alone_however_late_it_is_received(silence_s: float) -> None:
    drive = Drive(mode=VehicleMode.AUTONOMOUS)
    drive.send_line("mute ALL on")
    drive.run_s(silence_s)
    assert {sent.name for sent in drive.sent} <= {"BODY_COMMAND", "CONTROLLER_STATUS"}
    assert bool(drive.sent) is (silence_s > 0.2)
    drive.send_line("mute ALL off")
    drive.step()
    assert silenced(drive, len(drive.sent))
    assert drive.loop.summary().commands == 0
    assert drive.loop.details().loop["samples_before_engagement"] >= 14


@pytest.mark.usefixtures("lenient")
def test_after_a_long_silence_the_vehicle_may_have_another_commander() -> None:
    drive = Drive(mode=VehicleMode.MANUAL)
    drive.run_s(1.0)
    assert drive.mode() is Mode.STANDBY
    drive.send_line("mute ALL on")
    drive.run_s(1.0)
    drive.vehicle.mode = VehicleMode.AUTONOMOUS
    drive.send_line("mute ALL off")
    drive.step()
    assert silenced(drive, len(drive.sent))


@pytest.mark.usefixtures("lenient")
def test_an_autonomous_vehicle_without_a_commander_is_released_and_driven_again() -> None:
    drive = cruising()
    drive.send_line("mute ALL on")
    drive.run_s(1.0)
    assert drive.mode() is Mode.SILENT
    drive.send_line("mute ALL off")
    drive.loop.arming.request()
    drive.run_s(0.5)
    assert drive.vehicle.mode is VehicleMode.READY
    drive.run_until(lambda: drive.mode() is Mode.ENGAGED, 1.0)
    assert drive.loop.summary().samples + drive.loop.details().loop["samples_before_engagement"] == (
        drive.loop._assembler.completed
    )


@pytest.mark.parametrize("tick", range(45))
def test_a_request_to_end_at_any_moment_of_a_start_ends_it_without_driving(tick: int) -> None:
    drive = Drive()
    drive.send_line("mute VEHICLE_STATUS on")  # it counts for 200 ms
    drive.run_s(tick * 0.01)
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 0.5)
    assert not any(pair["ENABLE"] for pair in drive.pairs())
    assert not drive.loop.shutdown.ended_in_fault


def test_a_fault_that_was_armed_away_is_one_until_something_is_sent_again() -> None:
    drive = cruising()
    drive.line.inject(pack("DRIVE_COMMAND", 3, ENABLE=1))
    drive.step()
    drive.loop.arming.request()
    drive.run_until(lambda: drive.mode() is Mode.OBSERVING, 0.05)
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 0.05)
    assert drive.loop.shutdown.ended_in_fault
    assert drive.loop.summary().latched_fault == "DUPLICATE_COMMANDER"


@pytest.mark.parametrize(
    "frame",
    [
        CanFrame(0x080, bytes(8), is_error=True),
        CanFrame(0x080, bytes(8), is_extended=True),
        CanFrame(0x07F, bytes(8)),
        CanFrame(0x7FF, bytes(8)),
    ],
)
def test_frames_that_only_resemble_another_commanders_change_nothing(frame: CanFrame) -> None:
    drive = cruising()
    drive.line.inject(frame)
    assert all(has(pair, enable=1, stop=0, reason=Reason.NOMINAL) for pair in after(drive, 1.0))


@pytest.mark.parametrize("seconds", [0.01, 0.3, 5.0])
def test_a_lost_link_is_latched_also_when_it_comes_back(seconds: float) -> None:
    drive = cruising()
    drive.line.down = True
    count = len(drive.sent)
    drive.run_s(seconds)
    drive.line.down = False
    drive.run_s(3.0)
    assert len(drive.sent) == count
    assert (drive.mode(), drive.loop.reason, drive.line.opened) == (Mode.SILENT, Reason.LINK_DOWN, 2)
    assert drive.loop.details().loop["link_losses"] == 1
    drive.send_line("reset")
    drive.send_line("ready")
    drive.loop.arming.request()
    drive.run_until(lambda: drive.mode() is Mode.ENGAGED, 2.0)
    assert counters_step_by_one(drive.sent)


def test_a_command_that_met_a_lost_link_has_stepped_no_counter(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = cruising()
    send = drive.line.send

    def cut(*frames: CanFrame) -> int:
        drive.line.down = True
        return send(*frames)

    monkeypatch.setattr(drive.line, "send", cut)
    count = len(drive.sent)
    drive.run_until(lambda: drive.mode() is Mode.SILENT, 0.1)
    monkeypatch.undo()
    drive.line.down = False
    drive.run_s(1.0)
    assert len(drive.sent) == count
    drive.send_line("reset")
    drive.send_line("ready")
    drive.loop.arming.request()
    drive.run_until(lambda: drive.mode() is Mode.ENGAGED, 2.0)
    assert counters_step_by_one(drive.sent)


def test_a_lost_link_resets_state_and_sequences() -> None:
    drive = cruising()
    drive.line.down = True
    drive.step()
    assert (drive.loop._assembler.newest, drive.loop._assembler.status) == (None, None)
    drive.stall(0.25)
    drive.line.close()  # what came meanwhile, was not received
    drive.line.down = False
    drive.run_s(1.0)
    assert drive.state.stamp_ns > drive.clock.t_ns - ms(20)
    assert drive.loop.details().drops == {}
    assert not any(drive.loop.details().lost.values())


def test_a_link_that_is_down_at_the_start_is_an_error() -> None:
    def refuse() -> Any:
        raise BusError("vcan0: down")

    with pytest.raises(BusError, match="vcan0"):
        compose.build_loop(
            database=reference(),
            open_bus=refuse,
            controller=pure_pursuit(),
            source=Silent(),
            telemetry=None,
            armed=True,
        )


# The end


def test_a_request_to_end_stops_the_vehicle_then_releases_it_and_ends() -> None:
    drive = cruising()
    since = len(drive.sent)
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 10.0)
    pairs = drive.pairs(since)
    stop = [pair for pair in pairs if has(pair, enable=1, stop=1, reason=Reason.SHUTDOWN)]
    released = [pair for pair in pairs if has(pair, enable=0, stop=0, reason=Reason.SHUTDOWN)]
    assert len(stop) + len(released) in (len(pairs), len(pairs) - 1)
    assert pairs[-1] in released
    assert all(pair.at_ns < released[0].at_ns for pair in stop)
    assert drive.vehicle.state.speed_mps == pytest.approx(0.0, abs=0.05)
    assert drive.vehicle.mode is VehicleMode.READY
    assert not drive.loop.shutdown.ended_in_fault
    assert 1 in hazards(drive, since)


def test_a_vehicle_that_does_not_come_to_rest_is_released_after_ten_seconds() -> None:
    drive = cruising()
    drive.vehicle._car._target_mps2 = lambda *_: 0.1  # type: ignore[method-assign]  # brakes that do nothing
    drive.loop.shutdown.request()
    took_s = drive.run_until(lambda: drive.loop.shutdown.is_done, 12.0)
    assert 10.0 <= took_s <= 10.3
    assert has(drive.last(), enable=0, stop=0, reason=Reason.SHUTDOWN)


def test_two_requests_to_end_send_exactly_one_pair_that_releases() -> None:
    drive = cruising()
    drive.loop.shutdown.request()
    drive.run_s(0.3)
    since = len(drive.sent)
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 0.05)
    assert [pair["ENABLE"] for pair in drive.pairs(since)].count(0) == 1
    assert drive.last()["ENABLE"] == 0
    assert counters_step_by_one(drive.sent)


def test_two_requests_to_end_at_once_send_exactly_one_pair_that_releases() -> None:
    drive = cruising()
    since = len(drive.sent)
    drive.loop.shutdown.request()
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 0.05)
    assert [pair["ENABLE"] for pair in drive.pairs(since)].count(0) == 1


def stops_for_good_before_it_releases(drive: Drive, since: int) -> bool:
    """Whether the vehicle stood when it was let go."""
    drive.run_until(lambda: drive.loop.shutdown.is_done, 10.0)
    pairs = drive.pairs(since)
    assert has(pairs[-1], enable=0, stop=0, reason=Reason.SHUTDOWN)
    return len([pair for pair in pairs if pair["ENABLE"]]) > 150 and abs(drive.vehicle.state.speed_mps) < 0.05


def test_a_planned_end_that_falls_into_a_stop_for_good_does_not_cut_it_short(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = cruising().engage(4.5)
    monkeypatch.setattr(clock, "monotonic_ns", drive.clock.now_ns)
    since = len(drive.sent)
    drive.loop.shutdown.request()
    run_for(drive.loop, 0.3)
    assert stops_for_good_before_it_releases(drive, since)


def test_after_a_planned_end_only_the_second_request_cuts_the_stop_short() -> None:
    drive = cruising().engage(4.5)
    since = len(drive.sent)
    drive.loop.shutdown.begin_on_schedule()
    drive.run_s(0.1)
    drive.loop.shutdown.request()
    assert stops_for_good_before_it_releases(drive, since)
    again = cruising()
    again.loop.shutdown.begin_on_schedule()
    again.run_s(0.1)
    again.loop.shutdown.request()
    again.loop.shutdown.request()
    again.run_until(lambda: again.loop.shutdown.is_done, 0.05)
    assert has(again.last(), enable=0, stop=0, reason=Reason.SHUTDOWN)
    assert again.vehicle.state.speed_mps > 1.0


def test_a_driver_who_takes_over_during_the_end_ends_it() -> None:
    drive = cruising()
    drive.loop.shutdown.request()
    drive.run_s(0.3)
    drive.send_line("brake 1")
    assert drive.run_until(lambda: drive.loop.shutdown.is_done, 1.0) < 0.3
    assert drive.last()["ENABLE"] == 0


@pytest.mark.parametrize("order", ["mute STATE on", "mute ALL on"])
def test_an_end_without_samples_is_silent_and_still_an_end(order: str) -> None:
    drive = cruising()
    drive.send_line(order)
    drive.run_s(0.1)
    drive.loop.shutdown.request()
    drive.run_until(lambda: drive.loop.shutdown.is_done, 1.0)
    assert drive.loop.shutdown.ended_in_fault


def test_an_end_requested_in_the_pass_in_which_sending_notices_the_loss_of_the_bus_ends_in_a_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drive = cruising()

    def cut() -> bool:
        drive.line.down = True
        drive.loop.shutdown.request()
        raise BusError("tap: cut")

    monkeypatch.setattr(drive.line, "has_room", cut)
    drive.run_until(lambda: drive.loop.shutdown.is_done, 5.0)
    assert drive.loop.shutdown.ended_in_fault


# Time


def test_frames_received_during_the_start_are_discarded_and_count_neither_as_late_nor_as_expired() -> None:
    drive = Drive()
    drive.stall(0.5)
    drive.loop.begin()
    drive.engage(speed_mps=1.0)
    counts = drive.loop.details().loop
    assert counts["deadline_misses"] == counts["samples_expired"] == 0
    assert counts["samples"] == pytest.approx(100 * (drive.now_s - 0.5), abs=1)


def test_a_backlog_older_than_100_ms_is_never_answered() -> None:
    controller = Moody()
    drive = cruising(controller=controller)
    drive.stall(2.0)
    since, resumed_ns = len(drive.sent), drive.clock.t_ns
    seen = len(controller.stamps_ns)
    drive.run_s(1.0)
    assert drive.loop.details().loop["samples_expired"] >= 185
    assert min(controller.stamps_ns[seen:]) >= resumed_ns - ms(100)
    pairs = drive.pairs(since)
    assert pairs
    assert not any(pair["ENABLE"] for pair in pairs)  # the vehicle's own watchdog acted long ago
    later = [pair for pair in pairs if pair.at_ns > resumed_ns + ms(10)]
    assert max(Counter(pair.step for pair in later).values()) == 1


@pytest.mark.parametrize("seconds", [0.03, 0.09])
def test_one_late_pass_is_counted_and_driven_through(seconds: float) -> None:
    drive = cruising()
    drive.stall(seconds)
    pairs = after(drive, 1.0)
    assert all(has(pair, enable=1, stop=0, reason=Reason.NOMINAL) for pair in pairs)
    assert drive.loop.details().loop["deadline_misses"] > 0
    assert counters_step_by_one(drive.sent)


def test_when_the_bus_has_no_room_the_frame_is_lost_and_not_kept() -> None:
    drive = cruising()
    drive.line.full = True
    count = len(drive.sent)
    drive.run_s(0.05)
    drive.line.full = False
    pairs = after(drive, 1.0)
    assert len(drive.sent) > count
    assert max(Counter(pair.step for pair in pairs).values()) == 1
    assert drive.loop.details().loop["frames_not_sent"] >= 5
    assert counters_step_by_one(drive.sent)


def test_a_command_that_cannot_be_encoded_is_counted_and_silence_ends_the_drive(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    drive = cruising()

    def refuse(*_: object) -> None:
        raise SignalError("DRIVE_COMMAND: checksum: ZeroDivisionError")

    monkeypatch.setattr(Encoder, "encode_command", refuse)
    count = len(drive.named("DRIVE_COMMAND"))
    drive.run_s(1.0)
    assert len(drive.named("DRIVE_COMMAND")) == count
    assert drive.mode() is Mode.FAULT  # the vehicle's own watchdog acted
    assert drive.loop.details().loop["messages_not_encoded"] > 90
    assert [record.message for record in caplog.records if "not sent" in record.message] == [
        "not sent: DRIVE_COMMAND: checksum: ZeroDivisionError (further ones are counted)"
    ]


def test_a_command_is_not_sent_behind_one_that_still_waits() -> None:
    drive = cruising()
    count = len(drive.sent)
    drive.line.waiting = True
    drive.run_s(0.05)
    assert drive.sent[count:] == []
    drive.line.waiting = False
    drive.run_s(0.5)
    assert drive.loop.details().loop["commands_refused"] >= 4
    assert counters_step_by_one(drive.sent)


@pytest.mark.parametrize("lost", [1, 2])
def test_after_half_a_command_was_sent_the_next_one_is_limited_by_that_half(lost: int) -> None:
    controller = Alternating()
    drive = Drive(controller=controller).engage(3.0)
    controller.alternates = True
    drive.run_s(0.05)
    since = len(drive.sent)
    for _ in range(10):
        drive.line.takes = 1
        drive.run_s(lost * 0.01)
        drive.line.takes = None
        drive.run_s(0.03)
    for name, signal, most in (
        ("DRIVE_COMMAND", "ACCEL_REQUEST", 0.3),
        ("STEER_COMMAND", "FRONT_WHEEL_ANGLE_REQUEST", 0.008),
    ):
        for before, later in pairwise(drive.named(name, since)):
            periods = (later.at_ns - before.at_ns) / ms(10)
            assert abs(later[signal] - before[signal]) <= most * periods + 1e-9, (name, later.at_ns)
    assert len(drive.named("DRIVE_COMMAND", since)) > len(drive.named("STEER_COMMAND", since))
    assert counters_step_by_one(drive.sent)


def test_two_commands_refused_in_a_row_stop_nothing() -> None:
    drive = cruising()
    refuse(drive, 2)
    assert {pair["SAFE_STOP"] for pair in after(drive, 1.0)} == {0}


def test_three_commands_refused_in_a_row_stop_the_vehicle_until_the_link_is_clean() -> None:
    drive = cruising()
    refuse(drive, 3)
    pairs = after(drive, 0.4)
    assert {(pair["ENABLE"], pair["SAFE_STOP"], pair["REASON"]) for pair in pairs} == {(1, 1, Reason.LINK_DOWN)}
    assert drive.vehicle.state.speed_mps < 4.5
    assert after(drive, 1.0)[-1]["REASON"] == Reason.NOMINAL
    assert drive.loop.summary().link.state == "UP"


def refuse(drive: Drive, count: int) -> None:
    """Exactly so many commands find no room."""
    before = drive.loop.details().loop["commands_refused"]
    drive.line.waiting = True
    drive.run_until(lambda: drive.loop.details().loop["commands_refused"] == before + count, 1.0)
    drive.line.waiting = False


def test_an_arming_while_the_link_is_gone_is_refused() -> None:
    drive = cruising()
    drive.line.down = True
    drive.run_s(0.2)
    drive.loop.arming.request()
    drive.run_s(0.2)
    drive.line.down = False
    drive.run_s(3.0)
    assert drive.mode() is Mode.SILENT


# Samples that cannot be true


def test_one_sample_that_jumps_is_dropped_and_nothing_else_happens() -> None:
    drive = cruising()
    drive.send_line("jump 4.0 0.0")
    drive.run_s(0.009)
    drive.send_line("jump -4.0 0.0")
    assert {pair["SAFE_STOP"] for pair in after(drive, 1.0)} == {0}
    assert drive.loop.details().implausible["jumped"] == 1


def test_a_position_that_stays_where_it_jumped_to_stops_the_vehicle_and_ends_in_silence() -> None:
    drive = cruising()
    drive.send_line("jump 4.0 0.0")
    drive.run_s(0.06)
    assert has(drive.last(), enable=1, stop=1, reason=Reason.STATE_INVALID)
    drive.run_s(0.6)
    assert (drive.mode(), drive.loop.reason) == (Mode.SILENT, Reason.STATE_STALE)
    drive.run_s(1.0)
    assert drive.loop.details().implausible["jumped"] == pytest.approx(100, abs=2)  # then it is believed


def test_frozen_values_with_running_counters_stop_a_moving_vehicle() -> None:
    drive = cruising()
    drive.send_line("freeze on")
    took_s = drive.run_until(lambda: drive.last()["SAFE_STOP"], 1.0)
    assert took_s < 0.25
    assert has(drive.last(), enable=1, stop=1, reason=Reason.STATE_INVALID)
    drive.run_s(0.6)
    assert drive.mode() is Mode.SILENT


def test_a_vehicle_that_drops_out_with_implausible_samples_is_released() -> None:
    drive = cruising()
    drive.send_line("jump 4.0 0.0")
    drive.send_line("brake 1")
    drive.run_s(0.2)
    assert drive.mode() is Mode.OVERRIDDEN
    assert has(drive.last(), enable=0, stop=0, reason=Reason.DRIVER_OVERRIDE)


def test_samples_that_could_not_be_true_and_then_stop_coming_are_stale_and_then_there_is_silence() -> None:
    drive = cruising()
    drive.send_line("jump 4.0 0.0")
    drive.run_s(0.06)
    drive.send_line("mute STATE on")
    drive.run_s(0.07)
    assert has(drive.last(), enable=1, stop=1, reason=Reason.STATE_STALE)
    drive.run_s(0.5)
    assert drive.mode() is Mode.SILENT
    assert drive.loop.reason is Reason.STATE_STALE


def test_a_loop_that_does_not_drive_answers_implausible_samples_only_while_they_come() -> None:
    drive = Drive(mode=VehicleMode.MANUAL)
    drive.run_s(1.0)
    drive.send_line("jump 4.0 0.0")
    drive.run_s(0.5)
    assert len(after(drive, 0.2)) == pytest.approx(20, abs=1)
    drive.send_line("mute STATE on")
    drive.run_s(0.07)
    since = len(drive.sent)
    drive.run_s(1.0)
    assert drive.pairs(since) == []


def test_a_vehicle_that_stands_is_not_frozen() -> None:
    drive = Drive(FixedTrajectory(straight(speed_mps=5.0, time_s=1e6)))
    drive.vehicle._car._target_mps2 = lambda *_: 0.0  # type: ignore[method-assign]  # an engine that does nothing
    drive.run_s(20.0)
    assert not any(drive.loop.details().implausible.values())


# Deviation


def test_a_vehicle_that_was_set_beside_its_path_is_stopped_until_there_is_a_new_trajectory() -> None:
    drive = Drive(start=BicycleState(y_m=3.2)).engage()
    drive.run_s(0.5)
    assert has(drive.last(), enable=1, stop=1, reason=Reason.DEVIATION)
    drive.controller.set_trajectory(straight())
    drive.run_s(0.1)
    assert has(drive.last(), enable=1, stop=1, reason=Reason.DEVIATION)
    assert drive.loop.details().deviations["off the path"] > 10


def test_a_deviation_holds_until_standstill_however_often_the_path_is_replanned() -> None:
    mailbox = Mailbox()
    drive = Drive(mailbox, start=BicycleState(speed_mps=21.5), gear=Gear.DRIVE)
    mailbox.put(straight(time_s=1e4))
    drive.engage()
    sent: list[tuple[float, Pair]] = []
    for _ in range(100):
        since = len(drive.sent)
        mailbox.put(replace_stamp(straight(time_s=1e4), drive))
        drive.run_s(0.1)
        sent += [(drive.state.speed_mps, pair) for pair in drive.pairs(since)]
    moving = [pair for speed_mps, pair in sent if speed_mps > 0.2]
    held = next(k for k, pair in enumerate(moving) if pair["REASON"] == Reason.DEVIATION)
    stopped = [pair for pair in moving[held:] if has(pair, enable=1, stop=1, reason=Reason.DEVIATION)]
    assert len(stopped) > 600
    assert has(drive.last(), enable=1, stop=0, reason=Reason.NOMINAL)  # from standstill it is driven on


class OnceMore:
    """A path beside the vehicle, and after the engagement one that it is on."""

    def __init__(self) -> None:
        self.paths = [straight(time_s=1e4)]

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:
        del now_ns
        return replace(self.paths.pop(), stamp_ns=state.stamp_ns) if self.paths else None

    def restart(self) -> None:
        path = straight(time_s=1e4)
        self.paths = [replace(path, y_m=np.full(len(path), 3.5))]


def test_a_deviation_before_the_drive_does_not_stop_the_vehicle() -> None:
    drive = Drive(OnceMore(), start=BicycleState(speed_mps=4.0, y_m=3.5), gear=Gear.DRIVE).engage()
    assert drive.loop.details().deviations["off the path"] > 10
    assert {pair["SAFE_STOP"] for pair in after(drive, 1.0)} == {0}
    assert drive.vehicle.state.speed_mps > 3.5


def test_a_little_beside_its_path_is_counted_and_driven_back() -> None:
    drive = Drive(start=BicycleState(y_m=1.2)).engage()
    assert {pair["SAFE_STOP"] for pair in after(drive, 8.0)} == {0}
    assert drive.loop.details().deviations["beside the path"] > 10
    assert abs(drive.state.y_m) < 0.1


def test_a_path_that_begins_300_m_ahead_is_not_driven_to() -> None:
    path = straight(length_m=100.0)
    drive = Drive(FixedTrajectory(replace(path, x_m=path.x_m + 300.0))).engage()
    pairs = after(drive, 8.0)
    assert all(has(pair, enable=1, stop=1, reason=Reason.DEVIATION) for pair in pairs)
    assert len(pairs) > 700
    assert drive.vehicle.state.x_m == 0.0
    assert drive.loop.details().deviations["off the path"] > 700


def closed_lap() -> Trajectory:
    """Once round a circle of 15 m from the origin, at 4 m/s."""
    turned_rad = np.linspace(0.0, math.tau, 201)
    return Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.rint(turned_rad * 15.0 / 4.0 * 1e9).astype(np.int64),
        x_m=15.0 * np.sin(turned_rad),
        y_m=15.0 - 15.0 * np.cos(turned_rad),
        heading_rad=turned_rad,
        speed_mps=np.full(201, 4.0),
    )


def part_of_the_way_round(part: float) -> BicycleState:
    """Standing on the closed lap."""
    turned_rad = part * math.tau
    x_m, y_m = 15.0 * math.sin(turned_rad), 15.0 - 15.0 * math.cos(turned_rad)
    return BicycleState(x_m=x_m, y_m=y_m, heading_rad=math.remainder(turned_rad, math.tau))


@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 0.55, 0.75, 0.9])
def test_a_vehicle_that_stands_anywhere_on_a_closed_lap_is_on_its_path(part: float) -> None:
    drive = Drive(FixedTrajectory(closed_lap()), start=part_of_the_way_round(part)).engage()
    assert {pair["SAFE_STOP"] for pair in after(drive, 1.0)} == {0}
    assert not any(drive.loop.details().deviations.values())
    assert drive.vehicle.state.speed_mps > 0.3


def test_from_half_round_a_closed_lap_the_other_half_is_driven() -> None:
    drive = Drive(FixedTrajectory(closed_lap()), start=part_of_the_way_round(0.5)).engage()
    for _ in range(12):
        assert {pair["SAFE_STOP"] for pair in after(drive, 1.0)} == {0}
        assert math.hypot(drive.state.x_m, drive.state.y_m - 15.0) == pytest.approx(15.0, abs=0.3)
    assert not any(drive.loop.details().deviations.values())
    assert drive.state.x_m > -3.0


def test_a_controller_that_cuts_across_a_closed_lap_is_stopped_when_it_is_3_m_off() -> None:
    """From three quarters round it aims at the first point: the index is still 0, as the contract has it."""
    drive = Drive(FixedTrajectory(closed_lap()), start=part_of_the_way_round(0.75)).engage()
    drive.run_until(lambda: has(drive.last(), enable=1, stop=1, reason=Reason.DEVIATION), 10.0)
    assert math.hypot(drive.state.x_m, drive.state.y_m - 15.0) == pytest.approx(12.0, abs=0.1)


# Trajectories


def test_a_rejected_trajectory_leaves_the_old_one_in_force() -> None:
    mailbox, controller = Mailbox(), Moody()
    drive = Drive(mailbox, controller=controller)
    drive.run_s(0.1)
    mailbox.put(replace_stamp(straight(time_s=1e4), drive))
    drive.engage(3.0)
    kept, index = controller.trajectory, controller.spatial_index
    mailbox.put(replace_stamp(straight(length_m=1.0), drive))
    assert all(has(pair, enable=1, stop=0, reason=Reason.NOMINAL) for pair in after(drive, 0.5))
    assert controller.trajectory is kept
    assert controller.spatial_index >= index
    assert drive.loop.details().loop["trajectories_rejected"] == 1


@pytest.mark.parametrize("hook", ["check_new_trajectory", "handle_new_trajectory"])
@pytest.mark.parametrize("error", [ValueError("mistake"), KeyError(3), ZeroDivisionError()])
def test_a_hook_that_raises_leaves_the_old_trajectory_in_force(
    hook: str, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    mailbox, controller = Mailbox(), Moody()
    drive = Drive(mailbox, controller=controller)
    drive.run_s(0.1)
    mailbox.put(replace_stamp(straight(time_s=1e4), drive))
    drive.engage(3.0)
    kept = controller.trajectory

    def fail(_: Trajectory) -> None:
        raise error

    monkeypatch.setattr(controller, hook, fail)
    mailbox.put(replace_stamp(straight(time_s=1e4), drive))
    assert all(has(pair, enable=1, stop=0, reason=Reason.NOMINAL) for pair in after(drive, 0.5))
    assert controller.trajectory is kept
    assert drive.loop.details().loop["trajectories_rejected"] == 1


def test_a_trajectory_put_by_another_thread_is_taken_at_the_next_pass() -> None:
    mailbox = Mailbox()
    drive = Drive(mailbox)
    drive.engage()
    assert has(drive.last(), enable=1, stop=1, reason=Reason.NO_TRAJECTORY)
    new = replace_stamp(straight(time_s=1e4), drive)
    thread = threading.Thread(target=mailbox.put, args=(new,))
    thread.start()
    thread.join()
    drive.run_s(0.01)
    assert drive.controller.trajectory is new
    drive.run_s(reference().profile.recovery.trajectory_s + 0.01)
    assert has(drive.last(), enable=1, stop=0, reason=Reason.NOMINAL)


def test_ten_new_trajectories_a_second_make_no_command_late_and_the_index_is_found_again() -> None:
    mailbox = Mailbox()
    drive = Drive(mailbox)
    drive.run_s(0.1)
    mailbox.put(replace_stamp(straight(time_s=1e4), drive))
    drive.engage(3.0)
    since = len(drive.sent)
    for _ in range(30):
        mailbox.put(replace_stamp(straight(time_s=1e4), drive))
        drive.run_s(0.1)
        assert drive.controller.spatial_index == math.floor(drive.state.x_m)  # its points are 1 m apart
    pairs = drive.pairs(since)
    assert len(pairs) == 300
    assert drive.state.x_m > 15.0
    assert all(has(pair, enable=1, stop=0, reason=Reason.NOMINAL) for pair in pairs)


def lap_that_steps_back() -> Trajectory:
    """A lap of radius 15 m whose point 60 lies 5 mm behind point 59."""
    lap = closed_lap()
    turned_rad = lap.heading_rad.copy()
    turned_rad[60] = turned_rad[59] - 0.005 / 15.0
    return replace(lap, x_m=15.0 * np.sin(turned_rad), y_m=15.0 - 15.0 * np.cos(turned_rad))


def recorded_from_standstill() -> Trajectory:
    """5 s of standstill, measured with 2 cm of noise, and then 60 m straight ahead."""
    dice, away_m = np.random.default_rng(10), np.arange(1, 601) * 0.1
    noise_m = dice.uniform(-0.02, 0.02, (2, 101))
    return Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.append(np.arange(101) * 50_000_000, 5_000_000_000 + np.arange(1, 601) * 50_000_000),
        x_m=np.append(noise_m[0], away_m),
        y_m=np.append(noise_m[1], np.zeros(600)),
        heading_rad=np.zeros(701),
        speed_mps=np.append(np.zeros(101), np.minimum(np.sqrt(2.0 * away_m), 5.0)),
    )


@pytest.mark.parametrize("recorded", [lap_that_steps_back, recorded_from_standstill])
def test_a_file_with_steps_back_is_driven_to_its_end(recorded: Callable[[], Trajectory], tmp_path: Path) -> None:
    path = recorded()
    save_csv(tmp_path / "path.csv", path)
    cleaned = drivable.load_trajectory(str(tmp_path / "path.csv"), reference().profile)
    drive = Drive(FixedTrajectory(cleaned)).engage()
    pairs = after(drive, s_from_ns(int(path.time_from_start_ns[-1])) + 1.0)
    reasons = list(dict.fromkeys(pair["REASON"] for pair in pairs))
    assert reasons[0] == Reason.NOMINAL
    assert set(reasons[1:]) <= {Reason.PAST_END_SPACE, Reason.PAST_END_TIME}
    assert len(reasons) > 1
    assert drive.controller.spatial_index > 0.85 * len(cleaned)
    assert not any(drive.loop.details().deviations.values())


def test_without_cleaning_a_trajectory_that_steps_back_is_refused_by_the_loop() -> None:
    drive = Drive(FixedTrajectory(lap_that_steps_back()))
    drive.run_s(1.0)
    assert drive.controller.trajectory is None
    assert drive.loop.details().loop["trajectories_rejected"] >= 1


# Telemetry


def test_telemetry_makes_no_difference_to_the_frames(tmp_path: Path) -> None:
    def driven(telemetry: TelemetryWriter | None) -> list[tuple[int, bytes]]:
        drive = Drive(RecedingRoute(make_route("figure8")), telemetry=telemetry, start=start_of("figure8"))
        drive.run_s(3.0)
        drive.send_line("pose_valid 0")
        drive.run_s(1.0)
        return [(sent.at_ns, sent.frame.data) for sent in drive.sent]

    info = SessionInfo(
        channel="test",
        bus="test",
        bus_hint="",
        profile="reference",
        route="figure8",
        arming="armed",
        period_s=0.01,
        shape=compose.vehicle_shape(reference().profile),
        limits=compose.driving_limits(reference().profile),
    )
    with TelemetryWriter(str(tmp_path / "telemetry"), info) as writer:
        with_telemetry = driven(writer)
    assert with_telemetry == driven(None)


# Routes, and the sign of a turn


def start_of(route: str) -> BicycleState:
    x_m, y_m, heading_rad = make_route(route).start
    return BicycleState(x_m=x_m, y_m=y_m, heading_rad=heading_rad)


@pytest.mark.parametrize(("name", "lateral_m"), [(name, 0.2 if name == "figure8" else 0.3) for name in sorted(ROUTES)])
def test_every_route_is_driven_close_to_its_line(name: str, lateral_m: float) -> None:
    route = make_route(name)
    source = RecedingRoute(route)
    drive = Drive(source, start=start_of(name))
    worst_m = 0.0
    while drive.now_s < 60.0 and not (source.finished and drive.vehicle.state.speed_mps == 0.0):
        drive.step()
        state = drive.vehicle.state
        i = int(((route.x_m - state.x_m) ** 2 + (route.y_m - state.y_m) ** 2).argmin())
        heading = float(route.heading_rad[i])
        dx_m, dy_m = state.x_m - float(route.x_m[i]), state.y_m - float(route.y_m[i])
        worst_m = max(worst_m, abs(math.cos(heading) * dy_m - math.sin(heading) * dx_m))
    assert worst_m < lateral_m
    assert drive.mode() is Mode.ENGAGED
    assert source.finished or route.closed
    assert source.laps >= (1 if route.closed else 0)
    assert counters_step_by_one(drive.sent)
    assert drive.vehicle.counters["gear_refusals"] == 0


def test_a_left_turn_is_positive_in_every_layer() -> None:
    drive = Drive(RecedingRoute(make_route("circle")), start=start_of("circle"))
    heading_before = drive.vehicle.state.heading_rad
    drive.engage(3.0)
    drive.run_s(0.5)
    steer = drive.last().steer
    assert 0 < int.from_bytes(steer.frame.data[2:4], "little") < 6000  # the request's bytes, 0.0001 rad each
    assert drive.loop._cycle.last is not None
    assert drive.loop._cycle.last.requested.front_wheel_angle_rad > 0.0
    assert drive.loop._cycle.last.permitted.front_wheel_angle_rad > 0.0
    assert drive.vehicle.state.front_wheel_angle_rad > 0.0
    assert drive.vehicle.state.yaw_rate_radps > 0.0
    assert drive.vehicle.state.heading_rad > heading_before
    assert drive.state.front_wheel_angle_rad > 0.0
    assert drive.state.yaw_rate_radps > 0.0
    trajectory = drive.controller.trajectory
    assert trajectory is not None
    assert trajectory.yaw_rate_radps.min() > 0.0
    assert trajectory.front_wheel_angle_rad.min() > 0.0
    assert np.all(np.diff(trajectory.heading_rad) > 0.0)
    reference_point = point_at(trajectory, 0)
    left = (-math.sin(reference_point.heading_rad), math.cos(reference_point.heading_rad))
    inside = replace(drive.state, x_m=reference_point.x_m + left[0], y_m=reference_point.y_m + left[1])
    assert tracking_error(inside, reference_point).lateral_m == pytest.approx(1.0)


def test_beside_the_line_it_steers_back_towards_it() -> None:
    for y_m in (1.0, -1.0):
        drive = Drive(start=BicycleState(y_m=y_m)).engage(1.0)
        assert drive.last()["FRONT_WHEEL_ANGLE_REQUEST"] * y_m < 0.0
        error = tracking_error(drive.state, point_at(straight(), 0))
        assert error.lateral_m * y_m > 0.0
