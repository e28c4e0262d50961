"""The gate: whatever is requested, the command is finite, within limits and rates, and equal to the encoded one."""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.harness import decode_sent, reference
from vehicle_iface import BehaviorConfig, Command, Reason, VehicleState
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.command import SafeCommand
from vehicle_iface.compose import stop_shape
from vehicle_iface.safety.gate import LONGEST_STEP_S, Gate, gate_channels
from vehicle_iface.status import Gear
from vehicle_iface.units import s_from_ns

ANY_FLOAT = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-25.0, 25.0),
    st.sampled_from([0.6, -0.6, 3.0, -6.0, 20.0, -20.0, 0.60005, -6.0005, 0.0, -0.0]),
)
ANY_STEP_NS = st.one_of(
    st.sampled_from([0, 1, 10_000_000, 100_000_000, 100_000_001, -1, -10_000_000]),
    st.integers(-(10**12), 10**12),
)
WHEELBASE_M = 2.7
NUMBERS = ("accel_mps2", "front_wheel_angle_rad", "rear_wheel_angle_rad", "speed_mps")
LSB = {"accel_mps2": 0.001, "front_wheel_angle_rad": 1e-4, "rear_wheel_angle_rad": 1e-4, "speed_mps": 0.005}


class SendingGate(Gate):
    """Whatever it permits is sent; what it only proposes is not."""

    def permit(self, *given: Any, **more: Any) -> SafeCommand:
        safe = self.propose(*given, **more)
        self.commit()
        return safe

    def propose(self, *given: Any, **more: Any) -> SafeCommand:
        return super().permit(*given, **more)


def new_gate(lsb: Mapping[str, float] | None = None, **limits: Any) -> SendingGate:
    """The reference vehicle's, or one with other counts or limits."""
    profile = reference().profile
    changed = msgspec.structs.replace(profile.limits, **limits)
    of_channels = gate_channels(changed, lambda field: {**reference().resolutions, **(lsb or {})}[field])
    stop = stop_shape(profile, BehaviorConfig())
    return SendingGate(of_channels, changed, wheelbase_m=WHEELBASE_M, stop=stop)


def state(front_wheel_angle_rad: float = 0.0, speed_mps: float = 0.0) -> VehicleState:
    return VehicleState(
        stamp_ns=0,
        x_m=0.0,
        y_m=0.0,
        heading_rad=0.0,
        speed_mps=speed_mps,
        front_wheel_angle_rad=front_wheel_angle_rad,
    )


def request(**numbers: float) -> Command:
    """A command with any numbers, also those that `Command` itself would refuse."""
    command = Command(stamp_ns=1, accel_mps2=0.0, front_wheel_angle_rad=0.0)
    for name, number in numbers.items():
        msgspec.structs.force_setattr(command, name, number)
    return command


@st.composite
def requests(draw: st.DrawFn) -> Command:
    numbers = {name: draw(ANY_FLOAT) for name in NUMBERS}
    return request(**numbers, reason=draw(st.sampled_from(list(Reason))))


def in_range(command: SafeCommand, *, reversing: bool) -> bool:
    low, high = (-3.0, 6.0) if reversing else (-6.0, 3.0)
    slack = 1e-9
    return (
        low - slack <= command.accel_mps2 <= high + slack
        and abs(command.front_wheel_angle_rad) <= 0.6 + slack
        and command.rear_wheel_angle_rad == 0.0
        and abs(command.speed_mps) <= 20.0 + slack
    )


@given(st.lists(st.tuples(requests(), ANY_STEP_NS, st.booleans()), max_size=20))
def test_any_request_at_any_time_gives_a_finite_command_within_limits(steps: list[tuple[Command, int, bool]]) -> None:
    gate, now_ns = new_gate(), 0
    for command, step_ns, reversing in steps:
        now_ns += step_ns
        safe = gate.permit(command, state(), now_ns=now_ns, reversing=reversing)
        assert all(type(getattr(safe, name)) is float and math.isfinite(getattr(safe, name)) for name in NUMBERS)
        assert in_range(safe, reversing=reversing)
        assert safe.enable


@given(st.lists(st.tuples(requests(), ANY_STEP_NS), max_size=20), st.booleans(), st.floats(-0.6, 0.6))
def test_no_step_is_greater_than_the_rate_grants_from_the_last_one_sent(
    steps: list[tuple[Command, int]], reversing: bool, angle_rad: float
) -> None:
    gate, now_ns = new_gate(), 10**9
    gate.start_from(state(front_wheel_angle_rad=angle_rad), now_ns)
    accel_mps2, front_rad = 0.0, round(angle_rad / 1e-4) * 1e-4
    for command, step_ns in steps:
        now_ns += step_ns
        dt_s = min(LONGEST_STEP_S, max(0.0, s_from_ns(step_ns)))
        safe = gate.permit(command, state(), now_ns=now_ns, reversing=reversing)
        assert abs(safe.front_wheel_angle_rad - front_rad) <= 0.8 * dt_s + 1e-9
        if safe.safe_stop:
            assert safe.accel_mps2 == 0.0  # the vehicle stands
        else:
            assert abs(safe.accel_mps2 - accel_mps2) <= 30.0 * dt_s + 1e-8
        accel_mps2, front_rad = safe.accel_mps2, safe.front_wheel_angle_rad


@given(st.lists(requests(), max_size=10), st.floats(-50.0, 50.0), st.booleans())
def test_a_stop_never_goes_on_driving(before: list[Command], requested_mps2: float, reversing: bool) -> None:
    gate, now_ns = new_gate(), 10**9
    gate.start_from(state(), now_ns)
    for command in before:
        now_ns += 10_000_000
        gate.permit(command, state(), now_ns=now_ns, reversing=reversing)
    opposing = abs(requested_mps2) if reversing else -abs(requested_mps2)
    stop = Command(stamp_ns=0, accel_mps2=opposing, front_wheel_angle_rad=0.0, reason=Reason.STATE_STALE)
    safe = gate.permit(stop, state(), now_ns=now_ns + 1, reversing=reversing)
    assert safe.accel_mps2 >= 0.0 if reversing else safe.accel_mps2 <= 0.0


