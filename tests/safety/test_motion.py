"""Sources of motion that disagree are found out; a vehicle whose sensors are merely noisy is left alone."""

import logging
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.harness import reference
from tests.kinematics import PERIOD_NS, PERIOD_S, WHEELBASE_M, SensorNoise, distort, drive, drive_route
from vehicle_iface import VehicleState
from vehicle_iface.drivable import build_route
from vehicle_iface.motion_sources import MotionSources
from vehicle_iface.safety.motion import Disagreement, MotionCheck
from vehicle_iface.status import Gear

PROFILE = reference().profile
AGREE_S = 0.5


def motion_check(**sources: bool) -> MotionCheck:
    return MotionCheck(
        PROFILE.plausibility,
        sources=MotionSources(**sources),
        wheelbase_m=WHEELBASE_M,
        gap_s=0.05,
        agree_s=AGREE_S,
    )


def first_disagreement(
    states: list[VehicleState], *, check: MotionCheck | None = None
) -> tuple[Disagreement | None, float]:
    """The first one, and the time of the sample in which it was found, s."""
    check = motion_check() if check is None else check
    for state in states:
        check.update(state, pose_valid=True)
        if check.disagreement is not None:
            kind = check.disagreement.kind
            assert isinstance(kind, Disagreement)
            return kind, state.stamp_ns / 1e9
    return None, math.inf


# Sound vehicles


@given(
    st.floats(-20.0, 20.0), st.floats(-3.0, 3.0), st.floats(-0.6, 0.6), st.sampled_from([0.0, 0.1, -0.1]), st.booleans()
)
def test_exact_sensors_agree_whatever_the_vehicle_does(
    speed_mps: float, accel_mps2: float, front_rad: float, rear_rad: float, fast: bool
) -> None:
    if not fast:
        speed_mps /= 10.0
    front_rad = front_rad if abs(speed_mps) < 8.0 else 0.05 * front_rad
    states = drive(4.0, speed_mps=speed_mps, accel_mps2=accel_mps2, front_rad=front_rad, rear_rad=rear_rad)
    assert first_disagreement(states) == (None, math.inf)


