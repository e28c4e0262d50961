"""How a stop brakes: never along the motion, by its jerk, let up before standstill, and then held."""

import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.errors import InvalidValueError
from vehicle_iface.safety.limits import Channel
from vehicle_iface.safety.stop import StopShape, stop_accel_raw

LSB = 0.001
BRAKE = Channel(name="brake", lsb=LSB, lowest=-3.0, highest=6.0, rate_per_s=30.0)
"""Of the reference vehicle."""
JERK_MPS3 = 30.0
FIGURES: dict[str, float] = {
    "deceleration_mps2": 3.0,
    "time_step_s": 0.1,
    "jerk_mps3": JERK_MPS3,
    "release_time_constant_s": 0.2,
    "hold_mps2": 0.0,
}
ANY_SPEED = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-1.0, 1.0),
    st.sampled_from([0.0, -0.0, 0.005, -0.005, 0.3, -0.3, 0.6, -0.6, 20.0, -20.0, 5e-324, -5e-324]),
)
ANY_DT = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.sampled_from([0.0, -0.01, 0.01, 0.1]))
ANY_RAW = st.integers(-(2**40), 2**40)


def shape(**changes: float) -> StopShape:
    return StopShape(**FIGURES | changes)


def after(
    last_mps2: float, speed_mps: float, dt_s: float = 0.01, *, reversing: bool = False, **changes: float
) -> float:
    """What follows on `last_mps2`, in SI."""
    last_raw = round(last_mps2 / LSB)
    return LSB * stop_accel_raw(shape(**changes), BRAKE, last_raw, speed_mps, dt_s, reversing=reversing)


def coming(speed_mps: float, count: int, *, last_mps2: float = 0.0, **more: Any) -> list[float]:
    """The first commands of a stop at a speed that stays, at 100 Hz."""
    found = [last_mps2]
    for _ in range(count):
        found.append(after(found[-1], speed_mps, **more))
    return found[1:]


# Laws


@given(
    st.lists(st.tuples(ANY_SPEED, ANY_DT, st.booleans(), st.booleans(), ANY_RAW), min_size=1, max_size=30),
    st.floats(0.0, 8.0),
    st.floats(0.1, 100.0),
)
def test_a_stop_is_finite_in_range_and_never_along_the_motion_for_every_input(
    steps: list[tuple[float, float, bool, bool, int]], hold_mps2: float, jerk_mps3: float
) -> None:
    """Speeds, times and directions of any kind, and commands of any size in between."""
    stop, raw = shape(hold_mps2=hold_mps2, jerk_mps3=jerk_mps3), 0
    for speed_mps, dt_s, reversing, is_interrupted, other_raw in steps:
        last = other_raw if is_interrupted else raw
        raw = stop_accel_raw(stop, BRAKE, last, speed_mps, dt_s, reversing=reversing)
        assert type(raw) is int
        assert abs(raw) <= 6000
        if speed_mps == 0.0:
            assert raw >= 0 if reversing else raw <= 0
            assert abs(raw) * LSB <= hold_mps2 + 1e-9
        elif not math.isnan(speed_mps):
            assert raw <= 0 if speed_mps > 0.0 else raw >= 0
            assert abs(raw) * LSB <= abs(speed_mps) / 0.1 + 1e-9


@given(ANY_RAW, ANY_SPEED, ANY_DT, st.booleans(), st.floats(0.1, 30.0))
def test_no_step_of_a_stop_is_greater_than_its_jerk_allows(
    last_raw: int, speed_mps: float, dt_s: float, reversing: bool, jerk_mps3: float
) -> None:
    """Not with drive, not with more than the safe deceleration, and not with what would turn the motion round."""
    raw = stop_accel_raw(shape(jerk_mps3=jerk_mps3), BRAKE, last_raw, speed_mps, dt_s, reversing=reversing)
    is_backwards = speed_mps < 0.0 or (reversing and not speed_mps > 0.0)
    most_mps2 = min(3.0, abs(speed_mps) / 0.1)
    braked_mps2 = min(most_mps2, max(0.0, LSB * (last_raw if is_backwards else -last_raw)))
    granted_mps2 = max(LSB, jerk_mps3 * dt_s) if dt_s > 0.0 else 0.0
    assert abs(abs(raw) * LSB - braked_mps2) <= granted_mps2 + LSB + 1e-6