@given(st.lists(st.tuples(requests(), ANY_STEP_NS, st.booleans()), min_size=1, max_size=10))
def test_an_encoded_command_round_trips(steps: list[tuple[Command, int, bool]]) -> None:
    gate, encoder, now_ns = new_gate(), Encoder(reference().sent), 0
    for command, step_ns, reversing in steps:
        now_ns += step_ns
        safe = gate.permit(command, state(), now_ns=now_ns, reversing=reversing)
        drive, steer = (decode_sent(frame) for frame in encoder.encode_command(safe))
        assert drive["ACCEL_REQUEST"] == pytest.approx(safe.accel_mps2, abs=1e-9)
        assert drive["SPEED_REQUEST"] == pytest.approx(safe.speed_mps, abs=1e-9)
        assert steer["FRONT_WHEEL_ANGLE_REQUEST"] == pytest.approx(safe.front_wheel_angle_rad, abs=1e-9)
        assert steer["REAR_WHEEL_ANGLE_REQUEST"] == pytest.approx(safe.rear_wheel_angle_rad, abs=1e-9)
        assert (drive["ENABLE"], steer["ENABLE"], drive["SAFE_STOP"]) == (1, 1, safe.safe_stop)
        assert drive["REASON"] == safe.reason
        for name in NUMBERS:
            counts = getattr(safe, name) / LSB[name]
            assert abs(counts - round(counts)) < 1e-6


@given(st.floats(-0.6, 0.6))
def test_the_first_command_starts_from_the_measured_wheel_angle(angle_rad: float) -> None:
    gate = new_gate()
    gate.start_from(state(front_wheel_angle_rad=angle_rad), 10**12)
    measured = state(front_wheel_angle_rad=angle_rad)
    first = gate.permit(request(front_wheel_angle_rad=0.6), measured, now_ns=10**12, reversing=False)
    assert first.front_wheel_angle_rad == pytest.approx(angle_rad, abs=0.5001e-4)
    second = gate.permit(request(front_wheel_angle_rad=0.6), measured, now_ns=10**12 + 10_000_000, reversing=False)
    assert second.front_wheel_angle_rad == pytest.approx(min(0.6, first.front_wheel_angle_rad + 0.008), abs=1.0001e-4)


@pytest.mark.parametrize(("measured", "taken"), [(0.9, 0.6), (-0.9, -0.6), (0.60006, 0.6)])
def test_a_measured_angle_beyond_the_limit_starts_at_the_limit(measured: float, taken: float) -> None:
    gate = new_gate()
    gate.start_from(state(front_wheel_angle_rad=measured), 0)
    assert gate.permit(request(), state(), now_ns=0, reversing=False).front_wheel_angle_rad == pytest.approx(taken)


def test_after_a_long_silence_a_tenth_of_a_second_of_change_is_granted_and_no_more() -> None:
    gate = new_gate()
    gate.start_from(state(), 0)
    safe = gate.permit(request(front_wheel_angle_rad=0.6), state(), now_ns=3600 * 10**9, reversing=False)
    assert safe.front_wheel_angle_rad == pytest.approx(0.08)


@pytest.mark.parametrize(("reversing", "low", "high"), [(False, -6.0, 3.0), (True, -3.0, 6.0)])
def test_drive_and_brake_change_sides_when_reversing(reversing: bool, low: float, high: float) -> None:
    for requested, reached in ((-9.0, low), (9.0, high)):
        gate = new_gate()
        for step in range(40):
            safe = gate.permit(request(accel_mps2=requested), state(), now_ns=step * 10_000_000, reversing=reversing)
        assert safe.accel_mps2 == pytest.approx(reached)


def test_a_change_of_direction_cuts_to_the_range_of_the_new_one_at_once() -> None:
    gate = new_gate()
    for step in range(40):
        braking = gate.permit(request(accel_mps2=-6.0), state(), now_ns=step * 10_000_000, reversing=False)
    assert braking.accel_mps2 == pytest.approx(-6.0)
    assert gate.permit(
        request(accel_mps2=-6.0), state(), now_ns=39 * 10_000_000, reversing=True
    ).accel_mps2 == pytest.approx(-3.0)


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_one_number_that_is_not_finite_makes_the_whole_request_a_controller_error(name: str, value: float) -> None:
    gate = new_gate()
    good: dict[str, Any] = {"accel_mps2": 1.0, "front_wheel_angle_rad": 0.3, "speed_mps": 5.0}
    safe = gate.permit(request(**good | {name: value}), state(), now_ns=10**9, reversing=False)
    assert (safe.reason, safe.safe_stop) == (Reason.CONTROLLER_ERROR, True)
    assert (safe.accel_mps2, safe.front_wheel_angle_rad, safe.speed_mps) == (0.0, 0.0, 0.0)
    assert gate.limited["not_finite"] == 1


@pytest.mark.parametrize("reason", list(Reason))
def test_every_reason_but_nominal_is_a_safe_stop(reason: Reason) -> None:
    safe = new_gate().permit(request(reason=reason), state(), now_ns=0, reversing=False)
    assert (safe.reason, safe.safe_stop) == (reason, reason is not Reason.NOMINAL)


