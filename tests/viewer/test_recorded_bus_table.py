"""The table of messages at the time that a recording shows."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import cantools
import pytest
from cantools.database import Database

from vehicle_iface.codec.database import load_database
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.recorder import files
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.telemetry import SessionInfo, WriterState
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.bus_table.finder import MessageFinder
from vehicle_iface_viewer.bus_table.monitor import BusMonitor
from vehicle_iface_viewer.bus_table.recorded import RecordedBusTable
from vehicle_iface_viewer.bus_table.report import BusReport
from vehicle_iface_viewer.feed import View

DBCS = Path(__file__).resolve().parents[2] / "dbc"
BEGIN_NS = 1000 * NS_PER_S
OFFSET_NS = 1_795_331_353 * NS_PER_S
LENGTH_S = 12


@pytest.fixture(scope="module")
def frames() -> list[CanFrame]:
    vehicle = simulated_vehicle(load_database(load_profile("reference")), start_ns=BEGIN_NS)
    found: list[CanFrame] = []
    while (at_ns := vehicle.next_due_ns) < BEGIN_NS + LENGTH_S * NS_PER_S:
        found += [frame._replace(stamp_ns=at_ns) for frame in vehicle.advance(at_ns)]
    return found


def log_line(frame: CanFrame) -> str:
    seconds, rest_ns = divmod(frame.stamp_ns + OFFSET_NS, NS_PER_S)
    return f"({seconds:010d}.{rest_ns // 1000:06d}) vcan0 {frame.can_id:03X}#{frame.data.hex().upper()}\n"


@pytest.fixture
def folder(tmp_path: Path, frames: list[CanFrame]) -> Path:
    (tmp_path / files.FRAMES).write_text("".join(map(log_line, frames)))
    (tmp_path / files.PROFILE).mkdir()
    for name in ("reference.toml", "reference.dbc"):
        shutil.copy(DBCS / name, tmp_path / files.PROFILE)
    return tmp_path


@pytest.fixture
def table(folder: Path) -> Iterator[RecordedBusTable]:
    opened = RecordedBusTable(str(folder), OFFSET_NS, None)
    yield opened
    opened.close()


def read(table: RecordedBusTable, at_s: float, *, session: int = 1) -> BusReport:
    info = SessionInfo(channel="vcan0", bus="SocketCAN vcan0", profile="reference")
    now_ns = BEGIN_NS + round(at_s * NS_PER_S)
    view = View(now_ns=now_ns, address="a", writer_state=WriterState.LIVE, session=session, info=info)
    report = table.read(view)
    assert report is not None
    return report


def expected(frames: list[CanFrame], begin_s: float, end_s: float) -> BusReport:
    """The report of a monitor that received the frames of that time."""
    monitor = BusMonitor(MessageFinder(load_database(load_profile("reference"))))
    begin_ns, end_ns = (BEGIN_NS + round(at_s * NS_PER_S) for at_s in (begin_s, end_s))
    monitor.add(frame for frame in frames if begin_ns < frame.stamp_ns <= end_ns)
    return monitor.report(end_ns)


def test_the_table_is_that_of_the_frames_up_to_the_time_that_is_shown(
    table: RecordedBusTable, frames: list[CanFrame]
) -> None:
    assert read(table, 5.0) == expected(frames, 3.0, 5.0)
    later = read(table, 5.6)
    assert later.frames == expected(frames, 3.0, 5.6).frames
    assert [row.data for row in later.rows] == [row.data for row in expected(frames, 3.0, 5.6).rows]
    assert all(row.errors == {} for row in later.rows)


def test_it_is_read_twice_a_second_only(table: RecordedBusTable) -> None:
    first = read(table, 5.0)
    assert read(table, 5.4) is first
    assert read(table, 5.5) is not first


def test_a_jump_begins_with_the_two_seconds_before_it(table: RecordedBusTable, frames: list[CanFrame]) -> None:
    read(table, 9.0)
    assert read(table, 4.0, session=2) == expected(frames, 2.0, 4.0)
    assert read(table, 11.0, session=3) == expected(frames, 9.0, 11.0)


def test_frames_that_a_fast_playback_leaves_out_are_no_errors(
    table: RecordedBusTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vehicle_iface_viewer.bus_table.recorded._MOST_LINES", 500)
    read(table, 2.0)
    report = read(table, 11.0)
    assert report.frames < 2000
    assert all(row.errors == {} for row in report.rows)


def test_damaged_lines_and_those_of_other_buses_are_left_out_and_error_frames_counted(
    folder: Path, frames: list[CanFrame]
) -> None:
    lines = (folder / files.FRAMES).read_text().splitlines(keepends=True)
    stamp = lines[100].partition(" ")[0]
    extra = [f"{stamp} vcan9 110#00\n", f"{stamp} vcan0 zz\n", f"{stamp} vcan0 FFFFFFFF#00\n", f"{stamp} vcan0 110#R\n"]
    extra += [f"{stamp} vcan0 20000004#0000000000000000\n", f"{stamp} vcan0 1ABCDEF0##100112233445566778899\n"]
    (folder / files.FRAMES).write_text("".join([*lines[:101], *extra, *lines[101:]]))
    table = RecordedBusTable(str(folder), OFFSET_NS, None)
    report = read(table, 1.0)
    table.close()
    plain = expected(frames, -1.0, 1.0)
    assert report.frames == plain.frames + 2
    assert report.error_frames == 1
    assert report.rows[-1].can_id == "0x1ABCDEF0"
    assert report.rows[:-1] == plain.rows


def test_a_recording_without_frames_or_profile_says_so(folder: Path) -> None:
    shutil.rmtree(folder / files.PROFILE)
    table = RecordedBusTable(str(folder), OFFSET_NS, None)
    assert "no profile; give it with --profile FILE" in read(table, 1.0).problem
    table.close()
    given = RecordedBusTable(str(folder), OFFSET_NS, "reference")
    assert len(read(given, 1.0).rows) == 4
    given.close()
    (folder / files.FRAMES).unlink()
    empty = RecordedBusTable(str(folder), OFFSET_NS, "reference")
    assert (read(empty, 1.0).note, read(empty, 1.0).problem) == ("No frames were recorded.", "")
    empty.close()


def test_python_code_in_a_recording_is_not_run(folder: Path, tmp_path: Path) -> None:
    shutil.rmtree(folder / files.PROFILE)
    (folder / files.PROFILE).mkdir()
    mark = tmp_path / "was-run"
    for name in ("j1939_truck.toml", "j1939_truck.dbc", "j1939_checksums.py"):
        shutil.copy(DBCS / name, folder / files.PROFILE)
    code = folder / files.PROFILE / "j1939_checksums.py"
    code.write_text(f"open({str(mark)!r}, 'w').close()\n" + code.read_text())
    table = RecordedBusTable(str(folder), OFFSET_NS, None)
    assert "would run Python code of the recording (j1939_checksums.py)" in read(table, 1.0).problem
    assert not mark.exists()
    table.close()


def test_each_browser_has_a_table_of_its_own_time(table: RecordedBusTable, frames: list[CanFrame]) -> None:
    other = table.fork()
    read(table, 3.0)
    assert other._report is None
    assert read(other, 5.0) == expected(frames, 3.0, 5.0)
    assert read(table, 3.1).frames == read(table, 3.0).frames


def test_a_plotted_signal_has_each_sample_of_the_last_two_minutes_up_to_the_time_that_is_shown(
    table: RecordedBusTable, frames: list[CanFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    name, dbc = "POSE.POS_X, m", cantools.database.load_file(DBCS / "reference.dbc")
    assert isinstance(dbc, Database)

    def expected_samples(until_s: float) -> list[tuple[int, float]]:
        of = [each for each in frames if each.can_id == 0x110 and each.stamp_ns <= BEGIN_NS + round(until_s * NS_PER_S)]
        values = [str(dict(dbc.decode_message(0x110, each.data))["POS_X"]) for each in of]
        return [(frame.stamp_ns, float(value)) for frame, value in zip(of, values, strict=True)]

    read(table, 9.0)
    other = table.fork()
    table.signals.want(name)
    for at_s in (9.0, 9.25, 11.0):
        read(table, at_s)
        assert table.signals.between(name, 0, 1 << 62).tolist() == expected_samples(at_s)
    read(table, 4.0, session=2)
    assert table.signals.between(name, 0, 1 << 62).tolist() == expected_samples(4.0)
    assert other.signals.offered == ()
    monkeypatch.setattr("vehicle_iface_viewer.bus_table.recorded._MOST_SEARCHED_LINES", 1500)
    read(table, 5.0, session=3)
    assert len(table.signals.between(name, 0, 1 << 62)) < len(expected_samples(5.0))
    for _ in range(3):
        read(table, 5.0, session=3)
    assert table.signals.between(name, 0, 1 << 62).tolist() == expected_samples(5.0)
