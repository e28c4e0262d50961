"""Errors of tracking: the figures of known errors, and those of a drive."""

from pathlib import Path

import numpy as np
import pytest
from msgspec import UNSET

from tests.harness import Drive
from vehicle_iface.runtime.tracking_stats import AT_ONCE, MAX_LAPS, ErrorStats, TrackingStats
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.telemetry import SessionInfo, TelemetryWriter
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.route import RouteConfig
from vehicle_iface.trajectories.shapes import make_route


def test_the_figures_are_those_of_all_errors_without_their_sign() -> None:
    errors = np.random.default_rng(1).normal(0.0, 0.3, 5000)
    stats = ErrorStats()
    stats.add_all(errors[:2000])
    stats.add_all(errors[2000:])
    summary = stats.summary()
    assert summary.rms == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-9)
    assert summary.max == np.abs(errors).max()
    assert 1.0 <= summary.p95 / np.quantile(np.abs(errors), 0.95) <= 1.06


def test_each_lap_has_its_own_figures_and_the_run_those_of_all() -> None:
    stats = TrackingStats()
    for lap, error in ((0, 0.1), (0, -0.1), (1, 0.5)):
        stats.add(error, 0.0, lap=lap)
    summary = stats.summary()
    assert summary is not UNSET
    assert [(lap.samples, lap.lateral_m.max) for lap in summary.laps] == [(2, 0.1), (1, 0.5)]
    assert (summary.samples, summary.lateral_m.max) == (3, 0.5)


@pytest.mark.parametrize("count", [AT_ONCE - 1, AT_ONCE, AT_ONCE + 1, 3 * AT_ONCE])
def test_all_samples_are_in_the_figures_however_many_are_counted_together(count: int) -> None:
    stats = TrackingStats()
    for number in range(count):
        stats.add(0.5, float(number), lap=number // 1000)
    summary = stats.summary()
    assert summary is not UNSET
    assert (summary.samples, summary.heading_rad.max) == (count, float(count - 1))
    assert summary.lateral_m.rms == pytest.approx(0.5)
    assert [lap.samples for lap in summary.laps] == [count]
    assert stats.summary() == summary


def test_later_laps_than_the_last_kept_count_in_the_run_only() -> None:
    stats = TrackingStats()
    for lap in range(MAX_LAPS + 5):
        stats.add(float(lap), 0.0, lap=lap)
    summary = stats.summary()
    assert summary is not UNSET
    assert [lap.lateral_m.max for lap in summary.laps] == [float(lap) for lap in range(MAX_LAPS)]
    assert summary.samples == MAX_LAPS + 5


def drive(tmp_path: Path, seconds: float, **how: object) -> Drive:
    with TelemetryWriter(str(tmp_path / "loop"), SessionInfo(channel="embedded", bus="embedded")) as writer:
        driven = Drive(telemetry=writer, **how)  # type: ignore[arg-type]
        driven.run_s(seconds)
    return driven


def test_only_samples_that_are_driven_on_count(tmp_path: Path) -> None:
    driven = drive(tmp_path, 4.0, start=BicycleState(y_m=0.8))
    tracking = driven.loop.summary().tracking
    assert tracking is not UNSET
    assert tracking.samples == sum(pair["ENABLE"] and not pair["SAFE_STOP"] for pair in driven.pairs())
    assert 0.8 <= tracking.lateral_m.max < 1.2
    assert tracking.laps == []
    assert drive(tmp_path, 4.0, armed=False).loop.summary().tracking is UNSET


def test_a_closed_route_has_figures_by_lap(tmp_path: Path) -> None:
    route = make_route("circle", RouteConfig(radius_m=6.0))
    tracking = drive(tmp_path, 25.0, source=RecedingRoute(route)).loop.summary().tracking
    assert tracking is not UNSET
    assert len(tracking.laps) > 1
    assert sum(lap.samples for lap in tracking.laps) == tracking.samples