def test_limited_values_are_counted_by_name_and_rounded_ones_are_not() -> None:
    gate = new_gate()
    gate.start_from(state(), 0)
    gate.permit(request(speed_mps=19.9987, front_wheel_angle_rad=0.00004), state(), now_ns=10_000_000, reversing=False)
    assert not any(gate.limited.values())
    gate.permit(
        request(speed_mps=25.0, accel_mps2=9.0, front_wheel_angle_rad=0.5, rear_wheel_angle_rad=0.3),
        state(),
        now_ns=20_000_000,
        reversing=False,
    )
    assert {name: count for name, count in gate.limited.items() if count} == {
        "speed_mps": 1,
        "accel_mps2": 1,
        "front_wheel_angle_rad": 1,
        "rear_wheel_angle_rad": 1,
    }


@pytest.mark.parametrize("reason", list(Reason))
def test_a_release_requests_nothing(reason: Reason) -> None:
    safe = new_gate().release(stamp_ns=7, reason=reason)
    assert (safe.enable, safe.safe_stop, safe.reason, safe.stamp_ns) == (False, False, reason, 7)
    assert [getattr(safe, name) for name in NUMBERS] == [0.0] * 4
    assert safe.gear_request is Gear.NO_REQUEST


@pytest.mark.parametrize("gear", list(Gear))
def test_the_gear_request_passes_as_it_is(gear: Gear) -> None:
    assert new_gate().permit(request(), state(), now_ns=0, reversing=False, gear_request=gear).gear_request is gear


# What the front wheels may do at speed


def driven(gate: Gate, requested: Command, speed_mps: float, count: int, **more: Any) -> list[SafeCommand]:
    """The same request at 100 Hz, with wheels that follow at once."""
    answers: list[SafeCommand] = []
    for step in range(1, count + 1):
        measured = state(answers[-1].front_wheel_angle_rad if answers else 0.0, speed_mps)
        answers.append(gate.permit(requested, measured, now_ns=step * 10_000_000, reversing=speed_mps < 0.0, **more))
    return answers


def lateral_mps2(command: SafeCommand, speed_mps: float) -> float:
    return speed_mps * speed_mps * math.tan(command.front_wheel_angle_rad) / WHEELBASE_M


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("speed_mps", [-15.0, -4.0, 4.9, 5.1, 7.0, 10.0, 14.0, 20.0, 25.0])
def test_full_lock_is_held_back_to_the_lateral_limits_at_every_speed(speed_mps: float, sign: int) -> None:
    gate = new_gate(front_wheel_angle_by_speed=((0.0, 0.6),))
    answers = driven(gate, request(front_wheel_angle_rad=sign * 0.6), speed_mps, 300)
    felt = [lateral_mps2(answer, speed_mps) for answer in answers]
    slack = speed_mps**2 * LSB["front_wheel_angle_rad"] / WHEELBASE_M * 1.5
    assert max(map(abs, felt)) <= 3.0 + 1e-6
    assert all(abs(after - before) <= 5.0 * 0.01 + 1e-6 for before, after in pairwise(felt))
    reachable_mps2 = min(3.0, speed_mps**2 * math.tan(0.6) / WHEELBASE_M)
    assert abs(felt[-1]) == pytest.approx(reachable_mps2, abs=slack + 1e-3)


@pytest.mark.parametrize(("speed_mps", "most_rad"), [(0.0, 0.6), (5.0, 0.6), (7.5, 0.4), (10.0, 0.2), (30.0, 0.05)])
def test_the_table_over_speed_is_linear_between_its_rows_and_constant_beyond_them(
    speed_mps: float, most_rad: float
) -> None:
    gate = new_gate(lateral_accel_mps2=1e6, lateral_jerk_mps3=1e6)
    answers = driven(gate, request(front_wheel_angle_rad=0.6), speed_mps, 200)
    assert answers[-1].front_wheel_angle_rad == pytest.approx(most_rad, abs=1.0001e-4)


def test_a_command_never_leads_far_away_from_a_steering_that_hangs() -> None:
    gate, answer = new_gate(), None
    for step in range(200):
        answer = gate.permit(request(front_wheel_angle_rad=0.6), state(0.1), now_ns=step * 10_000_000, reversing=False)
    assert answer is not None
    assert answer.front_wheel_angle_rad == pytest.approx(0.4)


def test_the_wheels_return_at_their_rate_after_the_speed_has_risen() -> None:
    gate = new_gate()
    turned = driven(gate, request(front_wheel_angle_rad=0.6), 1.0, 100)[-1]
    assert turned.front_wheel_angle_rad == pytest.approx(0.6)
    now_ns, last_rad = 101 * 10_000_000, 0.6
    for _ in range(10):
        measured = state(last_rad, speed_mps=12.0)
        answer = gate.permit(request(front_wheel_angle_rad=0.6), measured, now_ns=now_ns, reversing=False)
        assert answer.front_wheel_angle_rad == pytest.approx(last_rad - 0.008, abs=1e-9)
        now_ns, last_rad = now_ns + 10_000_000, answer.front_wheel_angle_rad


def test_until_the_vehicle_is_autonomous_drive_and_steering_are_held_back_more() -> None:
    answers = driven(new_gate(), request(front_wheel_angle_rad=0.6, accel_mps2=3.0), 1.0, 100, engaging=True)
    steps = [after.front_wheel_angle_rad - before.front_wheel_angle_rad for before, after in pairwise(answers)]
    assert max(steps) == pytest.approx(0.003)
    assert answers[-1].accel_mps2 == pytest.approx(1.0)
    braking = driven(new_gate(), request(accel_mps2=-6.0), 1.0, 100, engaging=True)
    assert braking[-1].accel_mps2 == pytest.approx(-6.0)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_vehicle_that_takes_its_time_to_engage_finds_the_wheels_where_they_are(sign: int) -> None:
    gate, hanging = new_gate(), state(0.1)
    gate.start_from(hanging, 0)
    requested = request(front_wheel_angle_rad=sign * 0.6)
    sent = [
        gate.permit(requested, hanging, now_ns=k * 10_000_000, reversing=False, engaging=True).front_wheel_angle_rad
        for k in range(1, 300)
    ]
    assert sent[8:11] == pytest.approx([0.1 + sign * lead_rad for lead_rad in (0.027, 0.03, 0.03)])
    assert sent[-1] == pytest.approx(0.1 + sign * 0.03)
    on = gate.permit(requested, hanging, now_ns=300 * 10_000_000, reversing=False)
    assert on.front_wheel_angle_rad == pytest.approx(0.1 + sign * 0.038)


