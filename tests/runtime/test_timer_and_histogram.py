"""The periodic timer that does not drift, and the latencies of a whole run in fixed memory."""

import math
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.runtime.histogram import LatencyHistogram, LogHistogram
from vehicle_iface.runtime.timer import PeriodicTimer
from vehicle_iface.telemetry.details import LatencySummary

PERIOD = 10_000_000
BIN = 2.0 ** (1 / 16)


def test_the_first_instant_is_one_period_after_the_start() -> None:
    timer = PeriodicTimer(PERIOD, 1000)
    assert not timer.is_due(1000 + PERIOD - 1)
    assert timer.is_due(1000 + PERIOD)
    assert not timer.is_due(1000 + PERIOD)


def test_a_grid_that_is_served_a_little_late_each_time_does_not_drift() -> None:
    timer = PeriodicTimer(PERIOD, 0)
    now_ns = 0
    for _ in range(100_000):
        now_ns = timer.next_ns + 900_000
        assert timer.is_due(now_ns)
    assert timer.next_ns == 100_001 * PERIOD
    assert (timer.ticks, timer.overruns) == (100_000, 0)


def test_one_late_tick_does_not_shift_the_grid() -> None:
    timer = PeriodicTimer(PERIOD, 0)
    assert timer.is_due(PERIOD + 7_000_000)
    assert timer.next_ns == 2 * PERIOD
    assert timer.overruns == 0


def test_missed_instants_are_counted_and_not_caught_up() -> None:
    timer = PeriodicTimer(PERIOD, 0)
    now_ns = 5 * PERIOD + 1
    assert timer.is_due(now_ns)
    assert not timer.is_due(now_ns)
    assert (timer.ticks, timer.overruns, timer.next_ns) == (1, 4, 6 * PERIOD)


@pytest.mark.parametrize(("late_ns", "overruns"), [(0, 0), (PERIOD - 1, 0), (PERIOD, 1), (PERIOD + 1, 1)])
def test_an_instant_is_missed_when_the_next_one_has_come(late_ns: int, overruns: int) -> None:
    timer = PeriodicTimer(PERIOD, 0)
    assert timer.is_due(PERIOD + late_ns)
    assert timer.overruns == overruns


@given(st.integers(1, 10**9), st.integers(0, 10**18), st.lists(st.integers(0, 10**10), max_size=50))
def test_every_instant_is_either_served_or_counted_and_the_next_lies_ahead(
    period_ns: int, start_ns: int, steps: list[int]
) -> None:
    timer, now_ns, served = PeriodicTimer(period_ns, start_ns), start_ns, 0
    for step_ns in steps:
        now_ns += step_ns
        served += timer.is_due(now_ns)
        assert now_ns < timer.next_ns <= now_ns + period_ns or timer.next_ns == start_ns + period_ns
        assert (timer.next_ns - start_ns) % period_ns == 0
        assert served + timer.overruns == (now_ns - start_ns) // period_ns


# Latencies


def exact_ns(latencies: list[int], share: float) -> int:
    return sorted(latencies)[math.ceil(share * len(latencies)) - 1]


@given(st.lists(st.integers(1, 10**12), min_size=1, max_size=200), st.sampled_from([0.01, 0.5, 0.9, 0.95, 0.99, 1.0]))
def test_a_quantile_is_the_exact_one_within_a_bin_and_never_below_it(latencies: list[int], share: float) -> None:
    histogram = LatencyHistogram()
    for latency_ns in latencies:
        histogram.add(latency_ns)
    quantile_s = histogram.quantile_s(share)
    assert quantile_s is not None
    exact_s = exact_ns(latencies, share) / 1e9
    assert exact_s * (1 - 1e-9) <= quantile_s <= exact_s * BIN * BIN * (1 + 1e-9)
    assert quantile_s <= max(latencies) / 1e9


@given(st.lists(st.integers(-(10**20), 10**20), max_size=50))
def test_its_memory_never_grows_and_nothing_is_too_long_or_too_short_for_it(latencies: list[int]) -> None:
    histogram = LogHistogram(smallest=1.0, octaves=40)
    size = sys.getsizeof(histogram._bins)
    for latency_ns in latencies:
        histogram.add(latency_ns)
    assert sys.getsizeof(histogram._bins) == size
    assert histogram.count == sum(histogram._bins) == len(latencies)
    assert histogram.max == max([0, *latencies])


def test_without_latencies_there_is_no_quantile_and_no_greatest_one() -> None:
    assert LatencyHistogram().summary() == LatencySummary(count=0, p50_s=None, p95_s=None, p99_s=None, max_s=None)


def test_the_summary_is_in_seconds_and_in_order() -> None:
    histogram = LatencyHistogram()
    for latency_ns in range(1_000_000, 101_000_000, 1_000_000):
        histogram.add(latency_ns)
    summary = histogram.summary()
    assert summary.count == 100
    assert summary.p50_s == pytest.approx(0.050, rel=BIN - 1)
    assert summary.p95_s == pytest.approx(0.095, rel=BIN - 1)
    assert summary.p99_s == pytest.approx(0.099, rel=BIN - 1)
    assert summary.max_s == 0.1


def test_values_of_an_array_are_counted_as_one_by_one() -> None:
    sizes = np.concatenate([[0.0, 0.5, 1.0, 1.0001, 2.0, 1e9], np.random.default_rng(1).lognormal(3.0, 2.0, 2000)])
    together, single = (LogHistogram(smallest=1.0, octaves=10) for _ in range(2))
    together.add_all(sizes[:1000])
    together.add_all(sizes[1000:])
    together.add_all(sizes[:0])
    for size in sizes.tolist():
        single.add(size)
    shares = [0.0001, 0.001, 0.002, *np.linspace(0.01, 1.0, 100).tolist()]
    assert [together.quantile(share) for share in shares] == [single.quantile(share) for share in shares]
    assert (together.count, together.max) == (single.count, single.max)
    assert together.total == pytest.approx(single.total)
