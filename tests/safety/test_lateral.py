"""The bicycle without slip: curvature and wheels."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.safety.lateral import curvature_per_m

from .test_gate import WHEELBASE_M, SendingGate, driven, new_gate, request, state

JERK_MPS3 = 5.0
NS_PER_MS = 1_000_000
TENTH_OF_A_DEGREE = math.radians(0.1)


@pytest.mark.parametrize(
    ("front_rad", "rear_rad", "expected_per_m"),
    [
        (math.atan(0.3), 0.0, 0.1),
        (0.0, math.atan(0.3), -0.1),
        (math.atan(0.3), -math.atan(0.3), 0.2),
        (math.atan(0.9), math.atan(0.9), 0.0),
    ],
)
def test_a_path_bends_by_the_difference_of_the_wheels_tangents(
    front_rad: float, rear_rad: float, expected_per_m: float
) -> None:
    assert curvature_per_m(front_rad, rear_rad, 3.0) == pytest.approx(expected_per_m)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("speed_mps", "step_rad"), [(0.0, 0.008), (0.0999, 0.008), (0.1, 0.0027), (0.12, 0.0019)])
def test_from_a_tenth_of_a_metre_a_second_on_the_wheels_are_held_back_by_what_can_be_felt(
    speed_mps: float, step_rad: float, sign: int
) -> None:
    gate = new_gate(lateral_jerk_mps3=0.001)
    (answer,) = driven(gate, request(front_wheel_angle_rad=sign * 0.6), sign * speed_mps, 1)
    assert answer.front_wheel_angle_rad == pytest.approx(sign * step_rad, abs=1.0001e-4)


# Where the jerk grants less than one count from sample to sample


def turned(
    gate: SendingGate,
    requested_rad: float,
    speed_mps: float,
    at_ms: float,
    from_rad: float = 0.0,
    *,
    is_lost: bool = False,
) -> float:
    """Where the front wheels are sent, unless that is lost; they were measured at `from_rad`."""
    decide = gate.propose if is_lost else gate.permit
    safe = decide(
        request(front_wheel_angle_rad=requested_rad),
        state(from_rad, speed_mps),
        now_ns=round(at_ms * NS_PER_MS),
        reversing=speed_mps < 0.0,
    )
    return safe.front_wheel_angle_rad


def felt_mps2(front_rad: float, rear_rad: float, speed_mps: float) -> float:
    return speed_mps * speed_mps * curvature_per_m(front_rad, rear_rad, WHEELBASE_M)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("speed_mps", "period_ms", "lsb_rad"),
    [(20.0, 1, 1e-4), (-20.0, 1, 1e-4), (12.0, 1, 1e-4), (20.0, 10, TENTH_OF_A_DEGREE), (10.0, 10, TENTH_OF_A_DEGREE)],
)
def test_counts_that_are_coarse_against_the_jerk_turn_one_by_one_and_on_the_whole_nearly_as_fast(
    speed_mps: float, period_ms: int, lsb_rad: float, sign: int
) -> None:
    gate = new_gate({"front_wheel_angle_rad": lsb_rad}, front_wheel_angle_by_speed=((0.0, 0.6),))
    gate.start_from(state(0.0, speed_mps), 0)
    front_rad, at_ms = 0.0, 0
    while at_ms < 500:
        at_ms += period_ms
        before_rad, front_rad = front_rad, turned(gate, sign * 0.6, speed_mps, at_ms, front_rad)
        assert abs(front_rad - before_rad) == pytest.approx(0.0, abs=1e-12) or (
            sign * (front_rad - before_rad) == pytest.approx(lsb_rad)
        )
    felt = sign * felt_mps2(front_rad, 0.0, speed_mps)
    assert 0.5 * JERK_MPS3 * 0.5 <= felt <= JERK_MPS3 * 0.5 + 1e-6


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_count_comes_when_the_wheels_were_held_for_what_the_jerk_takes_to_it_and_no_sooner(sign: int) -> None:
    after_ms = felt_mps2(1e-4, 0.0, 20.0) / JERK_MPS3 * 1e3
    assert after_ms == pytest.approx(2.963, abs=0.001)
    for last_ms, counts in ((after_ms - 0.01, 0), (after_ms + 0.01, 1)):
        gate = new_gate()
        gate.start_from(state(0.0, 20.0), 0)
        sent = [turned(gate, sign * 0.6, 20.0, at_ms) for at_ms in (1.0, 2.0, last_ms)]
        assert sent == pytest.approx([0.0, 0.0, sign * counts * 1e-4])
    sent = [turned(gate, sign * 0.6, 20.0, at_ms) for at_ms in (4.0, 5.0, 6.0)]
    assert sent == pytest.approx([sign * counts * 1e-4 for counts in (1, 1, 2)])


def test_wheels_that_were_held_for_long_get_one_count_in_a_short_time_and_not_all_that_was_not_used() -> None:
    gate = new_gate()
    gate.start_from(state(0.0, 20.0), 0)
    assert [turned(gate, 0.0, 20.0, at_ms) for at_ms in range(1, 2000)] == [0.0] * 1999
    assert [turned(gate, 0.6, 20.0, at_ms) for at_ms in (2000, 2001, 2002)] == pytest.approx([1e-4, 1e-4, 1e-4])


def test_turning_rear_wheels_restart_the_time() -> None:
    gate = new_gate({"rear_wheel_angle_rad": 2e-5}, rear_wheel_angle_rad=0.1, rear_wheel_rate_radps=0.1)
    gate.start_from(state(0.0, 20.0), 0)
    front, rear = [], []
    for at_ms in (9, 10, 11, 12, 13):
        both = request(
            front_wheel_angle_rad=0.6 if at_ms > 10 else 0.0, rear_wheel_angle_rad=2e-5 if at_ms > 9 else 0.0
        )
        safe = gate.permit(both, state(0.0, 20.0), now_ns=at_ms * NS_PER_MS, reversing=False)
        front.append(safe.front_wheel_angle_rad)
        rear.append(safe.rear_wheel_angle_rad)
    assert rear == pytest.approx([0.0, 2e-5, 2e-5, 2e-5, 2e-5])
    assert front == pytest.approx([0.0, 0.0, 0.0, 0.0, 1e-4])


def test_rear_wheels_that_were_sent_alone_restart_the_time_of_the_lateral_jerk() -> None:
    gate = new_gate({"rear_wheel_angle_rad": 2e-5}, rear_wheel_angle_rad=0.1, rear_wheel_rate_radps=0.1)
    gate.start_from(state(0.0, 20.0), 0)
    gate.propose(request(rear_wheel_angle_rad=2e-5), state(0.0, 20.0), now_ns=40 * NS_PER_MS, reversing=False)
    gate.commit_fields({"rear_wheel_angle_rad"})
    assert [turned(gate, 0.6, 20.0, at_ms) for at_ms in (42, 50)] == pytest.approx([0.0, 2e-4])


@pytest.mark.parametrize("left", [(), ("front_wheel_angle_rad",), ("accel_mps2",)])
def test_a_turn_that_was_not_sent_is_made_with_the_next_command(left: tuple[str, ...]) -> None:
    gate = new_gate()
    gate.start_from(state(0.0, 20.0), 0)
    assert [turned(gate, 0.6, 20.0, at_ms) for at_ms in (1, 2)] == pytest.approx([0.0, 0.0])
    assert turned(gate, 0.6, 20.0, 3, is_lost=True) == pytest.approx(1e-4)
    if left:
        gate.commit_fields(left)
    assert turned(gate, 0.6, 20.0, 4) == pytest.approx(1e-4)


@pytest.mark.parametrize("speed_mps", [20.0, 25.0])
def test_no_count_is_added_at_the_greatest_lateral_acceleration(speed_mps: float) -> None:
    gate = new_gate({"front_wheel_angle_rad": TENTH_OF_A_DEGREE}, front_wheel_angle_by_speed=((0.0, 0.6),))
    gate.start_from(state(0.0, speed_mps), 0)
    front_rad = 0.0
    for step in range(1, 400):
        front_rad = turned(gate, 0.6, speed_mps, step * 10, front_rad)
        assert felt_mps2(front_rad, 0.0, speed_mps) <= 3.0 + 1e-6
    assert felt_mps2(front_rad + TENTH_OF_A_DEGREE, 0.0, speed_mps) > 3.0


@given(
    st.floats(0.1, 30.0),
    st.sampled_from([1e-5, 1e-4, 1e-3, TENTH_OF_A_DEGREE]),
    st.lists(st.tuples(st.floats(-0.6, 0.6), st.integers(0, 150_000_000), st.booleans()), min_size=1, max_size=40),
)
def test_from_turn_to_turn_at_a_steady_speed_the_jerk_is_kept_whatever_the_counts_and_the_times_are(
    speed_mps: float, lsb_rad: float, steps: list[tuple[float, int, bool]]
) -> None:
    """Also where permissions are not sent: what was held is held from the last turn that left."""
    gate = new_gate({"front_wheel_angle_rad": lsb_rad})
    gate.start_from(state(0.0, speed_mps), 0)
    now_ns, turn_ns, sent_ns, front_rad = 0, 0, 0, 0.0
    for requested_rad, step_ns, is_lost in steps:
        now_ns += step_ns
        safe = turned(gate, requested_rad, speed_mps, now_ns / NS_PER_MS, front_rad, is_lost=is_lost)
        if is_lost:
            continue
        change_mps2 = abs(felt_mps2(safe, 0.0, speed_mps) - felt_mps2(front_rad, 0.0, speed_mps))
        count_mps2 = abs(felt_mps2(safe + lsb_rad, 0.0, speed_mps) - felt_mps2(safe, 0.0, speed_mps)) * 1.001
        assert change_mps2 <= JERK_MPS3 * (now_ns - turn_ns) / 1e9 * (1.0 + 1e-6) + 1e-6
        assert change_mps2 <= max(JERK_MPS3 * (now_ns - sent_ns) / 1e9, count_mps2) * (1.0 + 1e-6) + 1e-6
        if abs(safe - front_rad) > lsb_rad / 2.0:
            turn_ns = now_ns
        sent_ns, front_rad = now_ns, safe