def test_a_profile_that_is_stricter_about_the_measured_wheels_is_so_while_engaging_too() -> None:
    gate, hanging = new_gate(front_wheel_deviation_rad=0.02), state()
    for k in range(1, 30):
        safe = gate.permit(
            request(front_wheel_angle_rad=0.6), hanging, now_ns=k * 10_000_000, reversing=False, engaging=True
        )
    assert safe.front_wheel_angle_rad == pytest.approx(0.02)


def test_a_vehicle_that_measures_no_wheels_is_not_compared_with_zero_while_it_engages() -> None:
    answers = driven(
        new_gate(front_wheel_deviation_rad=math.inf), request(front_wheel_angle_rad=0.6), 0.0, 100, engaging=True
    )
    unmeasured = new_gate(front_wheel_deviation_rad=math.inf)
    for step in range(1, 101):
        safe = unmeasured.permit(
            request(front_wheel_angle_rad=0.6), state(), now_ns=step * 10_000_000, reversing=False, engaging=True
        )
    assert safe.front_wheel_angle_rad == answers[-1].front_wheel_angle_rad == pytest.approx(0.3)


@pytest.mark.parametrize(("speed_mps", "most_mps2"), [(0.0, 3.0), (10.0, 3.0), (15.0, 2.25), (-15.0, -2.25)])
def test_the_drive_is_gentler_where_it_is_fast_and_the_brake_is_not(speed_mps: float, most_mps2: float) -> None:
    sign = math.copysign(1.0, most_mps2)
    assert driven(new_gate(), request(accel_mps2=sign * 9.0), speed_mps, 60)[-1].accel_mps2 == pytest.approx(most_mps2)
    braking = driven(new_gate(), request(accel_mps2=-sign * 9.0), speed_mps, 60)
    assert braking[-1].accel_mps2 == pytest.approx(-sign * 6.0)


@pytest.mark.parametrize("speed_mps", [15.0, -15.0])
def test_the_wheels_turn_less_far_where_it_is_fast_in_either_direction(speed_mps: float) -> None:
    gate = new_gate(front_wheel_angle_by_speed=((10.0, 0.02), (20.0, 0.01)), lateral_accel_mps2=100.0)
    assert driven(gate, request(front_wheel_angle_rad=0.6), speed_mps, 60)[-1].front_wheel_angle_rad == pytest.approx(
        0.015
    )


@given(
    st.lists(st.tuples(requests(), ANY_STEP_NS, st.booleans(), st.booleans()), max_size=20),
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(-1.5, 1.5),
)
def test_any_measured_values_give_a_finite_command_in_range(
    steps: list[tuple[Command, int, bool, bool]], speed_mps: float, front_rad: float, rear_rad: float
) -> None:
    gate, now_ns = new_gate(), 0
    measured = replace(state(front_rad, speed_mps), rear_wheel_angle_rad=rear_rad)
    gate.start_from(measured, now_ns)
    for command, step_ns, reversing, engaging in steps:
        now_ns += step_ns
        safe = gate.permit(command, measured, now_ns=now_ns, reversing=reversing, engaging=engaging)
        assert all(math.isfinite(getattr(safe, name)) for name in NUMBERS)
        assert in_range(safe, reversing=reversing)


@given(st.lists(st.tuples(requests(), st.floats(-30.0, 30.0)), min_size=1, max_size=30))
def test_at_a_steady_speed_no_sequence_of_requests_breaks_a_lateral_limit(
    steps: list[tuple[Command, float]],
) -> None:
    speed_mps = steps[0][1]
    gate, last_rad, felt = new_gate(), 0.0, [0.0]
    gate.start_from(state(0.0, speed_mps), 0)
    for number, (command, _) in enumerate(steps, start=1):
        safe = gate.permit(command, state(last_rad, speed_mps), now_ns=number * 10_000_000, reversing=speed_mps < 0.0)
        last_rad = safe.front_wheel_angle_rad
        felt.append(lateral_mps2(safe, speed_mps))
        assert abs(felt[-1]) <= 3.0 + 1e-6
        assert abs(felt[-1] - felt[-2]) <= 5.0 * 0.01 + 1e-6


def test_a_permission_that_was_not_sent_does_not_move_the_rates() -> None:
    gate = new_gate()
    gate.start_from(state(), 0)
    lost = gate.propose(request(front_wheel_angle_rad=0.6), state(), now_ns=10_000_000, reversing=False)
    again = gate.permit(request(front_wheel_angle_rad=-0.6), state(), now_ns=10_000_000, reversing=False)
    assert -again.front_wheel_angle_rad == lost.front_wheel_angle_rad == pytest.approx(0.008)