def test_a_position_that_is_measured_ten_times_a_second_is_no_disagreement() -> None:
    states = drive(6.0, speed_mps=12.0, accel_mps2=-2.0)
    slow = [replace(state, x_m=states[i // 9 * 9].x_m, y_m=states[i // 9 * 9].y_m) for i, state in enumerate(states)]
    assert first_disagreement(slow) == (None, math.inf)


# Wrong sensors

SCALES_SPEED = [0.0, 0.3, 0.5, 0.8, 1.3, 2.0, -1.0]
Change = Callable[[float, int], float]


def from_sample(number: int, change: Callable[[float], float]) -> Change:
    return lambda value, i: change(value) if i >= number else value


@pytest.mark.parametrize("speed_mps", [5.0, -5.0, 12.0])
@pytest.mark.parametrize("scale", SCALES_SPEED)
def test_a_speed_of_the_wrong_scale_is_found_out_within_two_seconds(speed_mps: float, scale: float) -> None:
    states = distort(drive(3.0, speed_mps=speed_mps), "speed_mps", lambda value, _: value * scale)
    kind, at_s = first_disagreement(states)
    assert kind is Disagreement.POSITION_SPEED
    assert at_s <= 2.0


@pytest.mark.parametrize("accel_mps2", [1.5, 3.0])
def test_a_speed_that_stays_at_0_is_found_out_before_the_vehicle_is_fast(accel_mps2: float) -> None:
    states = drive(3.0, speed_mps=0.0, accel_mps2=accel_mps2)
    kind, at_s = first_disagreement(distort(states, "speed_mps", lambda _value, _i: 0.0))
    assert kind in (Disagreement.POSITION_SPEED, Disagreement.SPEED_ACCELERATION)
    assert states[round(at_s / PERIOD_S)].speed_mps < 2.2


FIVE_PERCENT = 0.95


def test_a_speed_that_is_five_percent_low_is_found_out_at_20_mps() -> None:
    states = distort(drive(4.0, speed_mps=20.0), "speed_mps", lambda value, _: value * FIVE_PERCENT)
    assert first_disagreement(states)[0] is Disagreement.POSITION_SPEED


@pytest.mark.parametrize(
    ("field", "change", "kind"),
    [
        ("heading_rad", from_sample(50, lambda _: 0.3), Disagreement.HEADING_YAW_RATE),
        ("heading_rad", from_sample(0, lambda value: value + 0.19), Disagreement.POSITION_HEADING),
        ("heading_rad", from_sample(0, lambda value: value - 0.19), Disagreement.POSITION_HEADING),
        ("yaw_rate_radps", from_sample(0, lambda _: 0.0), Disagreement.YAW_RATE_WHEELS),
        ("yaw_rate_radps", from_sample(0, lambda value: -value), Disagreement.YAW_RATE_WHEELS),
        ("yaw_rate_radps", from_sample(0, lambda value: value + 0.5), Disagreement.YAW_RATE_WHEELS),
        ("front_wheel_angle_rad", from_sample(0, lambda _: 0.0), Disagreement.YAW_RATE_WHEELS),
        ("front_wheel_angle_rad", from_sample(0, lambda value: -value), Disagreement.YAW_RATE_WHEELS),
        ("rear_wheel_angle_rad", from_sample(0, lambda value: value + 0.3), Disagreement.YAW_RATE_WHEELS),
        ("accel_mps2", from_sample(0, lambda value: value + 3.0), Disagreement.SPEED_ACCELERATION),
        ("accel_mps2", from_sample(0, lambda value: value - 3.0), Disagreement.SPEED_ACCELERATION),
        ("lateral_speed_mps", from_sample(0, lambda value: value + 2.0), Disagreement.POSITION_HEADING),
        ("x_m", from_sample(0, lambda value: 0.5 * value), Disagreement.POSITION_SPEED),
        ("y_m", from_sample(0, lambda value: -value), Disagreement.POSITION_HEADING),
    ],
)
def test_a_wrong_signal_is_found_out_in_a_bend(field: str, change: Change, kind: Disagreement) -> None:
    states = distort(drive(4.0, speed_mps=5.0, front_rad=0.2), field, change)
    found, at_s = first_disagreement(states)
    assert found is kind
    assert at_s <= 3.0


@pytest.mark.parametrize("delay", [30, 100])
@pytest.mark.parametrize("field", ["speed_mps", "x_m"])
def test_a_signal_that_is_late_is_found_out_while_the_vehicle_brakes(field: str, delay: int) -> None:
    states = drive(4.0, speed_mps=12.0, accel_mps2=-3.0)
    values = [getattr(state, field) for state in states]
    late = distort(states, field, lambda _value, i: values[max(0, i - delay)])
    assert first_disagreement(late)[0] is not None


# What is not sent is not compared


@pytest.mark.parametrize(
    ("absent", "field"),
    [
        ("accel", "accel_mps2"),
        ("front_wheels", "front_wheel_angle_rad"),
        ("lateral_speed", "lateral_speed_mps"),
    ],
)
def test_a_field_that_the_vehicle_does_not_send_is_not_compared(absent: str, field: str) -> None:
    states = [*drive(2.0, speed_mps=8.0, front_rad=0.1), *drive(0.01)]
    braking = drive(3.0, speed_mps=8.0, accel_mps2=-3.0, front_rad=0.1)
    for part in (states[:-1], braking):
        zeroed = distort(part, field, lambda _value, _i: 0.0)
        assert first_disagreement(zeroed, check=motion_check(**{absent: False})) == (None, math.inf)


def test_without_a_yaw_rate_the_heading_is_compared_with_the_wheels() -> None:
    states = distort(drive(4.0, front_rad=0.3), "yaw_rate_radps", lambda _value, _i: 0.0)
    assert first_disagreement(states, check=motion_check(yaw_rate=False)) == (None, math.inf)
    frozen = distort(states, "heading_rad", lambda _value, _i: 0.3)
    assert first_disagreement(frozen, check=motion_check(yaw_rate=False))[0] is not None
    turned = distort(states, "front_wheel_angle_rad", lambda _value, _i: -0.3)
    assert first_disagreement(turned, check=motion_check(yaw_rate=False))[0] is Disagreement.HEADING_YAW_RATE


def test_without_yaw_rate_and_wheels_the_heading_is_compared_with_the_position_alone() -> None:
    states = drive(4.0, front_rad=0.3)
    for field in ("yaw_rate_radps", "front_wheel_angle_rad"):
        states = distort(states, field, lambda _value, _i: 0.0)
    check = motion_check(yaw_rate=False, front_wheels=False)
    assert first_disagreement(states, check=check) == (None, math.inf)
    check.reset()
    frozen = distort(states, "heading_rad", lambda _value, _i: 0.3)
    assert first_disagreement(frozen, check=check)[0] is Disagreement.POSITION_HEADING


def test_a_rear_wheel_makes_a_lateral_speed_where_none_is_sent() -> None:
    states = distort(drive(4.0, rear_rad=0.15), "lateral_speed_mps", lambda _value, _i: 0.0)
    assert first_disagreement(states, check=motion_check(lateral_speed=False)) == (None, math.inf)
    assert first_disagreement(states)[0] is Disagreement.POSITION_HEADING


@pytest.mark.parametrize("angle_rad", [0.7, -0.7])
def test_that_lateral_speed_goes_by_the_tangent_of_the_angle(angle_rad: float) -> None:
    """Both axles are turned alike, so the vehicle moves askew at 0.84 of its speed along the body."""
    states = distort(drive(4.0, front_rad=angle_rad, rear_rad=angle_rad), "lateral_speed_mps", lambda _value, _i: 0.0)
    assert first_disagreement(states, check=motion_check(lateral_speed=False)) == (None, math.inf)
    assert first_disagreement(states)[0] is Disagreement.POSITION_HEADING


# Samples without evidence


def test_an_invalid_pose_and_another_frame_are_not_compared() -> None:
    check = motion_check()
    for i, state in enumerate(drive(3.0)):
        is_valid = i % 3 > 0
        elsewhere: dict[str, Any] = {} if is_valid else {"x_m": 300.0, "heading_rad": 2.0}
        sample = replace(state, **elsewhere, frame_id="map" if i % 5 else "odom")
        check.update(sample, pose_valid=is_valid)
    assert check.disagreement is None


def test_samples_far_apart_are_not_compared() -> None:
    states = drive(4.0)
    moved = [*states[:200], *(replace(state, x_m=state.x_m + 5.0) for state in states[206:])]
    assert first_disagreement(moved) == (None, math.inf)
    near = [*states[:200], *(replace(state, x_m=state.x_m + 5.0) for state in states[204:])]
    assert first_disagreement(near)[0] is Disagreement.POSITION_SPEED


def test_after_a_reset_nothing_is_remembered() -> None:
    check = motion_check()
    first_disagreement(distort(drive(1.0), "speed_mps", lambda _value, _i: 0.0), check=check)
    assert check.limit_speed_mps(0.0) != 0.0
    check.reset()
    assert check.disagreement is None
    assert check.limit_speed_mps(0.0) == 0.0
    assert first_disagreement([replace(s, x_m=s.x_m + 80.0) for s in drive(3.0)], check=check) == (None, math.inf)


# How it ends


def test_a_disagreement_ends_when_all_have_agreed_for_half_a_second() -> None:
    check, states = motion_check(), drive(8.0)
    wrong = distort(states, "speed_mps", lambda value, i: 0.0 if i < 100 else value)
    held: list[bool] = []
    for state in wrong:
        check.update(state, pose_valid=True)
        held.append(check.disagreement is not None)
    begin, end = held.index(True), len(held) - held[::-1].index(True)
    assert held[begin:end] == [True] * (end - begin)
    # The long window still holds 0.5 s + 3 % of its way of the wrong samples until about 2.8 s.
    assert 0.98 + 1.5 + AGREE_S <= end * PERIOD_S <= 1.0 + 2.1 + AGREE_S
    assert check.counts[Disagreement.POSITION_SPEED.value] == 1


def test_it_is_logged_once_with_value_limit_and_place(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        check = motion_check()
        for state in distort(drive(3.0), "speed_mps", lambda _value, _i: 0.0):
            check.update(state, pose_valid=True)
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith("position and speed disagree: forward_m = 0.75")
    assert ", limit 0.5" in caplog.messages[0]
    assert "at x_m = " in caplog.messages[0]


# The speed that limits go by


def speeds(states: list[VehicleState], check: MotionCheck | None = None) -> list[float]:
    check = motion_check() if check is None else check
    found = []
    for state in states:
        check.update(state, pose_valid=True)
        found.append(check.limit_speed_mps(state.speed_mps))
    return found


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_limits_use_the_greatest_speed_of_all_sources(sign: float) -> None:
    low = distort(drive(3.0, speed_mps=10.0 * sign), "speed_mps", lambda value, _: 0.5 * value)
    assert speeds(low)[-1] == pytest.approx(9.85 * sign, abs=0.05)
    high = distort(drive(3.0, speed_mps=5.0 * sign), "speed_mps", lambda value, _: 2.0 * value)
    assert speeds(high)[-1] == pytest.approx(10.0 * sign)


def test_the_speed_by_acceleration_counts_as_well() -> None:
    """As where the position is made from the same wheels as the speed."""
    states = drive(3.0, speed_mps=0.0, accel_mps2=3.0)
    stuck = [replace(state, speed_mps=0.0, x_m=0.0, y_m=0.0) for state in states]
    assert speeds(stuck)[-1] == pytest.approx(3.0 * 2.0 - 0.5 - 0.7 * 2.0, abs=0.2)


def test_noise_does_not_raise_the_speed_that_limits_go_by() -> None:
    noise = SensorNoise(speed_scale=1.0)
    states = list(drive_route(build_route("circle", PROFILE), noise, 3))
    assert speeds(states) == [state.speed_mps for state in states]


# Which way


def direction_after(states: list[VehicleState], gear: Gear | None) -> bool:
    check = motion_check()
    for state in states:
        check.update(state, pose_valid=True)
    return check.is_backwards(states[-1].speed_mps, gear)


@pytest.mark.parametrize(
    ("speed_mps", "gear", "backwards"),
    [
        (5.0, Gear.DRIVE, False),
        (-5.0, Gear.REVERSE, True),
        (5.0, None, False),
        (-5.0, None, True),
        (-5.0, Gear.DRIVE, True),
        (5.0, Gear.REVERSE, False),
        (0.0, Gear.DRIVE, False),
        (0.0, Gear.REVERSE, True),
        (0.0, None, False),
        (-0.04, Gear.DRIVE, False),
        (-0.05, Gear.DRIVE, False),
        (0.05, Gear.REVERSE, True),
        (-0.051, Gear.DRIVE, True),
        (0.06, Gear.REVERSE, False),
        (-0.3, Gear.DRIVE, True),
        (-0.3, Gear.PARK, True),
    ],
)
def test_the_direction_of_travel(speed_mps: float, gear: Gear | None, backwards: bool) -> None:
    assert direction_after(drive(0.15, speed_mps=speed_mps), gear) is backwards


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("accel_mps2", [0.0, -3.0])
def test_while_sources_disagree_a_wrong_sign_is_outvoted_until_standstill(sign: float, accel_mps2: float) -> None:
    check, gear = motion_check(), Gear.DRIVE if sign > 0 else Gear.REVERSE
    wrong = distort(
        drive(3.0, speed_mps=3.0 * sign, accel_mps2=accel_mps2 * sign), "speed_mps", lambda value, _: -value
    )
    for state in wrong:
        check.update(state, pose_valid=True)
        if check.disagreement is not None:
            assert check.is_backwards(state.speed_mps, gear) is (sign < 0.0)
    assert check.disagreement is not None
    assert check.is_backwards(-3.0 * sign, gear) is (sign < 0.0)


def test_with_two_sources_of_direction_the_gear_decides_while_they_disagree() -> None:
    check = motion_check()
    for state in distort(drive(1.0, speed_mps=0.0), "accel_mps2", lambda _value, _i: 5.0):
        check.update(state, pose_valid=True)
    assert check.disagreement is not None
    assert check.is_backwards(-1.0, Gear.DRIVE) is False
    assert check.is_backwards(1.0, Gear.REVERSE) is True
    assert check.is_backwards(-1.0, None) is True


def test_the_first_sample_and_one_with_the_same_stamp_give_no_motion() -> None:
    check = motion_check()
    state = drive(0.01)[0]
    for sample in (state, replace(state, x_m=99.0), replace(state, x_m=50.0, stamp_ns=-PERIOD_NS)):
        check.update(sample, pose_valid=True)
    assert check.disagreement is None
    assert check.limit_speed_mps(5.0) == 5.0
