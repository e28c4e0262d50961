"""The HTML page of a drive: its numbers are those of the recording, it needs nothing else, and it is small."""

import math
import random
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.export.recorded import Recorded, mute_state, record_drive
from tests.export.unpacked import curve, read_page, unpack
from vehicle_iface.cli import main
from vehicle_iface.export.columns import to_columns
from vehicle_iface.export.figures import measure_drive, tabulate
from vehicle_iface.export.page.drive import load_drive
from vehicle_iface.export.page.packing import pack
from vehicle_iface.export.page.plots import PLOTS
from vehicle_iface.export.page.reduction import MAX_ROWS, Reduction
from vehicle_iface.export.page.render import SCRIPTS, render_drive
from vehicle_iface.export.recording import RecordedDrive
from vehicle_iface.export.way import offset_m, way_along_path
from vehicle_iface.reason import Reason
from vehicle_iface.recorder import files
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.columns import ROUNDING_MPS2, is_limited
from vehicle_iface.telemetry.events import EventKind, LoopEvent, limit_spans

PAGE_FOLDER = Path(files.__file__).parents[1] / "export" / "page"
TEN_MINUTES = 60_000
"""Snapshots at 100 Hz."""


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A drive whose state is missing for a while."""
    return record_drive(tmp_path_factory.mktemp("page"), 5.0, act=mute_state)


@pytest.fixture(scope="module")
def page_file(drive: Recorded) -> Path:
    file = drive.folder.parent / "drive.html"
    assert main(["export", str(drive.folder), "--html", str(file)]) == 0
    return file


def test_numbers_of_the_page_are_those_of_the_recording(drive: Recorded, page_file: Path) -> None:
    page, shown = read_page(page_file), drive.shown
    times_s = [(one.published_ns - shown[0].published_ns) / 1e9 for one in shown]
    assert unpack(page.drives[0].time) == pytest.approx(times_s, abs=1e-4)
    sent = curve(page, "sent_front_wheel_angle_deg")
    expected = [math.degrees(one.sent_front_wheel_angle_rad) if one.sent else math.nan for one in shown]
    assert sent == pytest.approx(expected, abs=1e-4, nan_ok=True)
    requested = curve(page, "requested_accel_mps2")
    expected = [one.requested_accel_mps2 if one.has_requested else math.nan for one in shown]
    assert requested == pytest.approx(expected, abs=1e-4, nan_ok=True)
    track = page.drives[0].track
    assert track is not None
    assert unpack(track.x) == pytest.approx(
        [one.x_m if one.has_state else math.nan for one in shown], abs=1e-3, nan_ok=True
    )
    reference = [one.spatial_reference_y_m if one.has_reference else math.nan for one in shown]
    assert unpack(track.reference_y) == pytest.approx(reference, abs=1e-3, nan_ok=True)


def test_an_old_state_is_a_gap_and_no_ramp(drive: Recorded, page_file: Path) -> None:
    page, shown = read_page(page_file), drive.shown
    speed = curve(page, "speed_mps")
    is_old = np.array([not one.has_state or one.published_ns - one.stamp_ns >= 100_000_000 for one in shown])
    assert is_old.sum() > 30
    assert np.array_equal(np.isnan(speed), is_old)


def test_a_command_that_a_stop_has_replaced_is_not_limited(drive: Recorded) -> None:
    rows = to_columns(drive.shown)
    differs = np.abs(rows["requested_accel_mps2"] - rows["sent_accel_mps2"]) > 0.1
    is_nominal = rows["reason"] == Reason.NOMINAL
    assert (differs & rows["has_requested"] & rows["sent"] & ~is_nominal).any()
    limited = is_limited(rows, "accel_mps2", ROUNDING_MPS2)
    assert limited[is_nominal].any()
    assert not limited[~is_nominal].any()


def test_ticks_of_limited_commands_are_where_the_gate_says_so(drive: Recorded, page_file: Path) -> None:
    (ticks,) = [one for one in read_page(page_file).drives[0].ticks if one.label == "limited commands"]
    begin_ns, end_ns = drive.shown[0].published_ns, drive.shown[-1].published_ns
    spans = list(limit_spans(drive.driven.loop.events.log.kept, begin_ns, end_ns))
    spans_s = [((begin - begin_ns) / 1e9, (end - begin_ns) / 1e9) for begin, end in spans]
    assert ticks.at_s
    for at_s in ticks.at_s:
        assert any(begin - 0.1 <= at_s <= end + 0.1 for begin, end in spans_s)
    for begin, end in spans_s:
        assert any(begin - 0.1 <= at_s <= end + 0.1 for at_s in ticks.at_s)


def test_events_and_states_of_the_page_are_those_of_the_loop(drive: Recorded, page_file: Path) -> None:
    shown = read_page(page_file).drives[0]
    kept = sorted(drive.driven.loop.events.log.kept, key=lambda event: event.at_ns)
    assert [(one.kind, one.name) for one in shown.events] == [(one.kind, one.name) for one in kept]
    states = [span.state for span in shown.states]
    expected = [ControllerState(one.controller_state).name for one in drive.shown]
    assert [state for state, after in zip(states, [*states[1:], ""], strict=True) if state != after] == [
        state for state, after in zip(expected, [*expected[1:], ""], strict=True) if state != after
    ]
    assert {"STATE_STALE"} < {span.reason for span in shown.states}


def test_a_page_asks_for_nothing_and_its_scripts_are_inside(page_file: Path) -> None:
    text = page_file.read_text()
    assert "default-src 'none'" in text
    assert not re.search(r"https?:|//cdn|<link|<img|\ssrc=|@import|url\(", text)
    assert {path.name for path in PAGE_FOLDER.glob("*.js")} == set(SCRIPTS)
    assert all((PAGE_FOLDER / name).read_text() in text for name in SCRIPTS)


def test_every_colour_is_defined_for_light_and_dark() -> None:
    light, dark = (PAGE_FOLDER / "page.css").read_text().split("prefers-color-scheme: dark", 1)
    names = {state.name for state in ControllerState} | {one.color for plot in PLOTS for one in plot.curves}
    names |= {"drive-a", "drive-b", "limit", "path", "dropped", "late", "ground", "ink", "grid"}
    assert {name for name in names if f"--{name}:" not in light or f"--{name}:" not in dark} == set()


def test_markup_in_an_event_cannot_end_the_script(drive: Recorded, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(drive.folder, tmp_path / "<b>copy"))
    hostile = LoopEvent(number=99, at_ns=drive.shown[9].published_ns, kind=EventKind.FAULT, name="</script><script>x")
    with (copy / files.EVENTS).open("ab") as file:
        file.write(files.format_event(hostile))
    assert main(["export", str(copy), "--html", str(tmp_path / "d.html")]) == 0
    assert (tmp_path / "d.html").read_text().count("</script>") == 2
    assert "<b>copy" not in (tmp_path / "d.html").read_text()
    assert hostile.name in [event.name for event in read_page(tmp_path / "d.html").drives[0].events]


def test_a_window_has_only_its_rows_with_times_of_the_whole(drive: Recorded, tmp_path: Path) -> None:
    file = tmp_path / "d.html"
    assert main(["export", str(drive.folder), "--html", str(file), "--from", "1", "--to", "1.5"]) == 0
    times_s = unpack(read_page(file).drives[0].time)
    assert times_s[0] == pytest.approx(1.0, abs=0.011)
    assert times_s[-1] == pytest.approx(1.5, abs=0.011)


def test_a_window_without_a_snapshot_is_refused(drive: Recorded, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(drive.folder), "--html", "/dev/null", "--from", "100"]) == 2
    assert "no snapshot between --from and --to" in capsys.readouterr().err


def test_ten_minutes_of_noise_fit_into_5_mb(drive: Recorded, monkeypatch: pytest.MonkeyPatch) -> None:
    noise = np.random.default_rng(1)
    driving = next(one for one in drive.shown if one.sent)

    def snapshots(_: RecordedDrive) -> list[Snapshot]:
        values = noise.normal(size=(TEN_MINUTES, 12))
        return [
            driving._replace(
                published_ns=10_000_000 * (number + 1),
                stamp_ns=10_000_000 * (number + 1) - int(1e6 * abs(row[0])),
                x_m=0.1 * number + row[1],
                y_m=row[2],
                heading_rad=row[3],
                speed_mps=10 + row[4],
                accel_mps2=row[5],
                front_wheel_angle_rad=0.1 * row[6],
                has_reference=True,
                lateral_error_m=0.3 * row[7],
                heading_error_rad=0.1 * row[8],
                requested_accel_mps2=row[9],
                sent_accel_mps2=row[10],
                requested_front_wheel_angle_rad=0.1 * row[11],
                latency_ns=int(1e6 * abs(row[0])),
            )
            for number, row in enumerate(values.tolist())
        ]

    monkeypatch.setattr(RecordedDrive, "snapshots", snapshots)
    assert 1_000_000 < len(render_drive(load_drive(RecordedDrive(drive.folder)))) < 5_000_000


def test_numbers_survive_packing_and_what_does_not_fit_is_unknown() -> None:
    values = np.array([0.0, -1.25, math.nan, 3e5, math.inf, 1e12, -214_748.3647])
    assert unpack(pack(values, 4)).tolist() == pytest.approx(
        [0.0, -1.25, math.nan, math.nan, math.nan, math.nan, -214_748.3647], nan_ok=True
    )
    assert unpack(pack(np.array([5_800_000.125]), 3, offset=5_800_000.0)).tolist() == [5_800_000.125]


def test_a_long_drive_keeps_the_extremes_of_every_group() -> None:
    values = np.random.default_rng(2).normal(size=3 * MAX_ROWS)
    values[[1000, 200_000]] = 50.0, -50.0
    values[300_000:310_000] = np.nan
    reduction = Reduction.of(len(values))
    kept = reduction.extremes(values)
    assert len(kept) == len(reduction.pick(values)) <= MAX_ROWS
    assert (np.nanmax(kept), np.nanmin(kept)) == (50.0, -50.0)
    assert np.isnan(kept).sum() == pytest.approx(10_000 / 3, abs=8)
    assert Reduction.of(MAX_ROWS).extremes(values) is values


def test_a_gap_between_snapshots_becomes_unknown() -> None:
    one = Snapshot(published_ns=1, controller_state=3, reason=0, has_state=True, sent=True)
    rows = to_columns([one._replace(published_ns=at_ns) for at_ns in (2_000_000_000, 1_000_000, 11_000_000)])
    assert rows["published_ns"].tolist() == [1_000_000, 11_000_000, 11_000_001, 2_000_000_000]
    assert rows["has_state"].tolist() == [True, True, False, True]
    assert rows["controller_state"].tolist() == [3, 3, -1, 3]


@pytest.mark.parametrize("damaged_ns", [10**30, 10**17])
def test_a_row_with_a_damaged_time_is_left_out(damaged_ns: int) -> None:
    one = Snapshot(published_ns=1, controller_state=3, reason=0)
    assert len(to_columns([one, one._replace(published_ns=2), one._replace(published_ns=damaged_ns)])) == 2


def test_absurd_numbers_of_a_damaged_recording_are_unknown_and_break_nothing() -> None:
    chance = random.Random(1)
    choices: dict[type, list[object]] = {
        int: [0, 1, -5, 2**60, -(2**60)],
        bool: [False, True],
        float: [0.0, 1.5, -3.0, math.nan, math.inf, -math.inf, 1e300, -1e308],
        str: ["map"],
    }
    kinds = [type(value) for value in Snapshot(published_ns=0, controller_state=0, reason=0)]
    for count in (1, 2, 3, 10, 50) * 20:
        rows = to_columns(Snapshot(*(chance.choice(choices[kind]) for kind in kinds)) for _ in range(count))  # type: ignore[arg-type]
        way_m = way_along_path(rows)
        assert np.isfinite(way_m).all()
        offset_m(rows, way_m, rows, way_m)
        assert tabulate([measure_drive(rows, way_m, [], {})])
        for plot in PLOTS:
            for one in plot.curves:
                values = unpack(pack(one.read(rows), 4))
                assert np.all(np.isnan(values) | (np.abs(values) < 1e9))