@pytest.mark.parametrize(
    ("left", "accel_mps2", "front_rad", "rear_rad"),
    [
        ((), -0.6, -0.016, -0.010),
        (("accel_mps2", "speed_mps"), 0.3 - 0.3, -0.016, -0.010),
        (("front_wheel_angle_rad",), -0.6, 0.008 - 0.008, -0.010),
        (("rear_wheel_angle_rad",), -0.6, -0.016, 0.005 - 0.005),
        (("speed_mps",), -0.6, -0.016, -0.010),
    ],
)
def test_the_next_permission_is_counted_from_what_left_of_the_last_one(
    left: tuple[str, ...], accel_mps2: float, front_rad: float, rear_rad: float
) -> None:
    gate = new_gate(rear_wheel_angle_rad=0.1, rear_wheel_rate_radps=0.5)
    gate.start_from(state(), 0)
    most = request(accel_mps2=3.0, front_wheel_angle_rad=0.6, rear_wheel_angle_rad=0.1)
    least = request(accel_mps2=-6.0, front_wheel_angle_rad=-0.6, rear_wheel_angle_rad=-0.1)
    gate.propose(most, state(), now_ns=10_000_000, reversing=False)
    if left:
        gate.commit_fields(left)
    safe = gate.permit(least, state(), now_ns=20_000_000, reversing=False)
    assert safe.accel_mps2 == pytest.approx(accel_mps2)
    assert safe.front_wheel_angle_rad == pytest.approx(front_rad)
    assert safe.rear_wheel_angle_rad == pytest.approx(rear_rad)


def test_a_gate_without_a_start_counts_from_rest_at_time_zero() -> None:
    gate = new_gate(rear_wheel_angle_rad=0.1, rear_wheel_rate_radps=0.5)
    everything = request(accel_mps2=3.0, front_wheel_angle_rad=0.6, rear_wheel_angle_rad=0.1)
    first = gate.propose(everything, state(), now_ns=0, reversing=False)
    assert (first.accel_mps2, first.front_wheel_angle_rad, first.rear_wheel_angle_rad) == (0.0, 0.0, 0.0)
    later = gate.permit(everything, state(), now_ns=10_000_000, reversing=False)
    assert later.front_wheel_angle_rad == pytest.approx(0.008)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("speed_mps", "requested_mps2", "granted_mps2"),
    [
        (19.99, 0.5, 0.3),
        (20.0, 0.5, 0.0),
        (25.0, 0.5, 0.0),
        (20.0, 0.01, 0.0),
        (20.0, -0.5, -0.3),
        (20.0, 0.0, 0.0),
    ],
)
def test_at_the_greatest_speed_and_beyond_nothing_is_added_to_it_and_it_may_be_braked(
    speed_mps: float, requested_mps2: float, granted_mps2: float, sign: int
) -> None:
    gate = new_gate()
    measured = state(speed_mps=sign * speed_mps)
    safe = gate.permit(request(accel_mps2=sign * requested_mps2), measured, now_ns=10_000_000, reversing=sign < 0)
    assert safe.accel_mps2 == pytest.approx(sign * granted_mps2)
    assert gate.limited["overspeed"] == (1 if requested_mps2 > 0.0 and granted_mps2 == 0.0 else 0)


@pytest.mark.parametrize("reversing", [False, True])
def test_a_stop_drops_even_the_least_drive(reversing: bool) -> None:
    gate, least_mps2 = new_gate(), -0.001 if reversing else 0.001
    driving = gate.permit(request(accel_mps2=least_mps2), state(), now_ns=10_000_000, reversing=reversing)
    assert driving.accel_mps2 == pytest.approx(least_mps2)
    stop = request(reason=Reason.STATE_STALE, accel_mps2=-3000.0 * least_mps2)
    assert gate.permit(stop, state(), now_ns=10_000_000, reversing=reversing).accel_mps2 == 0.0


@pytest.mark.parametrize("sign", [-1, 1])
def test_without_a_table_too_the_wheels_are_led_back_where_the_speed_has_risen(sign: int) -> None:
    gate = new_gate(front_wheel_angle_by_speed=((0.0, 0.6),))
    last_rad = driven(gate, request(front_wheel_angle_rad=sign * 0.6), 1.0, 100)[-1].front_wheel_angle_rad
    for step in range(101, 111):
        measured = state(last_rad, speed_mps=12.0)
        requested = request(front_wheel_angle_rad=sign * 0.6)
        answer = gate.permit(requested, measured, now_ns=step * 10_000_000, reversing=False)
        assert answer.front_wheel_angle_rad == pytest.approx(last_rad - sign * 0.008, abs=1e-9)
        last_rad = answer.front_wheel_angle_rad


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_lateral_limits_hold_for_the_curvature_of_front_and_rear_wheels(sign: int) -> None:
    gate = new_gate(rear_wheel_angle_rad=0.1, rear_wheel_rate_radps=0.1, front_wheel_angle_by_speed=((0.0, 0.6),))
    front_rad, felt = 0.0, [0.0]
    for step in range(1, 200):
        requested = request(front_wheel_angle_rad=0.6, rear_wheel_angle_rad=sign * 0.05)
        safe = gate.permit(requested, state(front_rad, 10.0), now_ns=step * 10_000_000, reversing=False)
        front_rad = safe.front_wheel_angle_rad
        curvature_per_m = (math.tan(front_rad) - math.tan(safe.rear_wheel_angle_rad)) / WHEELBASE_M
        felt.append(100.0 * curvature_per_m)
    assert safe.rear_wheel_angle_rad == pytest.approx(sign * 0.05)
    assert max(map(abs, felt)) <= 3.0 + 1e-6
    assert felt[-1] == pytest.approx(3.0, abs=0.006)
    assert all(abs(after - before) <= 5.0 * 0.01 + 1e-6 for before, after in pairwise(felt))


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("rear_rad", [-0.05, 0.05])
def test_the_first_turn_after_a_long_hold_keeps_the_jerk_limit_where_the_rear_wheels_are_turned(
    rear_rad: float, sign: int
) -> None:
    gate = new_gate(rear_wheel_angle_rad=0.1, rear_wheel_rate_radps=1.0, front_wheel_angle_by_speed=((0.0, 0.6),))
    both = request(front_wheel_angle_rad=rear_rad, rear_wheel_angle_rad=rear_rad)
    held = driven(gate, both, 10.0, 300)[-1]
    assert held.front_wheel_angle_rad == pytest.approx(held.rear_wheel_angle_rad)
    turn = request(front_wheel_angle_rad=sign * 0.6, rear_wheel_angle_rad=rear_rad)
    turned = gate.permit(turn, state(rear_rad, 10.0), now_ns=301 * 10_000_000, reversing=False)
    curvature_per_m = (math.tan(turned.front_wheel_angle_rad) - math.tan(turned.rear_wheel_angle_rad)) / WHEELBASE_M
    assert 0.0 < 100.0 * sign * curvature_per_m <= 5.0 * 0.01 + 1e-6


