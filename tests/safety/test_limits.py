"""Limits on wire integers: in range always, within one step of the last value, nearest to the request."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.errors import InvalidValueError
from vehicle_iface.safety.limits import Channel, clamp_interval, floor_raw, limit_raw, raw_range

ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True)


def channel(lowest: float = -0.6, highest: float = 0.6, rate_per_s: float = 0.8, lsb: float = 1e-4) -> Channel:
    return Channel(name="c", lsb=lsb, lowest=lowest, highest=highest, rate_per_s=rate_per_s)


@st.composite
def channels(draw: st.DrawFn) -> Channel:
    return channel(
        lowest=-draw(st.floats(0.0, 100.0)),
        highest=draw(st.floats(0.0, 100.0)),
        rate_per_s=draw(st.one_of(st.floats(0.0, 1e4), st.just(math.inf))),
        lsb=draw(st.sampled_from([1e-6, 1e-4, 1e-3, 0.005, 0.1, 1.0])),
    )


@given(channels(), ANY_FLOAT, st.integers(-(10**9), 10**9), st.floats(-1.0, 10.0))
def test_the_result_is_in_range_for_every_request(c: Channel, requested: float, last_raw: int, dt_s: float) -> None:
    raw = limit_raw(c, requested, last_raw, dt_s)
    assert type(raw) is int
    assert c.lowest_raw <= raw <= c.highest_raw
    assert c.lowest - 2e-6 * c.lsb <= raw * c.lsb <= c.highest + 2e-6 * c.lsb


@given(channels(), ANY_FLOAT, st.data(), st.floats(-1.0, 10.0))
def test_from_a_value_in_range_no_step_is_greater_than_the_rate_grants(
    c: Channel, requested: float, data: st.DataObject, dt_s: float
) -> None:
    last_raw = data.draw(st.integers(c.lowest_raw, c.highest_raw))
    step = abs(limit_raw(c, requested, last_raw, dt_s) - last_raw)
    assert step * c.lsb <= c.rate_per_s * max(0.0, dt_s) + 2e-6 * c.lsb or math.isinf(c.rate_per_s)


@given(channels(), st.floats(-100.0, 100.0), st.data(), st.floats(0.0, 1.0))
def test_no_allowed_value_is_nearer_to_the_requested_one(
    c: Channel, requested: float, data: st.DataObject, dt_s: float
) -> None:
    last_raw = data.draw(st.integers(c.lowest_raw, c.highest_raw))
    raw = limit_raw(c, requested, last_raw, dt_s)
    step = c.step_raw(dt_s)
    for other in (raw - 1, raw + 1):
        allowed = c.lowest_raw <= other <= c.highest_raw and abs(other - last_raw) <= step
        assert not allowed or abs(raw * c.lsb - requested) <= abs(other * c.lsb - requested) + 1e-9 * c.lsb + 1e-12


@pytest.mark.parametrize("requested", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_finite_becomes_zero_and_never_full_lock(requested: float) -> None:
    assert limit_raw(channel(), requested, 0, 1.0) == 0
    assert limit_raw(channel(), requested, 500, 0.01) == 420


@pytest.mark.parametrize("offset", [-3, -2, -1, 0, 1, 2, 3])
@pytest.mark.parametrize("limit", [6000, -6000])
def test_around_each_limit_every_count_is_cut_where_it_must_be(limit: int, offset: int) -> None:
    for fraction in (-0.5, -0.49, 0.0, 0.49, 0.5):
        requested = (limit + offset + fraction) * 1e-4
        raw = limit_raw(channel(rate_per_s=math.inf), requested, 0, 0.0)
        assert raw == max(-6000, min(6000, round(requested / 1e-4)))


@pytest.mark.parametrize("offset", [-2, -1, 0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_around_the_greatest_step_every_count_is_cut_where_it_must_be(sign: int, offset: int) -> None:
    requested = sign * (80 + offset) * 1e-4
    assert limit_raw(channel(), requested, 0, 0.01) == sign * min(80, 80 + offset)


@pytest.mark.parametrize("dt_s", [0.0, -1e-9, -1.0, -math.inf])
def test_without_time_nothing_moves(dt_s: float) -> None:
    assert limit_raw(channel(), 0.6, 17, dt_s) == 17


def test_a_start_value_out_of_range_comes_back_into_it_at_once() -> None:
    assert limit_raw(channel(), 0.7, 7000, 0.0) == 6000
    assert limit_raw(channel(), 0.0, -7000, 0.01) == -5920


@pytest.mark.parametrize(("lsb", "highest", "counts"), [(1e-4, 0.6, 6000), (0.005, 20.0, 4000), (0.1, 0.3, 3)])
def test_a_limit_that_is_a_whole_number_of_counts_can_be_reached(lsb: float, highest: float, counts: int) -> None:
    assert channel(lsb=lsb, highest=highest).highest_raw == counts


def test_a_limit_between_two_counts_is_the_one_inside() -> None:
    c = channel(lsb=0.1, lowest=-0.25, highest=0.25)
    assert (c.lowest_raw, c.highest_raw) == (-2, 2)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"lowest": 0.1}, "must contain 0"),
        ({"highest": -0.1}, "must contain 0"),
        ({"lowest": math.nan}, "c: lowest = nan"),
        ({"highest": math.inf}, "c: highest = inf"),
        ({"lsb": 0.0}, "c: lsb = 0.0"),
        ({"lsb": math.nan}, "c: lsb = nan"),
        ({"rate_per_s": -0.1}, "c: rate_per_s = -0.1"),
        ({"rate_per_s": math.nan}, "c: rate_per_s = nan"),
    ],
)
def test_a_channel_that_could_not_stop_or_is_no_number_is_refused_by_name(change: dict[str, float], text: str) -> None:
    with pytest.raises(InvalidValueError, match=text):
        channel(**change)


def test_an_interval_beyond_the_range_leads_to_the_end_of_the_range_and_no_further() -> None:
    c = channel(rate_per_s=math.inf)
    assert limit_raw(c, 0.0, 0, 0.01, within=(7000, 8000)) == 6000
    assert limit_raw(c, 0.0, 0, 0.01, within=(-8000, -7000)) == -6000


@pytest.mark.parametrize(("requested", "raw"), [(0.6, 30), (0.003, 30), (0.0025, 25), (0.002, 20), (-0.6, 20)])
def test_a_request_is_clamped_to_the_interval(requested: float, raw: int) -> None:
    assert limit_raw(channel(), requested, 10, 0.01, within=(20, 30)) == raw


def test_a_value_outside_the_interval_returns_to_it_at_the_rate_limit() -> None:
    assert limit_raw(channel(), -0.6, 500, 0.01, within=(20, 30)) == 420
    assert limit_raw(channel(), 0.6, -500, 0.01, within=(20, 30)) == -420


def test_after_a_time_without_end_the_whole_range_is_one_step() -> None:
    assert limit_raw(channel(), 0.6, -6000, math.inf) == 6000


@pytest.mark.parametrize(
    ("inner", "both"),
    [
        ((-1, 9), (0, 3)),
        ((1, 2), (1, 2)),
        ((-1, 2), (0, 2)),
        ((1, 9), (1, 3)),
        ((3, 9), (3, 3)),
        ((-1, 0), (0, 0)),
        ((4, 9), (3, 3)),
        ((-9, -1), (0, 0)),
    ],
)
def test_two_disjoint_intervals_give_the_nearer_end_of_the_outer_one(
    inner: tuple[int, int], both: tuple[int, int]
) -> None:
    assert clamp_interval(inner, (0, 3)) == both


@pytest.mark.parametrize(
    ("lowest", "highest", "counts"),
    [
        (-0.25, 0.25, (-2, 2)),
        (-0.3, 0.3, (-3, 3)),
        (0.13, 0.19, (2, 2)),
        (0.11, 0.13, (1, 1)),
        (-0.19, -0.16, (-2, -2)),
        (0.2, 0.2, (2, 2)),
        (-math.inf, 0.35, (-(10**15), 3)),
        (-0.35, math.inf, (-3, 10**15)),
        (1e308, 1e308, (10**15, 10**15)),
        (-1e308, -1e308, (-(10**15), -(10**15))),
    ],
)
def test_between_two_values_are_the_counts_inside_or_the_nearest_one(
    lowest: float, highest: float, counts: tuple[int, int]
) -> None:
    assert raw_range(channel(lsb=0.1), lowest, highest) == counts


@pytest.mark.parametrize(
    ("value", "raw"), [(0.0, 0), (0.59999, 5999), (0.6, 6000), (0.7, 6000), (math.inf, 6000), (math.nan, 6000)]
)
def test_a_limit_rounds_down_and_ends_at_the_channels_greatest_value(value: float, raw: int) -> None:
    assert floor_raw(channel(), value) == raw