@given(st.floats(0.05, 25.0), st.booleans(), st.sampled_from([0.0, 0.5]))
def test_a_vehicle_that_obeys_at_once_comes_to_rest_and_is_never_pulled_backwards(
    speed_mps: float, backwards: bool, hold_mps2: float
) -> None:
    """The command taken literally: a speed that changes by what is asked for, without friction or hold."""
    sign, raw, stop = -1.0 if backwards else 1.0, 0, shape(hold_mps2=hold_mps2)
    v, took_s, sent = sign * speed_mps, 0.0, [0.0]
    while abs(v) > 0.005:
        raw = stop_accel_raw(stop, BRAKE, raw, v, 0.01, reversing=backwards)
        v += raw * LSB * 0.01
        took_s += 0.01
        sent.append(raw * LSB)
        assert v * sign >= 0.0
        assert took_s < speed_mps / 3.0 + 1.5
    assert all(abs(b - a) <= JERK_MPS3 * 0.01 + 1e-9 for a, b in pairwise(sent))
    assert abs(sent[-1]) < 0.1
    assert took_s >= speed_mps / 3.0


# Round each bound


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_brake_comes_on_by_the_jerk_up_to_the_safe_deceleration_and_no_further(sign: float) -> None:
    found = coming(sign * 5.0, 12)
    assert found == pytest.approx([-sign * min(0.3 * (k + 1), 3.0) for k in range(12)])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("speed_mps", "asked_mps2"),
    [(100.0, 3.0), (0.601, 3.0), (0.6, 3.0), (0.599, 2.995), (0.3, 1.5), (0.1, 0.5), (0.005, 0.025), (0.0001, 0.0)],
)
def test_the_brake_is_let_up_with_the_speed(speed_mps: float, asked_mps2: float, sign: float) -> None:
    found = coming(sign * speed_mps, 30)
    assert found[-1] == pytest.approx(-sign * asked_mps2)