def test_a_request_that_is_not_finite_turns_no_rear_wheel() -> None:
    gate = new_gate(rear_wheel_angle_rad=0.1, rear_wheel_rate_radps=0.5)
    safe = gate.permit(request(accel_mps2=math.nan, rear_wheel_angle_rad=0.1), state(), now_ns=10**7, reversing=False)
    assert safe.rear_wheel_angle_rad == 0.0


@pytest.mark.parametrize("requested_rad", [0.0, -0.6])
def test_a_wheel_beyond_its_limit_for_the_speed_may_go_back_as_fast_as_it_can_for_any_request(
    requested_rad: float,
) -> None:
    """The lateral jerk holds back what turns in; it must not hold back what turns out of a curve that is too tight."""
    gate = new_gate()
    driven(gate, request(front_wheel_angle_rad=0.6), 1.0, 100)
    safe = gate.permit(
        request(front_wheel_angle_rad=requested_rad),
        state(0.6, speed_mps=12.0),
        now_ns=101 * 10_000_000,
        reversing=False,
    )
    assert safe.front_wheel_angle_rad == pytest.approx(0.592)


# A stop brakes by itself


@given(
    st.lists(st.tuples(requests(), ANY_STEP_NS, st.floats(-30.0, 30.0), st.booleans(), st.booleans()), max_size=30),
    st.booleans(),
)
def test_no_order_of_events_makes_a_stop_push_the_vehicle_along(
    steps: list[tuple[Command, int, float, bool, bool]], starts: bool
) -> None:
    """Wishes and stops in turn, speeds that jump, permissions that are not sent, and new beginnings."""
    gate, now_ns = new_gate(), 10**9
    for command, step_ns, speed_mps, is_lost, begins in steps:
        now_ns += step_ns
        if begins and starts:
            gate.start_from(state(speed_mps=speed_mps), now_ns)
        decide = gate.propose if is_lost else gate.permit
        safe = decide(command, state(speed_mps=speed_mps), now_ns=now_ns, reversing=speed_mps < 0.0)
        if safe.safe_stop:
            assert safe.accel_mps2 * speed_mps <= 0.0
            assert abs(safe.accel_mps2) <= min(3.0, abs(speed_mps) / 0.1) + 1e-9


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("requested_mps2", [0.0, 3.0, -0.001, -6.0, math.nan, math.inf])
def test_the_deceleration_of_a_stop_does_not_depend_on_the_request(requested_mps2: float, sign: int) -> None:
    stop = request(accel_mps2=requested_mps2, reason=Reason.DEVIATION)
    answers = driven(new_gate(), stop, sign * 5.0, 12)
    expected = [-sign * min(0.3 * (k + 1), 3.0) for k in range(12)]
    assert [answer.accel_mps2 for answer in answers] == pytest.approx(expected)
    assert driven(new_gate(), stop, sign * 0.1, 12)[-1].accel_mps2 == pytest.approx(-sign * 0.5)


@pytest.mark.parametrize("reversing", [False, True])
@pytest.mark.parametrize("speed_mps", [0.0, 0.1, -0.1, 5.0, -5.0])
def test_without_a_known_speed_a_stop_brakes_as_hard_as_it_may_and_goes_on(speed_mps: float, reversing: bool) -> None:
    """What the sensors say of standstill and direction does not ease or turn the brake."""
    gate, stop, accels_mps2 = new_gate(), request(reason=Reason.STATE_INVALID), []
    gate.start_from(state(), 0)
    for tick in range(1, 101):
        safe = gate.permit(
            stop,
            state(speed_mps=speed_mps),
            now_ns=tick * 10_000_000,
            reversing=reversing,
            speed_mps=speed_mps,
            speed_is_known=False,
        )
        accels_mps2.append(safe.accel_mps2)
    sign = 1 if reversing else -1
    assert accels_mps2 == pytest.approx([sign * min(0.3 * tick, 3.0) for tick in range(1, 101)])


@pytest.mark.parametrize("sign", [1, -1])
def test_limits_go_by_the_speed_that_is_given_and_else_by_the_measured_one(sign: int) -> None:
    """At 20 m/s nothing is added to the speed, 3 m/s² of lateral acceleration are a small angle, a stop brakes hard."""
    slow = state(speed_mps=0.1 * sign)
    drive, stop = request(accel_mps2=1.0 * sign, front_wheel_angle_rad=0.05), request(reason=Reason.STATE_STALE)
    sent: dict[float | None, tuple[float, float, float]] = {}
    for speed_mps in (None, 20.0 * sign):
        gate = new_gate()
        gate.start_from(slow, 0)
        for tick in range(1, 101):
            now_ns = tick * 10_000_000
            driven_on = gate.permit(drive, slow, now_ns=now_ns, reversing=sign < 0, speed_mps=speed_mps)
        for tick in range(101, 151):
            now_ns = tick * 10_000_000
            stopped = gate.permit(stop, slow, now_ns=now_ns, reversing=sign < 0, speed_mps=speed_mps)
        sent[speed_mps] = (driven_on.accel_mps2, driven_on.front_wheel_angle_rad, stopped.accel_mps2)
    assert sent[None] == pytest.approx((1.0 * sign, 0.05, -0.5 * sign))
    assert sent[20.0 * sign] == pytest.approx((0.0, math.atan(3.0 / 20.0**2 * WHEELBASE_M), -3.0 * sign), abs=1e-4)


