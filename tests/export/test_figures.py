"""Figures of a drive and the way along its path, against figures that are known."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from tests.export.recorded import record_drive
from tests.harness import Drive
from vehicle_iface.export.columns import to_columns
from vehicle_iface.export.figures import measure_drive, tabulate
from vehicle_iface.export.page.drive import load_drive
from vehicle_iface.export.recording import RecordedDrive
from vehicle_iface.export.way import offset_m, way_along_path
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.details import TrackingSummary
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase

TICK_NS = 10_000_000


def along(reference_m: Sequence[float], *, speed_mps: float = 1.0, beside_m: float = 0.0) -> list[Snapshot]:
    """Along +x, with the vehicle to the left of its path."""
    return [
        Snapshot(
            published_ns=TICK_NS * (number + 1),
            stamp_ns=TICK_NS * (number + 1),
            controller_state=ControllerState.ENGAGED,
            reason=0,
            has_state=True,
            x_m=place_m,
            y_m=beside_m,
            speed_mps=speed_mps,
            has_reference=True,
            reference_speed_mps=speed_mps,
            spatial_reference_x_m=place_m,
            lateral_error_m=beside_m,
            sent=True,
        )
        for number, place_m in enumerate(reference_m)
    ]


def test_way_is_the_length_of_path_whatever_the_vehicle_does_beside_it() -> None:
    angles = np.linspace(0.0, math.pi, 300)
    circle = [
        Snapshot(
            published_ns=TICK_NS * (number + 1),
            controller_state=3,
            reason=0,
            has_state=True,
            x_m=12 * math.sin(angle),
            y_m=-12 * math.cos(angle),
            heading_rad=angle + 0.1,
            speed_mps=1.0,
            has_reference=True,
            reference_speed_mps=1.0,
            spatial_reference_x_m=10 * math.sin(angle),
            spatial_reference_y_m=-10 * math.cos(angle),
            heading_error_rad=0.1,
        )
        for number, angle in enumerate(angles.tolist())
    ]
    assert way_along_path(to_columns(circle))[-1] == pytest.approx(10 * math.pi, rel=1e-3)


def test_way_grows_in_reverse_and_noise_at_rest_does_not_add_up() -> None:
    noise = 0.02 * np.random.default_rng(1).normal(size=2000)
    backwards = along([-0.01 * number for number in range(500)], speed_mps=-1.0)
    at_rest = along((-4.99 + noise).tolist(), speed_mps=0.0)
    rows = to_columns([*backwards, *(one._replace(published_ns=one.published_ns + 500 * TICK_NS) for one in at_rest)])
    way_m = way_along_path(rows)
    assert way_m[499] == pytest.approx(4.99)
    assert way_m[-1] == pytest.approx(4.99, abs=0.1)
    assert np.all(np.diff(way_m) >= 0.0)


def test_a_reference_that_jumps_or_is_unknown_does_not_count() -> None:
    snapshots = along([0.01 * number for number in range(300)])
    snapshots[100:200] = [one._replace(has_reference=False, spatial_reference_x_m=0.0) for one in snapshots[100:200]]
    snapshots[250:] = [one._replace(spatial_reference_x_m=one.x_m + 50.0) for one in snapshots[250:]]
    assert way_along_path(to_columns(snapshots))[-1] == pytest.approx(2.99)


@pytest.mark.parametrize(("first_m", "second_m", "expected"), [(0.0, 3.0, 3.0), (3.0, 0.0, -3.0), (0.0, 100.0, None)])
def test_a_drive_that_begins_later_on_the_path_is_aligned(
    first_m: float, second_m: float, expected: float | None
) -> None:
    drives = [to_columns(along([begin_m + 0.01 * number for number in range(1000)])) for begin_m in (first_m, second_m)]
    ways = [way_along_path(rows) for rows in drives]
    assert offset_m(drives[0], ways[0], drives[1], ways[1]) == (None if expected is None else pytest.approx(expected))


def test_figures_of_a_drive_are_those_of_the_loop(tmp_path_factory: pytest.TempPathFactory) -> None:
    def end(drive: Drive) -> None:
        if round(drive.now_s, 1) == 6.0:
            drive.loop.shutdown.request()

    recorded = record_drive(tmp_path_factory.mktemp("figures"), 20.0, route="circle", act=end)
    figures = load_drive(RecordedDrive(recorded.folder)).figures
    summary = recorded.driven.loop.summary()
    assert isinstance(summary.tracking, TrackingSummary)
    assert figures.lateral_m is not None
    assert figures.heading_deg is not None
    assert figures.lateral_m.rms == pytest.approx(summary.tracking.lateral_m.rms, rel=0.01)
    assert figures.lateral_m.max == pytest.approx(summary.tracking.lateral_m.max, rel=0.01)
    assert figures.lateral_m.p95 == pytest.approx(summary.tracking.lateral_m.p95, rel=0.05)
    assert math.radians(figures.heading_deg.rms) == pytest.approx(summary.tracking.heading_rad.rms, rel=0.01)
    assert figures.commands == summary.commands
    assert figures.limited == {name: count for name, count in summary.limited.items() if count}
    assert figures.stops == ["SHUTDOWN stopped"]


def test_what_was_not_driven_has_no_figures() -> None:
    rows = to_columns([one._replace(sent=False) for one in along([0.0, 0.01])])
    stop = LoopEvent(number=1, at_ns=1, kind=EventKind.STOP, name="DEVIATION", phase=Phase.BEGAN, text="stopped")
    figures = measure_drive(rows, way_along_path(rows), [stop, stop], {"speed_mps": 0})
    assert (figures.lateral_m, figures.latency, figures.commands, figures.limited) == (None, None, 0, {})
    values = {row.name: row.values[0] for row in tabulate([figures])}
    assert values["Lateral error: RMS · 95 % · max"] == "–"
    assert values["Stops"] == "2 × DEVIATION stopped"
