"""The gate against a plain model of its limits, in floats and intervals instead of raw counts.

The model is the documented one: range, rate, table over speed, distance from the measured angle, lateral acceleration
and jerk. It knows no counts, so the gate may differ from it by what rounding to them makes.
"""

import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.harness import reference
from vehicle_iface.interpolation import interpolate
from vehicle_iface.profile import Limits
from vehicle_iface.safety.gate import LONGEST_STEP_S

from .test_gate import LSB, WHEELBASE_M, new_gate, request, state

Interval = tuple[float, float]
LIMITS: list[dict[str, Any]] = [
    {},
    {"front_wheel_angle_by_speed": ((0.0, 0.6),)},
    {"lateral_accel_mps2": 0.5, "front_wheel_deviation_rad": math.inf},
    {"rear_wheel_angle_rad": 0.2, "rear_wheel_rate_radps": 0.3},
    {"accel_max_by_speed": ((0.0, 3.0), (4.0, 0.5)), "accel_rate_mps3": 5.0},
]
PERIODS_NS = st.sampled_from([0, 5_000_000, 10_000_000, 20_000_000, 300_000_000])
ANGLES = st.floats(-0.7, 0.7)


def clamp(value: float, within: Interval) -> float:
    return min(max(value, within[0]), within[1])


def reached(requested: float, last: float, step: float, within: Interval) -> float:
    """The value in the interval that is nearest to the requested one, as far as one step leads there."""
    return clamp(clamp(requested, within), (last - step, last + step))


def lateral(limits: Limits, last_rad: float, speed_mps: float, dt_s: float) -> Interval:
    """Without rear wheels: the angles by acceleration and, from the last one on, by jerk."""
    square = speed_mps * speed_mps
    most, change = limits.lateral_accel_mps2 / square, limits.lateral_jerk_mps3 / square * dt_s
    now = math.tan(last_rad) / WHEELBASE_M
    low, high = max(now - change, -most), min(now + change, most)
    if now > most:  # back to the limit as fast as the wheels may turn, and further by the jerk
        low, high = min(now - change, most), most
    elif now < -most:
        low, high = -most, max(now + change, -most)
    return math.atan(low * WHEELBASE_M), math.atan(high * WHEELBASE_M)


@pytest.mark.parametrize("changed", LIMITS)
@given(
    st.lists(st.tuples(st.floats(-9.0, 9.0), ANGLES, st.floats(-25.0, 25.0), PERIODS_NS), min_size=1, max_size=20),
    st.floats(0.0, 19.0),
    st.booleans(),
)
def test_the_gate_sends_what_the_limits_in_si_units_allow(
    changed: dict[str, Any], steps: list[tuple[float, float, float, int]], speed_mps: float, engaging: bool
) -> None:
    limits = msgspec.structs.replace(reference().profile.limits, **changed)
    gate, now_ns = new_gate(**changed), 10**9
    gate.start_from(state(0.0, speed_mps), now_ns)
    accel_mps2 = rear_rad = 0.0
    engaged = limits.while_engaging
    drive_mps2 = interpolate(limits.accel_max_by_speed, speed_mps)
    for wanted_mps2, wanted_rad, wanted_mps, step_ns in steps:
        now_ns += step_ns
        dt_s = min(step_ns / 1e9, LONGEST_STEP_S)
        asked = request(
            accel_mps2=wanted_mps2,
            front_wheel_angle_rad=0.0,
            rear_wheel_angle_rad=wanted_rad,
            speed_mps=wanted_mps,
        )
        safe = gate.permit(asked, state(0.0, speed_mps), now_ns=now_ns, reversing=False, engaging=engaging)
        highest_mps2 = min(drive_mps2, limits.accel_max_mps2, engaged.accel_max_mps2 if engaging else math.inf)
        accel_mps2 = reached(
            wanted_mps2, accel_mps2, limits.accel_rate_mps3 * dt_s, (limits.accel_min_mps2, highest_mps2)
        )
        most_rad = limits.rear_wheel_angle_rad
        rear_rad = reached(wanted_rad, rear_rad, limits.rear_wheel_rate_radps * dt_s, (-most_rad, most_rad))
        most_mps = limits.speed_max_mps
        assert safe.accel_mps2 == pytest.approx(accel_mps2, abs=1.01 * LSB["accel_mps2"])
        assert safe.rear_wheel_angle_rad == pytest.approx(rear_rad, abs=1.01 * LSB["rear_wheel_angle_rad"])
        assert safe.speed_mps == pytest.approx(clamp(wanted_mps, (-most_mps, most_mps)), abs=LSB["speed_mps"])
        accel_mps2, rear_rad = safe.accel_mps2, safe.rear_wheel_angle_rad


@pytest.mark.parametrize("changed", LIMITS)
@given(
    st.lists(st.tuples(ANGLES, st.floats(-0.4, 0.4)), min_size=1, max_size=20),
    st.floats(0.1, 19.0),
    st.floats(-0.5, 0.5),
    st.booleans(),
)
def test_the_front_wheels_turn_as_the_limits_in_si_units_allow(
    changed: dict[str, Any],
    steps: list[tuple[float, float]],
    speed_mps: float,
    begin_rad: float,
    engaging: bool,
) -> None:
    limits = msgspec.structs.replace(reference().profile.limits, **changed)
    gate, now_ns = new_gate(**changed), 10**9
    gate.start_from(state(begin_rad, speed_mps), now_ns)
    last_rad, lsb_rad, dt_s = round(begin_rad / 1e-4) * 1e-4, LSB["front_wheel_angle_rad"], 0.01
    table_rad = interpolate(limits.front_wheel_angle_by_speed, speed_mps)
    apart_rad, rate_radps = limits.front_wheel_deviation_rad, limits.front_wheel_rate_radps
    if engaging:
        rate_radps = limits.while_engaging.front_wheel_rate_radps
        apart_rad = min(apart_rad, rate_radps * LONGEST_STEP_S) if apart_rad < math.inf else math.inf
    for wanted_rad, off_rad in steps:
        now_ns += 10_000_000
        measured_rad = last_rad + off_rad
        asked = request(front_wheel_angle_rad=wanted_rad)
        safe = gate.permit(asked, state(measured_rad, speed_mps), now_ns=now_ns, reversing=False, engaging=engaging)
        near = min(measured_rad - apart_rad, last_rad), max(measured_rad + apart_rad, last_rad)
        within = near
        for outer in ((-table_rad, table_rad), lateral(limits, last_rad, speed_mps, dt_s), (-0.6, 0.6)):
            within = clamp(within[0], outer), clamp(within[1], outer)
        expected_rad = reached(wanted_rad, last_rad, rate_radps * dt_s, within)
        assert safe.front_wheel_angle_rad == pytest.approx(expected_rad, abs=2.01 * lsb_rad)
        last_rad = safe.front_wheel_angle_rad