def test_a_stop_is_not_counted_as_a_limited_request() -> None:
    gate = new_gate()
    driven(gate, request(accel_mps2=9.0, reason=Reason.DEVIATION), 5.0, 12)
    assert not any(gate.limited.values())


@pytest.mark.parametrize("reversing", [False, True])
def test_a_vehicle_that_stands_is_held_against_its_gear_where_the_profile_wants_it_held(reversing: bool) -> None:
    behavior = msgspec.structs.replace(reference().profile.behavior, hold_deceleration_mps2=0.5)
    profile = msgspec.structs.replace(reference().profile, behavior=behavior)
    gate = Gate(
        gate_channels(profile.limits, lambda field: LSB[field]),
        profile.limits,
        wheelbase_m=WHEELBASE_M,
        stop=stop_shape(profile, BehaviorConfig()),
    )
    stop = request(reason=Reason.NO_TRAJECTORY)
    answers = [gate.permit(stop, state(), now_ns=k * 10_000_000, reversing=reversing) for k in range(4)]
    sign = 1.0 if reversing else -1.0
    assert [answer.accel_mps2 for answer in answers] == pytest.approx([0.0, sign * 0.3, sign * 0.5, sign * 0.5])


def test_a_stop_that_was_not_sent_does_not_move_the_ramp() -> None:
    gate, stop = new_gate(), request(reason=Reason.LINK_DOWN)
    gate.start_from(state(speed_mps=5.0), 0)
    gate.propose(stop, state(speed_mps=5.0), now_ns=10_000_000, reversing=False)
    again = gate.permit(stop, state(speed_mps=5.0), now_ns=20_000_000, reversing=False)
    assert again.accel_mps2 == pytest.approx(-0.6)


def test_after_a_stop_driving_begins_from_the_brake_that_was_on() -> None:
    gate = new_gate()
    driven(gate, request(reason=Reason.STATE_STALE), 5.0, 12)
    on = gate.permit(request(accel_mps2=1.0), state(speed_mps=5.0), now_ns=13 * 10_000_000, reversing=False)
    assert on.accel_mps2 == pytest.approx(-2.7)
    assert on.safe_stop is False


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("requested_rad", [0.0, -0.6])
def test_a_wheel_that_is_a_little_beyond_what_the_speed_allows_goes_back_to_that_and_on_by_the_jerk(
    requested_rad: float, sign: int
) -> None:
    gate, front_rad = new_gate(), sign * 0.0582
    gate.start_from(state(front_rad, speed_mps=12.0), 0)
    sent = []
    for step in range(1, 4):
        measured, requested = state(front_rad, speed_mps=12.0), request(front_wheel_angle_rad=sign * requested_rad)
        safe = gate.permit(requested, measured, now_ns=step * 10_000_000, reversing=False)
        front_rad = safe.front_wheel_angle_rad
        sent.append(front_rad)
    # 3 m/s² are at 0.05618 rad, 5 m/s³ are 0.00094 rad in 10 ms
    assert sent == pytest.approx([sign * 0.0561, sign * 0.0552, sign * 0.0543])


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("dt_s", [0.01, 0.03, 0.1])
def test_a_little_more_speed_at_the_lateral_limit_is_no_leave_to_swerve(dt_s: float, sign: int) -> None:
    gate = new_gate(front_wheel_angle_by_speed=((0.0, 0.6),))
    gate.start_from(state(sign * 0.0202, speed_mps=20.0), 0)
    held = request(front_wheel_angle_rad=sign * 0.0202)
    at = gate.permit(held, state(sign * 0.0202, speed_mps=20.0), now_ns=10**9, reversing=False)
    away = request(front_wheel_angle_rad=-sign * 0.6)
    swerve = gate.permit(away, state(sign * 0.0202, speed_mps=20.05), now_ns=10**9 + round(dt_s * 1e9), reversing=False)
    slack_mps2 = 0.02 + 20.05**2 * 1e-4 / WHEELBASE_M  # what the speed has made of it, and a count
    assert abs(lateral_mps2(at, 20.05) - lateral_mps2(swerve, 20.05)) <= 5.0 * dt_s + slack_mps2


# Wheels that are not where they were sent


def dragged(
    gate: Gate, requested_rad: float, speed_mps: float, rate_radps: float, **more: Any
) -> list[tuple[float, float]]:
    """Somebody turns the wheels by this rate to 0.5 rad; measured and sent, at 100 Hz for two seconds."""
    gate.start_from(state(0.0, speed_mps), 0)
    requested, both = request(front_wheel_angle_rad=requested_rad), []
    for step in range(1, 201):
        measured_rad = math.copysign(min(0.5, abs(rate_radps) * step / 100), rate_radps)
        safe = gate.permit(
            requested, state(measured_rad, speed_mps), now_ns=step * 10_000_000, reversing=speed_mps < 0.0, **more
        )
        both.append((measured_rad, safe.front_wheel_angle_rad))
    return both