def test_a_release_time_constant_shorter_than_the_time_step_is_the_time_step() -> None:
    assert coming(0.1, 30, release_time_constant_s=0.01)[-1] == pytest.approx(-1.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("speed_mps", [0.0, 0.005, 0.4, 5.0])
def test_drive_torque_is_removed_at_once(speed_mps: float, sign: float) -> None:
    least = after(sign * 3.0, sign * speed_mps, reversing=sign < 0)
    assert least == pytest.approx(-sign * min(0.3, speed_mps / 0.2))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("dt_s", [0.0, 0.01])
def test_a_harder_brake_than_the_safe_one_is_let_up_to_it_at_once(dt_s: float, sign: float) -> None:
    assert after(-sign * 6.0, sign * 5.0, dt_s) == pytest.approx(-sign * 3.0)
    assert after(-sign * 2.999, sign * 5.0, dt_s) == pytest.approx(-sign * (3.0 if dt_s else 2.999))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_brake_that_would_turn_the_motion_round_is_let_up_at_once_and_eased_by_the_jerk(sign: float) -> None:
    assert after(-sign * 6.0, sign * 0.1, 0.0) == pytest.approx(-sign * 1.0)
    assert coming(sign * 0.1, 4, last_mps2=-sign * 6.0) == pytest.approx([-sign * a for a in (0.7, 0.5, 0.5, 0.5)])


@pytest.mark.parametrize("reversing", [False, True])
@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_at_standstill_nothing_is_asked_for_unless_the_vehicle_needs_it_to_be_held(
    zero: float, reversing: bool
) -> None:
    sign = 1.0 if reversing else -1.0
    assert after(sign * 3.0, zero, reversing=reversing) == 0.0
    held = coming(zero, 5, reversing=reversing, hold_mps2=0.75)
    assert held == pytest.approx([sign * value for value in (0.3, 0.6, 0.75, 0.75, 0.75)])
    assert after(sign * 3.0, zero, reversing=reversing, hold_mps2=0.75) == pytest.approx(sign * 0.75)


@pytest.mark.parametrize("reversing", [False, True])
def test_the_motion_decides_the_brakes_direction_and_the_gear_only_without_motion(reversing: bool) -> None:
    assert after(0.0, 5.0, reversing=reversing) == pytest.approx(-0.3)
    assert after(0.0, -5.0, reversing=reversing) == pytest.approx(0.3)
    assert after(0.0, math.nan, reversing=reversing) == pytest.approx(0.3 if reversing else -0.3)


def test_a_motion_that_has_turned_round_is_braked_the_other_way_from_nothing() -> None:
    assert after(-3.0, -5.0) == pytest.approx(0.3)
    assert after(3.0, 5.0) == pytest.approx(-0.3)


@pytest.mark.parametrize("speed_mps", [math.nan, math.inf, 1e308])
def test_a_speed_that_is_no_number_is_braked_like_a_fast_one(speed_mps: float) -> None:
    assert coming(speed_mps, 20)[-1] == pytest.approx(-3.0)


@pytest.mark.parametrize(
    ("dt_s", "granted_mps2"), [(0.0, 0.0), (-0.1, 0.0), (math.nan, 0.0), (math.inf, 3.0), (1e-9, 0.001)]
)
def test_time_grants_the_jerks_share_and_at_least_one_count(dt_s: float, granted_mps2: float) -> None:
    assert after(0.0, 5.0, dt_s) == pytest.approx(-granted_mps2)


def test_a_signal_whose_counts_are_coarse_against_the_jerk_brakes_all_the_same() -> None:
    coarse = Channel(name="brake", lsb=0.5, lowest=-3.0, highest=6.0, rate_per_s=30.0)
    raw = 0
    for _ in range(10):
        raw = stop_accel_raw(shape(jerk_mps3=15.0), coarse, raw, 5.0, 0.01, reversing=False)
    assert raw == -6


def test_the_lesser_of_the_jerk_and_the_rate_of_the_channel_counts() -> None:
    assert after(0.0, 5.0, jerk_mps3=20.0) == pytest.approx(-0.2)
    assert after(0.0, 5.0, jerk_mps3=60.0) == pytest.approx(-0.3)


def test_no_braking_beyond_the_vehicles_limit_is_requested() -> None:
    assert coming(50.0, 40, deceleration_mps2=8.0)[-1] == pytest.approx(-6.0)
    assert coming(0.0, 40, deceleration_mps2=8.0, hold_mps2=8.0)[-1] == pytest.approx(-6.0)
    assert coming(0.0, 40, hold_mps2=8.0)[-1] == pytest.approx(-3.0)
    assert after(-20.0, 50.0, 0.0, deceleration_mps2=8.0) == pytest.approx(-6.0)


@pytest.mark.parametrize("name", list(FIGURES))
@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, True, "3"])
def test_a_number_that_no_stop_has_is_refused_by_its_name(name: str, value: Any) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} = "):
        shape(**{name: value})


@pytest.mark.parametrize("name", list(FIGURES))
def test_only_the_hold_may_be_nothing(name: str) -> None:
    if name == "hold_mps2":
        assert shape(hold_mps2=0).hold_mps2 == 0.0
    else:
        with pytest.raises(InvalidValueError, match="must be above 0"):
            shape(**{name: 0.0})
    assert type(getattr(shape(**{name: 30}), name)) is float
