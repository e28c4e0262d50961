"""The vehicle on its bus, by its frames alone: the contract's page, as an independent peer observes it."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vehicle_bus_contract.reference import (
    AUTONOMOUS,
    CONTROLLER_SENDS,
    DRIVE,
    EMERGENCY_STOP,
    FAULT,
    LAYOUT,
    MANUAL,
    NO_REQUEST,
    PARK,
    READY,
    REVERSE,
    SAMPLE,
    checksum,
)

from tests.contract_frames import pack
from tests.narrowing import at_present
from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.status import Gear, VehicleMode

from .harness import MS, START_NS, VehicleHarness


@pytest.fixture
def harness() -> VehicleHarness:
    return VehicleHarness()


@pytest.fixture
def engaged() -> VehicleHarness:
    """AUTONOMOUS, in DRIVE, at standstill."""
    harness = VehicleHarness()
    harness.engage()
    return harness


def cruising(speed_mps: float, **more: float) -> VehicleHarness:
    """AUTONOMOUS at that speed."""
    harness = VehicleHarness(
        BicycleState(speed_mps=speed_mps, **more), gear=Gear.DRIVE if speed_mps >= 0 else Gear.REVERSE
    )
    harness.command_for_ms(30)
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS
    return harness


# What is on the bus


def test_the_contracts_worked_example_is_what_this_test_computes() -> None:
    assert checksum(0x100, bytes([0, 2, 0, 0, 0, 0, 0, 0])) == 0xE5
    assert checksum(0x100, bytes([0, 1, 0, 0, 0, 0, 0, 0])) == 0x02


def test_every_frame_is_intact_and_of_eight_bytes(harness: VehicleHarness) -> None:
    harness.wait_ms(1000)
    assert len(harness.decoded) == 101 * 3 + 51
    assert all(harness.are_intact())
    assert all(len(frame.data) == 8 for frame in harness.frames)
    assert not any(frame.is_extended or frame.is_fd or frame.is_remote for frame in harness.frames)


def test_the_three_messages_of_a_sample_carry_one_counter(harness: VehicleHarness) -> None:
    for _ in range(50):
        counters = {decoded.counter for decoded in harness.tick() if decoded.name in SAMPLE}
        assert len(counters) == 1
        harness.now_ns += 10 * MS


@pytest.mark.parametrize("name", [*SAMPLE, "VEHICLE_STATUS"])
def test_each_counter_steps_once_per_frame_from_0_to_14_and_round(harness: VehicleHarness, name: str) -> None:
    harness.wait_ms(1000)
    counters = [decoded.counter for decoded in harness.decoded if decoded.name == name]
    first = counters[0]
    assert counters == [(first + i) % 15 for i in range(len(counters))]


def test_samples_come_every_10_ms_and_the_status_every_20(harness: VehicleHarness) -> None:
    names = []
    for _ in range(4):
        names.append([decoded.name for decoded in harness.tick()])
        harness.now_ns += 10 * MS
    with_status = ["VEHICLE_STATUS", *SAMPLE]
    assert names == [with_status, list(SAMPLE), with_status, list(SAMPLE)]


def test_it_starts_ready_in_park_at_standstill_with_a_valid_pose_in_map() -> None:
    harness = VehicleHarness(BicycleState(x_m=12.5, y_m=-3.25, heading_rad=1.5))
    harness.tick()
    status, pose = harness.last("VEHICLE_STATUS"), harness.last("POSE")
    assert (status["MODE"], status["GEAR"], status["FAULT_CODE"]) == (READY, PARK, 0)
    assert (pose["POSE_FRAME"], pose["POSE_VALID"]) == (1, 1)
    assert (pose["POS_X"], pose["POS_Y"]) == pytest.approx((12.5, -3.25))
    assert harness.last("MOTION")["HEADING"] == pytest.approx(1.5)
    assert harness.last("MOTION")["SPEED"] == 0


def test_a_left_turn_is_positive_in_every_signal_that_turns(engaged: VehicleHarness) -> None:
    engaged.command_for_ms(2000, ACCEL_REQUEST=1.0, angle_rad=0.2)
    assert engaged.last("MOTION")["HEADING"] > 0.1
    assert engaged.last("MOTION")["YAW_RATE"] > 0.1
    assert engaged.last("CHASSIS")["FRONT_WHEEL_ANGLE"] == pytest.approx(0.2)
    assert engaged.last("POSE")["POS_Y"] > 0.1
    engaged.send_line("steer 2.0")
    engaged.command_for_ms(20)
    assert engaged.last("VEHICLE_STATUS")["DRIVER_STEER_TORQUE"] == pytest.approx(2.0)


def test_the_reports_on_the_bus_agree_with_the_motion() -> None:
    harness = cruising(-3.0, front_wheel_angle_rad=0.3)
    harness.command_for_ms(1000, angle_rad=0.3, ACCEL_REQUEST=-0.5)
    harness.tick()
    state = harness.vehicle.state
    motion, chassis, pose = harness.last("MOTION"), harness.last("CHASSIS"), harness.last("POSE")
    assert pose["POS_X"] == pytest.approx(state.x_m, abs=0.0026)
    assert pose["POS_Y"] == pytest.approx(state.y_m, abs=0.0026)
    assert motion["HEADING"] == pytest.approx(state.heading_rad, abs=0.00006)
    assert motion["SPEED"] == pytest.approx(state.speed_mps, abs=0.0026)
    assert motion["YAW_RATE"] == pytest.approx(state.yaw_rate_radps, abs=0.00011)
    assert chassis["ACCEL"] == pytest.approx(-0.5, abs=0.002)
    assert chassis["LATERAL_SPEED"] == 0
    assert motion["SPEED"] < -3.0
    assert motion["YAW_RATE"] < 0.0


def test_the_heading_on_the_bus_is_wrapped() -> None:
    harness = cruising(5.0, heading_rad=3.1)
    harness.command_for_ms(2000, angle_rad=0.3)
    headings = [decoded["HEADING"] for decoded in harness.decoded if decoded.name == "MOTION"]
    assert min(headings) < -2.5
    assert all(abs(heading) <= math.pi + 1e-4 for heading in headings)


def test_the_pose_can_be_in_odom_or_invalid(harness: VehicleHarness) -> None:
    assert harness.send_line("frame ODOM") == "ok"
    assert harness.send_line("pose_valid 0") == "ok"
    harness.tick()
    assert harness.last("POSE")["POSE_FRAME"] == 0
    assert harness.last("POSE")["POSE_VALID"] == 0


def test_a_start_in_a_frame_without_a_number_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="odom, map"):
        VehicleHarness(frame_id="utm")


def test_a_sensor_at_its_end_keeps_its_last_value_and_its_counter() -> None:
    harness = VehicleHarness(BicycleState(speed_mps=39.0), gear=Gear.DRIVE)
    harness.command_for_ms(2000, angle_rad=0.7)
    assert abs(harness.vehicle.state.yaw_rate_radps) > 6.6
    assert 6.0 < harness.last("MOTION")["YAW_RATE"] <= 6.5534
    assert all(harness.are_intact())
    assert harness.last("MOTION").counter == harness.last("POSE").counter


# Engagement


def test_two_pairs_do_not_engage_and_the_third_does(harness: VehicleHarness) -> None:
    for _ in range(2):
        harness.pair()
        harness.wait_ms(10)
    harness.drive()
    assert at_present(harness.vehicle.mode) is VehicleMode.READY
    harness.steer()
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS
    harness.wait_ms(20)
    assert harness.last("VEHICLE_STATUS")["MODE"] == AUTONOMOUS


def test_steer_before_drive_is_a_pair_too(harness: VehicleHarness) -> None:
    for _ in range(3):
        harness.steer()
        harness.drive()
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS


@pytest.mark.parametrize("kind", ["drive", "steer"])
def test_commands_of_one_kind_alone_never_engage(harness: VehicleHarness, kind: str) -> None:
    for _ in range(50):
        getattr(harness, kind)()
        harness.wait_ms(10)
    assert harness.vehicle.mode is VehicleMode.READY


def broken_crc(harness: VehicleHarness) -> None:
    harness.steer_counter = (harness.steer_counter + 1) % 15
    frame = pack("STEER_COMMAND", harness.steer_counter, ENABLE=1)
    harness.receive(frame._replace(data=bytes([frame.data[0] ^ 1]) + frame.data[1:]))


def repeated_counter(harness: VehicleHarness) -> None:
    harness.receive(pack("STEER_COMMAND", harness.steer_counter, ENABLE=1))


def jumping_counter(harness: VehicleHarness) -> None:
    harness.steer_counter = (harness.steer_counter + 4) % 15
    harness.receive(pack("STEER_COMMAND", harness.steer_counter, ENABLE=1))


def missing_partner(harness: VehicleHarness) -> None:
    harness.drive()
    harness.drive()
    harness.steer()


def let_go(harness: VehicleHarness) -> None:
    harness.pair(enable=0)


def other_id(harness: VehicleHarness) -> None:
    frame = pack("DRIVE_COMMAND", (harness.steer_counter + 1) % 15, ENABLE=1)
    harness.receive(CanFrame(0x081, frame.data))


def long_gap(harness: VehicleHarness) -> None:
    harness.wait_ms(101)


@pytest.mark.parametrize(
    ("interruption", "needed"),
    [
        (broken_crc, 3),
        (repeated_counter, 3),
        (jumping_counter, 3),
        (missing_partner, 2),
        (let_go, 3),
        (other_id, 3),
        (long_gap, 3),
    ],
)
def test_pairs_must_be_consecutive_intact_and_enabled(
    harness: VehicleHarness, interruption: Callable[[VehicleHarness], None], needed: int
) -> None:
    harness.pair()
    harness.pair()
    interruption(harness)
    for _ in range(needed - 1):
        harness.pair()
    assert at_present(harness.vehicle.mode) is VehicleMode.READY
    harness.pair()
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS


@pytest.mark.parametrize("step", [1, 2, 3])
def test_a_counter_that_advances_by_one_to_three_is_intact(harness: VehicleHarness, step: int) -> None:
    for _ in range(3):
        harness.drive_counter += step - 1
        harness.steer_counter += step - 1
        harness.pair()
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS


@pytest.mark.parametrize(
    "frame",
    [
        CanFrame(0x123, b"\x00" * 8),
        CanFrame(0x080, b""),
        CanFrame(0x080, b"\x01\x02\x03"),
        CanFrame(0x080, b"", is_remote=True),
        CanFrame(0x080, bytes(12), is_fd=True),
        CanFrame(0x080, bytes(8), is_extended=True),
        CanFrame(0x080, bytes(8), is_error=True),
        CanFrame(0x110, bytes(8)),
    ],
)
def test_frames_that_are_no_command_do_nothing(engaged: VehicleHarness, frame: CanFrame) -> None:
    before = engaged.vehicle.next_due_ns
    engaged.receive(frame)
    assert engaged.vehicle.mode is VehicleMode.AUTONOMOUS
    assert engaged.vehicle.next_due_ns == before


@given(can_id=st.sampled_from([0x080, 0x081, 0x082, 0x100]), data=st.binary(max_size=8))
@settings(max_examples=200, deadline=None)
def test_no_frame_makes_it_raise(can_id: int, data: bytes) -> None:
    _fuzzed.receive(CanFrame(can_id, data))
    _fuzzed.wait_ms(1)


_fuzzed = VehicleHarness()


def test_foreign_frames_between_pairs_do_not_break_the_row(harness: VehicleHarness) -> None:
    for _ in range(3):
        harness.drive()
        harness.receive(CanFrame(0x123, b"\x00"))
        harness.steer()
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS


def test_only_frames_that_the_profile_does_not_have_are_counted_as_others(harness: VehicleHarness) -> None:
    for can_id in (0x082, 0x180, 0x100, 0x110):  # lights, the controller's report, another vehicle's status and pose
        harness.receive(CanFrame(can_id, bytes(8)))
    assert harness.vehicle.counters["other"] == 0
    harness.receive(CanFrame(0x123, bytes(8)))
    harness.receive(CanFrame(0x082, bytes(8), is_extended=True))
    assert harness.vehicle.counters["other"] == 2


@pytest.mark.parametrize("mode", [m for m in VehicleMode if m is not VehicleMode.READY])
def test_only_a_ready_vehicle_engages(mode: VehicleMode) -> None:
    harness = VehicleHarness(mode=mode)
    for _ in range(20):
        harness.pair()
    assert harness.vehicle.mode is mode


def test_pairs_from_before_ready_do_not_count() -> None:
    harness = VehicleHarness(mode=VehicleMode.MANUAL)
    for _ in range(5):
        harness.pair()
    assert harness.send_line("ready") == "ok"
    for mode in (VehicleMode.READY, VehicleMode.READY, VehicleMode.AUTONOMOUS):
        harness.pair()
        assert harness.vehicle.mode is mode


@pytest.mark.parametrize("kind", ["drive", "steer"])
def test_enable_0_in_either_command_releases_to_ready(engaged: VehicleHarness, kind: str) -> None:
    getattr(engaged, kind)(ENABLE=0)
    assert engaged.vehicle.mode is VehicleMode.READY
    engaged.wait_ms(20)
    assert engaged.last("VEHICLE_STATUS")["MODE"] == READY


def test_a_released_vehicle_rolls_on() -> None:
    harness = cruising(5.0)
    harness.pair(enable=0)
    harness.wait_ms(2000)
    assert harness.last("MOTION")["SPEED"] == pytest.approx(4.8, abs=0.02)


# The driver


@pytest.mark.parametrize("line", ["brake 1", "throttle 1", "steer 3.0", "steer -3.0", "steer 2.96"])
def test_the_driver_takes_over_at_once(engaged: VehicleHarness, line: str) -> None:
    assert engaged.send_line(line) == "ok"
    assert engaged.vehicle.mode is VehicleMode.MANUAL
    engaged.wait_ms(20)
    assert engaged.last("VEHICLE_STATUS")["MODE"] == MANUAL


@pytest.mark.parametrize("line", ["steer 2.9", "steer -2.9", "steer 0", "brake 0", "throttle 0"])
def test_a_hand_at_rest_on_the_wheel_does_not(engaged: VehicleHarness, line: str) -> None:
    assert engaged.send_line(line) == "ok"
    engaged.command_for_ms(40)
    assert engaged.vehicle.mode is VehicleMode.AUTONOMOUS


def test_the_driver_is_on_the_bus(harness: VehicleHarness) -> None:
    for line in ("brake 1", "throttle 1", "steer -4.2"):
        harness.send_line(line)
    harness.tick()
    status = harness.last("VEHICLE_STATUS")
    assert (status["DRIVER_BRAKE"], status["DRIVER_THROTTLE"]) == (1, 1)
    assert status["DRIVER_STEER_TORQUE"] == pytest.approx(-4.2)


@pytest.mark.parametrize(("line", "end"), [("brake 1", "brake 0"), ("steer 5", "steer 0")])
def test_it_does_not_engage_against_a_driver(harness: VehicleHarness, line: str, end: str) -> None:
    harness.send_line(line)
    harness.command_for_ms(200)
    assert at_present(harness.vehicle.mode) is VehicleMode.READY
    harness.send_line(end)
    harness.command_for_ms(20)
    assert at_present(harness.vehicle.mode) is VehicleMode.READY
    harness.command_for_ms(10)
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS


def test_after_an_override_it_stays_manual_until_it_is_made_ready(engaged: VehicleHarness) -> None:
    engaged.send_line("brake 1")
    assert engaged.send_line("ready").startswith("error: ready: only from MANUAL with feet and hands off")
    engaged.send_line("brake 0")
    engaged.command_for_ms(500)
    assert at_present(engaged.vehicle.mode) is VehicleMode.MANUAL
    assert engaged.send_line("ready") == "ok"
    engaged.command_for_ms(30)
    assert engaged.vehicle.mode is VehicleMode.AUTONOMOUS


def test_the_drivers_brake_stops_it_and_holds() -> None:
    harness = cruising(5.0)
    harness.send_line("brake 1")
    harness.wait_ms(2000)
    assert harness.last("MOTION")["SPEED"] == 0
    assert harness.last("CHASSIS")["ACCEL"] == 0


def test_the_driver_can_drive_by_hand() -> None:
    harness = VehicleHarness(mode=VehicleMode.MANUAL)
    harness.send_line("gear REVERSE")
    harness.send_line("throttle 1")
    harness.send_line("steer 5")
    harness.wait_ms(2000)
    assert harness.last("MOTION")["SPEED"] < -1.0
    assert harness.last("CHASSIS")["FRONT_WHEEL_ANGLE"] > 0.0


# The watchdog


@pytest.mark.parametrize(("age_ms", "mode"), [(99, AUTONOMOUS), (100, FAULT), (101, FAULT)])
def test_the_watchdog_bites_after_100_ms(engaged: VehicleHarness, age_ms: int, mode: int) -> None:
    engaged.pair()
    engaged.wait_ms(age_ms)
    assert engaged.vehicle.mode == mode


@pytest.mark.parametrize(("age_ms", "mode"), [(99, AUTONOMOUS), (100, FAULT), (101, FAULT)])
def test_a_command_that_comes_too_late_does_not_save_it(engaged: VehicleHarness, age_ms: int, mode: int) -> None:
    engaged.pair()
    engaged.now_ns += age_ms * MS  # the vehicle had no turn in between
    engaged.pair()
    assert engaged.vehicle.mode == mode


@pytest.mark.parametrize("kind", ["drive", "steer"])
def test_each_kind_of_command_must_stay_fresh_by_itself(engaged: VehicleHarness, kind: str) -> None:
    for _ in range(8):  # the last pair is 10 ms old
        getattr(engaged, kind)()
        engaged.wait_ms(10)
    assert at_present(engaged.vehicle.mode) is VehicleMode.AUTONOMOUS
    getattr(engaged, kind)()
    engaged.wait_ms(10)
    assert engaged.vehicle.mode is VehicleMode.FAULT


@pytest.mark.parametrize("damage", [broken_crc, repeated_counter, jumping_counter, other_id])
def test_damaged_commands_do_not_feed_the_watchdog(
    engaged: VehicleHarness, damage: Callable[[VehicleHarness], None]
) -> None:
    for _ in range(12):
        engaged.drive()
        damage(engaged)
        engaged.wait_ms(10)
    assert engaged.vehicle.mode is VehicleMode.FAULT


def test_a_late_vehicle_does_not_lose_its_commander(engaged: VehicleHarness) -> None:
    engaged.pair()
    frames = []
    for i in range(1, 31):  # 300 ms during which commands wait in its queue, stamped when they came
        engaged.drive_counter, engaged.steer_counter = engaged.drive_counter + 1, engaged.steer_counter + 1
        stamp_ns = engaged.now_ns + 10 * i * MS
        frames.append(pack("DRIVE_COMMAND", engaged.drive_counter % 15, ENABLE=1)._replace(stamp_ns=stamp_ns))
        frames.append(pack("STEER_COMMAND", engaged.steer_counter % 15, ENABLE=1)._replace(stamp_ns=stamp_ns))
    engaged.now_ns += 300 * MS
    for frame in frames:
        engaged.vehicle.receive(frame, engaged.now_ns)
    engaged.tick()
    assert engaged.vehicle.mode is VehicleMode.AUTONOMOUS


def test_after_the_watchdog_it_brakes_at_3_to_standstill_with_wheels_straight() -> None:
    harness = cruising(6.0)
    harness.command_for_ms(1000, angle_rad=0.3)
    harness.wait_ms(100)
    harness.wait_ms(1000)
    assert harness.last("VEHICLE_STATUS")["MODE"] == FAULT
    assert harness.last("VEHICLE_STATUS")["FAULT_CODE"] != 0
    assert harness.last("CHASSIS")["ACCEL"] == pytest.approx(-3.0, abs=0.01)
    assert harness.last("CHASSIS")["FRONT_WHEEL_ANGLE"] == pytest.approx(0.0, abs=0.001)
    harness.wait_ms(2000)
    assert harness.last("MOTION")["SPEED"] == 0
    assert harness.last("CHASSIS")["ACCEL"] == 0


def test_it_brakes_to_standstill_backwards_too() -> None:
    harness = cruising(-3.0)
    harness.wait_ms(600)
    assert harness.last("CHASSIS")["ACCEL"] == pytest.approx(3.0, abs=0.05)
    harness.wait_ms(2000)
    assert harness.last("MOTION")["SPEED"] == 0


@pytest.mark.parametrize(("line", "mode", "code"), [("fault 7", FAULT, 7), ("emergency_stop", EMERGENCY_STOP, 0)])
def test_a_fault_is_left_by_the_drivers_reset_only(line: str, mode: int, code: int) -> None:
    harness = cruising(3.0)
    assert harness.send_line(line) == "ok"
    harness.command_for_ms(3000)
    assert harness.send_line("ready").startswith("error")
    harness.send_line("brake 1")
    harness.send_line("brake 0")
    harness.wait_ms(20)
    status = harness.last("VEHICLE_STATUS")
    assert (status["MODE"], status["FAULT_CODE"]) == (mode, code)
    assert harness.last("MOTION")["SPEED"] == 0
    assert harness.send_line("reset") == "ok"
    harness.wait_ms(20)
    status = harness.last("VEHICLE_STATUS")
    assert (status["MODE"], status["FAULT_CODE"]) == (MANUAL, 0)
    assert harness.send_line("reset").startswith("error: reset: only from FAULT or EMERGENCY_STOP")


def test_the_watchdog_is_inactive_without_a_commander(harness: VehicleHarness) -> None:
    harness.pair()
    harness.wait_ms(1000)
    assert harness.vehicle.mode is VehicleMode.READY


# Gear


@pytest.mark.parametrize(
    ("speed_mps", "gear"), [(0.49, REVERSE), (0.5, REVERSE), (0.51, DRIVE), (-0.49, DRIVE), (-0.51, REVERSE)]
)
def test_another_gear_is_refused_above_half_a_metre_per_second(speed_mps: float, gear: int) -> None:
    harness = cruising(speed_mps)
    now = harness.vehicle.gear
    harness.drive(GEAR_REQUEST=REVERSE if now is Gear.DRIVE else DRIVE)
    harness.wait_ms(20)
    assert harness.last("VEHICLE_STATUS")["GEAR"] == gear


def test_no_request_leaves_the_gear_and_no_mode_but_autonomous_obeys_one(harness: VehicleHarness) -> None:
    harness.drive(GEAR_REQUEST=DRIVE)
    assert at_present(harness.vehicle.gear) is Gear.PARK
    harness.steer()
    harness.engage(gear=DRIVE)
    harness.command_for_ms(50, GEAR_REQUEST=NO_REQUEST)
    assert harness.vehicle.gear is Gear.DRIVE
    harness.send_line("brake 1")
    harness.drive(GEAR_REQUEST=REVERSE)
    assert harness.vehicle.gear is Gear.DRIVE


def test_it_reverses_on_request(harness: VehicleHarness) -> None:
    harness.engage(gear=REVERSE)
    harness.command_for_ms(1000, ACCEL_REQUEST=-1.0)
    assert harness.last("MOTION")["SPEED"] < -0.7
    assert harness.last("CHASSIS")["ACCEL"] < -0.9
    assert harness.last("POSE")["POS_X"] < 0.0


def test_in_park_it_does_not_move(harness: VehicleHarness) -> None:
    harness.command_for_ms(1000, ACCEL_REQUEST=2.0)
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS
    assert harness.last("MOTION")["SPEED"] == 0


# Stopping


@pytest.mark.parametrize("speed_mps", [8.0, -3.0])
def test_a_safe_stop_brakes_as_requested_and_holds_at_standstill(speed_mps: float) -> None:
    harness = cruising(speed_mps)
    for _ in range(500):
        now_mps = harness.last("MOTION")["SPEED"]
        accel_mps2 = -math.copysign(min(abs(now_mps) / 0.1, 3.0), now_mps)
        harness.pair(SAFE_STOP=1, ACCEL_REQUEST=accel_mps2)
        harness.wait_ms(10)
    speeds = [decoded["SPEED"] for decoded in harness.decoded if decoded.name == "MOTION"]
    assert all(speed * speed_mps >= 0 for speed in speeds)
    assert harness.vehicle.state.speed_mps == 0.0
    assert harness.last("CHASSIS")["ACCEL"] == 0
    harness.command_for_ms(100, SAFE_STOP=1, ACCEL_REQUEST=2.0)
    assert harness.vehicle.state.speed_mps == 0.0
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS


def test_the_speed_signal_never_changes_its_sign_under_the_brakes() -> None:
    harness = cruising(4.0)
    harness.command_for_ms(3000, ACCEL_REQUEST=-6.0)
    assert min(decoded["SPEED"] for decoded in harness.decoded if decoded.name == "MOTION") == 0.0


# Late turns


def test_a_late_turn_sends_once_counts_the_overrun_and_keeps_the_grid(harness: VehicleHarness) -> None:
    harness.tick()
    harness.now_ns = START_NS + 37 * MS
    assert [decoded.name for decoded in harness.tick()] == ["VEHICLE_STATUS", *SAMPLE]
    assert harness.vehicle.counters["overruns"] == 2
    assert harness.tick() == []
    assert harness.vehicle.next_due_ns == START_NS + 40 * MS


def test_a_pause_of_two_seconds_is_followed_by_no_burst_and_no_leap() -> None:
    harness = cruising(10.0)
    x_m = harness.vehicle.state.x_m
    harness.now_ns += 2000 * MS
    assert len(harness.tick()) == 4
    assert harness.tick() == []
    assert harness.vehicle.state.x_m - x_m < 1.1
    assert harness.vehicle.counters["overruns"] >= 198
    harness.wait_ms(10)
    assert harness.last("POSE").counter == harness.last("CHASSIS").counter


@given(lateness_ms=st.lists(st.integers(0, 60), min_size=1, max_size=40))
@settings(max_examples=50, deadline=None)
def test_the_grid_does_not_drift_however_late_the_turns(lateness_ms: list[int]) -> None:
    harness = VehicleHarness()
    sent = 0
    for late_ms in lateness_ms:
        due_ns = harness.vehicle.next_due_ns
        assert (due_ns - START_NS) % (10 * MS) == 0
        harness.now_ns = max(due_ns, harness.now_ns) + late_ms * MS
        sent += any(decoded.name == "POSE" for decoded in harness.tick())
    last_tick = (harness.now_ns - START_NS) // (10 * MS)
    assert sent == len(lateness_ms)
    assert sent + harness.vehicle.counters["overruns"] == last_tick + 1


def test_an_early_turn_does_nothing(harness: VehicleHarness) -> None:
    harness.now_ns = START_NS - 1
    assert harness.tick() == []
    assert harness.vehicle.next_due_ns == START_NS


def test_time_alone_decides_where_it_is() -> None:
    often, seldom = cruising(5.0), cruising(5.0)
    often.send_line("frame MAP")
    for harness, step_ms in ((often, 1), (seldom, 10)):
        for _ in range(90 // step_ms):
            harness.now_ns += step_ms * MS
            harness.tick()
    assert often.vehicle.state == seldom.vehicle.state


def test_every_message_of_the_contract_is_the_profiles() -> None:
    vehicle = simulated_vehicle(load_database(load_profile("reference")), start_ns=0)
    assert set(vehicle.messages) == {"VEHICLE_STATUS", *SAMPLE}
    assert set(LAYOUT) - set(vehicle.messages) == set(CONTROLLER_SENDS)