@pytest.mark.parametrize("engaging", [False, True])
@pytest.mark.parametrize("rate_radps", [-0.6, -0.2, 0.2, 0.6])
@pytest.mark.parametrize("requested_rad", [-0.6, 0.0, 0.6])
@pytest.mark.parametrize("speed_mps", [-8.0, 0.0, 3.0, 5.0, 6.0, 10.0, 18.0])
def test_the_command_never_moves_further_from_wheels_that_the_driver_turns(
    speed_mps: float, requested_rad: float, rate_radps: float, engaging: bool
) -> None:
    apart_rad = 0.03 if engaging else 0.3
    both = dragged(new_gate(), requested_rad, speed_mps, rate_radps, engaging=engaging)
    for (_, before_rad), (measured_rad, sent_rad) in pairwise(both):
        leads = abs(sent_rad - measured_rad) > apart_rad + 1e-9
        assert not leads or abs(sent_rad - measured_rad) <= abs(before_rad - measured_rad) + 1e-9


@pytest.mark.parametrize("engaging", [False, True])
@pytest.mark.parametrize("offset_rad", [-0.7, -0.35, -0.31, -0.04, 0.04, 0.31, 0.35, 0.7])
@pytest.mark.parametrize("speed_mps", [-5.0, 0.0, 2.0, 5.0, 12.0])
def test_a_steering_sensor_that_is_wrong_does_not_drag_the_wheels_along(
    speed_mps: float, offset_rad: float, engaging: bool
) -> None:
    """The wheels obey, and what is measured follows them beside the truth."""
    gate, front_rad = new_gate(), 0.0
    gate.start_from(state(0.0, speed_mps), 0)
    for step in range(1, 300):
        measured = state(front_rad + offset_rad, speed_mps)
        safe = gate.permit(request(), measured, now_ns=step * 10_000_000, reversing=speed_mps < 0.0, engaging=engaging)
        front_rad = safe.front_wheel_angle_rad
        assert front_rad == 0.0


@pytest.mark.parametrize("measured_rad", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("apart_rad", [0.3, math.inf])
def test_a_measured_value_that_is_no_angle_moves_nothing(measured_rad: float, apart_rad: float) -> None:
    broken = state(speed_mps=5.0)
    msgspec.structs.force_setattr(broken, "front_wheel_angle_rad", measured_rad)
    gate = new_gate(front_wheel_deviation_rad=apart_rad)
    for engaging in (False, True):
        safe = gate.permit(request(), broken, now_ns=10_000_000, reversing=False, engaging=engaging)
        assert safe.front_wheel_angle_rad == 0.0


@given(
    st.floats(-25.0, 25.0),
    st.lists(st.tuples(st.floats(-0.6, 0.6), st.floats(-0.7, 0.7), st.booleans()), min_size=1, max_size=40),
)
def test_wherever_the_wheels_are_measured_no_command_leads_further_away_from_them(
    speed_mps: float, steps: list[tuple[float, float, bool]]
) -> None:
    gate, before_rad = new_gate(front_wheel_angle_by_speed=((0.0, 0.6),)), 0.0
    gate.start_from(state(0.0, speed_mps), 0)
    for step, (requested_rad, measured_rad, engaging) in enumerate(steps, start=1):
        measured, requested = state(measured_rad, speed_mps), request(front_wheel_angle_rad=requested_rad)
        now_ns = step * 10_000_000
        safe = gate.permit(requested, measured, now_ns=now_ns, reversing=speed_mps < 0.0, engaging=engaging)
        sent_rad = safe.front_wheel_angle_rad
        apart_rad = abs(sent_rad - measured_rad)
        assert apart_rad <= max(0.03 if engaging else 0.3, abs(before_rad - measured_rad)) + 1e-9
        before_rad = sent_rad


def test_the_wheels_return_at_the_lateral_jerk_when_the_speed_table_is_tighter() -> None:
    gate = new_gate(front_wheel_angle_by_speed=((0.0, 0.6), (9.9, 0.07), (10.5, 0.02)))
    answers = driven(gate, request(front_wheel_angle_rad=0.6), 9.8, 100)
    assert answers[-1].front_wheel_angle_rad == pytest.approx(0.0753, abs=2e-4)
    sent = [answers[-1].front_wheel_angle_rad]
    for step in range(101, 161):
        measured = state(sent[-1], 10.8)
        safe = gate.permit(request(front_wheel_angle_rad=0.6), measured, now_ns=step * 10_000_000, reversing=False)
        sent.append(safe.front_wheel_angle_rad)
    assert sent[1] == pytest.approx(0.0693)  # 3 m/s²
    steps = [before - after for before, after in pairwise(sent[1:42])]
    assert min(steps) >= 0.0011 - 1e-9
    assert max(steps) <= 0.0012 + 1e-9  # 5 m/s³
    assert sent[-1] == pytest.approx(0.02)


@pytest.mark.parametrize(("speed_mps", "granted_rad"), [(0.0999, 0.008), (0.1, 0.0027), (-0.1, 0.0027)])
def test_from_a_tenth_of_a_metre_per_second_on_the_lateral_jerk_counts(speed_mps: float, granted_rad: float) -> None:
    gate = new_gate(lateral_jerk_mps3=0.001)
    answers = driven(gate, request(front_wheel_angle_rad=0.6), speed_mps, 2)
    assert answers[-1].front_wheel_angle_rad - answers[0].front_wheel_angle_rad == pytest.approx(
        granted_rad, abs=1.0001e-4
    )


def test_a_release_that_is_sent_commits_nothing_that_was_only_proposed() -> None:
    gate = new_gate()
    gate.start_from(state(), 0)
    gate.propose(request(front_wheel_angle_rad=0.6), state(), now_ns=10_000_000, reversing=False)
    gate.release(stamp_ns=1, reason=Reason.NOT_ENGAGED)
    gate.commit()
    again = gate.permit(request(front_wheel_angle_rad=-0.6), state(), now_ns=10_000_000, reversing=False)
    assert again.front_wheel_angle_rad == pytest.approx(-0.008)
