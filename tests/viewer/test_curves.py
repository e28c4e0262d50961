"""Curves: no extreme is lost, and nothing is drawn where nothing is known."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.telemetry.columns import GAP_NS
from vehicle_iface.units import NS_PER_MS, NS_PER_S
from vehicle_iface_viewer.panels.curves import COLUMNS, TimeAxis

NOW_NS = 1000 * NS_PER_S + 123_456_789
AXIS = TimeAxis.until(NOW_NS, 8.0)
"""Each column is 0.1 s wide."""


def times_ns(*, count: int = 780, step_ns: int = 10 * NS_PER_MS) -> np.ndarray:
    return NOW_NS - np.arange(count - 1, -1, -1) * step_ns


def test_the_axis_covers_the_window_and_ends_now() -> None:
    times_s = AXIS.times_s
    assert len(times_s) == 2 * AXIS.columns
    assert times_s[0] < -8.0
    assert times_s[-1] == 0.0
    assert (np.diff(times_s) >= 0.0).all()
    assert times_s[3] - times_s[1] == pytest.approx(8.0 / COLUMNS)


def test_a_single_extreme_sample_is_drawn() -> None:
    values = np.zeros(780)
    values[500], values[700] = 7.0, -5.0
    points = AXIS.decimate(times_ns(), values)
    assert (np.nanmax(points), np.nanmin(points)) == (7.0, -5.0)


def test_a_falling_curve_falls_from_point_to_point() -> None:
    points = AXIS.decimate(times_ns(), np.arange(780.0)[::-1])
    assert (np.diff(points[~np.isnan(points)]) <= 0.0).all()


@pytest.mark.parametrize("missing", [slice(600, 627), slice(600, 630), slice(600, 700)])
def test_a_gap_longer_than_a_quarter_of_a_second_is_a_gap(missing: slice) -> None:
    is_missing = np.zeros(780, dtype=bool)
    is_missing[missing] = True
    values = np.where(is_missing, np.nan, 1.0)
    begin_s, end_s = (-10e-3 * (780 - k) for k in (missing.start, missing.stop))
    for points in (
        AXIS.decimate(times_ns(), values),
        AXIS.decimate(times_ns()[~is_missing], values[~is_missing]),
    ):
        unknown_s = AXIS.times_s[np.isnan(points)]
        inside = unknown_s[(unknown_s > begin_s - 0.11) & (unknown_s < end_s + 0.11)]
        assert len(inside) >= 1
        assert len(unknown_s[unknown_s > -7.7]) == len(inside)


def test_shorter_gaps_and_values_farther_apart_than_columns_are_joined() -> None:
    values = np.ones(780)
    values[600:608] = np.nan
    assert not np.isnan(AXIS.decimate(times_ns(), values)[8:]).any()
    narrow = TimeAxis.until(NOW_NS, 0.8)
    points = narrow.decimate(times_ns(count=17, step_ns=50 * NS_PER_MS), np.arange(17.0))
    assert not np.isnan(points[8:-8]).any()
    assert (np.diff(points[8:-8]) >= 0.0).all()


def test_nothing_known_draws_nothing() -> None:
    assert np.isnan(AXIS.decimate(np.zeros(0, dtype=np.int64), np.zeros(0))).all()
    assert np.isnan(AXIS.decimate(times_ns(), np.full(780, np.nan))).all()


@given(
    st.lists(st.tuples(st.integers(0, 8 * NS_PER_S), st.floats(-1e6, 1e6) | st.just(float("nan"))), max_size=60),
    st.sampled_from([0.5, 8.0, 120.0]),
)
def test_points_are_within_the_values_and_gaps_are_kept(samples: list[tuple[int, float]], window_s: float) -> None:
    axis = TimeAxis.until(NOW_NS, window_s)
    unique = dict(samples)
    ago = sorted((each for each in unique if NOW_NS - each >= axis.begin_ns), reverse=True)
    at_ns, values = NOW_NS - np.array(ago, dtype=np.int64), np.array([unique[each] for each in ago])
    points = axis.decimate(at_ns, values)
    known = values[~np.isnan(values)]
    drawn = points[~np.isnan(points)]
    assert len(points) == 2 * axis.columns
    if not len(known):
        assert not len(drawn)
        return
    assert known.min() <= drawn.min() <= drawn.max() <= known.max()
    known_ns = at_ns[~np.isnan(values)]
    for before, after in pairwise(known_ns):
        if after - before > GAP_NS:
            column, last = (int(each - axis.begin_ns) // axis.width_ns for each in (before, after))
            assert np.isnan(points[2 * column + 1 : max(2 * last + 1, 2 * column + 2)]).any()
