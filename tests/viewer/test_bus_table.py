"""The table of messages: counts, rates, ages, errors and values of everything on the buses."""

from pathlib import Path

import cantools
import pytest
from cantools.database import Database

from vehicle_iface.codec.database import load_database
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.units import NS_PER_MS, NS_PER_S
from vehicle_iface_viewer.bus_table.finder import MessageFinder
from vehicle_iface_viewer.bus_table.monitor import MAX_MESSAGES, BusMonitor
from vehicle_iface_viewer.bus_table.report import BusReport, MessageRow
from vehicle_iface_viewer.panels.signals import is_faulty, signals_html

BEGIN_NS = 1000 * NS_PER_S
DBC = Path(__file__).resolve().parents[2] / "dbc" / "reference.dbc"


@pytest.fixture(scope="module")
def dbc() -> Database:
    loaded = cantools.database.load_file(DBC)
    assert isinstance(loaded, Database)
    return loaded


@pytest.fixture
def monitor() -> BusMonitor:
    return BusMonitor(MessageFinder(load_database(load_profile("reference"))))


def drive(seconds: float) -> list[CanFrame]:
    """All frames that the simulated vehicle sends."""
    vehicle = simulated_vehicle(load_database(load_profile("reference")), start_ns=BEGIN_NS)
    frames: list[CanFrame] = []
    while vehicle.next_due_ns < BEGIN_NS + round(seconds * NS_PER_S):
        now_ns = vehicle.next_due_ns
        frames += [frame._replace(stamp_ns=now_ns) for frame in vehicle.advance(now_ns)]
    return frames


def end_ns(frames: list[CanFrame]) -> int:
    return frames[-1].stamp_ns


def row(report: BusReport, name: str) -> MessageRow:
    (found,) = [each for each in report.rows if name in (each.name, each.can_id)]
    return found


def test_rates_ages_and_values_are_those_of_the_frames(monitor: BusMonitor, dbc: Database) -> None:
    frames = drive(3.0)
    monitor.add(frames)
    report = monitor.report(end_ns(frames) + 4 * NS_PER_MS)
    assert report.frames == len(frames)
    assert {each.name for each in report.rows} == {dbc.get_message_by_frame_id(frame.can_id).name for frame in frames}
    for each in report.rows:
        mine = [frame for frame in frames if f"0x{frame.can_id:03X}" == each.can_id]
        span_s = (mine[-1].stamp_ns - mine[0].stamp_ns) / NS_PER_S
        assert each.frames == len(mine)
        assert each.rate_hz == pytest.approx((len(mine) - 1) / span_s, rel=0.02)
        assert each.expected_hz == pytest.approx(each.rate_hz, rel=0.02)
        assert each.age_s == pytest.approx((end_ns(frames) + 4 * NS_PER_MS - mine[-1].stamp_ns) / NS_PER_S)
        assert each.jitter_s == pytest.approx(0.0, abs=1e-6)
        assert (each.is_sent, each.is_bound, each.errors) == (False, True, {})
        expected = dbc.decode_message(each.can_id and int(each.can_id, 16), mine[-1].data)
        assert isinstance(expected, dict)
        for signal in each.signals:
            value = expected[signal.name]
            assert signal.value == (f"{value:.7g}" if isinstance(value, int | float) else str(value))
        assert {signal.name for signal in each.signals} == set(expected)


def test_the_units_are_those_of_the_dbc(monitor: BusMonitor, dbc: Database) -> None:
    monitor.add(drive(0.1))
    shown = row(monitor.report(BEGIN_NS), "MOTION")
    units = {signal.name: signal.unit or "" for signal in dbc.get_message_by_name("MOTION").signals}
    assert {signal.name: signal.unit for signal in shown.signals} == units
    assert any(units.values())


def test_damaged_and_missing_frames_are_counted_by_cause_and_make_their_message_faulty(monitor: BusMonitor) -> None:
    frames = drive(3.0)
    bent = [k for k, frame in enumerate(frames) if frame.can_id == 0x110][100:103]
    for k in bent:
        data = bytearray(frames[k].data)
        data[3] ^= 0x10
        frames[k] = frames[k]._replace(data=bytes(data))
    away = [k for k, frame in enumerate(frames) if frame.can_id == 0x111][150:158]
    monitor.add([frame for k, frame in enumerate(frames) if k not in away])
    report = monitor.report(end_ns(frames))
    assert row(report, "POSE").errors["bad CRC"] == 3
    assert sum(row(report, "MOTION").errors.values()) >= 1
    assert row(report, "CHASSIS").errors == {}
    assert [is_faulty(row(report, name)) for name in ("POSE", "MOTION", "CHASSIS")] == [True, True, False]


def test_frames_that_the_listener_has_lost_are_no_errors_of_the_bus(monitor: BusMonitor) -> None:
    frames = drive(2.0)
    monitor.add(frames[:200])
    monitor.forget_sequences()
    monitor.add(frames[300:])
    assert all(each.errors == {} for each in monitor.report(end_ns(frames)).rows)


def test_a_message_that_ceases_grows_old_and_is_faulty(monitor: BusMonitor) -> None:
    frames = drive(3.0)
    monitor.add(frame for frame in frames if frame.can_id != 0x110 or frame.stamp_ns < BEGIN_NS + NS_PER_S)
    report = monitor.report(end_ns(frames) + NS_PER_S)
    shown = row(report, "POSE")
    assert shown.age_s == pytest.approx(3.0, abs=0.1)
    assert shown.rate_hz == 0.0
    assert is_faulty(shown)


def test_a_rate_that_is_not_the_expected_one_is_faulty_and_jitter_is_the_largest_deviation(monitor: BusMonitor) -> None:
    pose = [frame for frame in drive(1.0) if frame.can_id == 0x110]
    monitor.add(frame._replace(stamp_ns=BEGIN_NS + 12 * NS_PER_MS * k) for k, frame in enumerate(pose))
    report = monitor.report(BEGIN_NS + 12 * NS_PER_MS * len(pose))
    assert row(report, "POSE").rate_hz == pytest.approx(1e3 / 12)
    assert is_faulty(row(report, "POSE"))
    late = pose[-1]._replace(stamp_ns=BEGIN_NS + 12 * NS_PER_MS * len(pose) + 6 * NS_PER_MS)
    monitor.add([late])
    jitter_s = row(monitor.report(late.stamp_ns), "POSE").jitter_s
    assert jitter_s == pytest.approx(0.006, rel=0.05)


def test_what_is_in_no_dbc_is_listed_with_its_data_and_only_so_many(monitor: BusMonitor) -> None:
    monitor.add([CanFrame(0x700, b"\x01\xab", BEGIN_NS), CanFrame(0x1ABCDE, b"", BEGIN_NS, is_extended=True)])
    monitor.add(CanFrame(0x1000 + k, b"\0", BEGIN_NS, is_extended=True) for k in range(MAX_MESSAGES))
    monitor.add([CanFrame(0, b"\0" * 8, BEGIN_NS, is_error=True)])
    report = monitor.report(BEGIN_NS)
    unknown = row(report, "0x700")
    assert (unknown.name, unknown.data, unknown.signals, unknown.expected_hz) == ("", "01 AB", [], None)
    assert row(report, "0x001ABCDE").frames == 1
    assert (len(report.rows), report.unlisted, report.error_frames) == (MAX_MESSAGES, 2, 1)
    assert report.frames == MAX_MESSAGES + 3


def test_what_the_loop_sends_is_marked_and_checked(monitor: BusMonitor, dbc: Database) -> None:
    data = dbc.get_message_by_name("DRIVE_COMMAND").encode(
        {signal.name: 0 for signal in dbc.get_message_by_name("DRIVE_COMMAND").signals}, strict=False
    )
    monitor.add([CanFrame(0x080, data[:-1] + b"\x55", BEGIN_NS)])
    shown = row(monitor.report(BEGIN_NS), "DRIVE_COMMAND")
    assert (shown.is_sent, shown.is_bound) == (True, True)
    assert sum(shown.errors.values()) == 1


def test_a_frame_that_is_too_short_has_no_values_and_is_counted(monitor: BusMonitor) -> None:
    monitor.add([CanFrame(0x110, b"\x01", BEGIN_NS)])
    shown = row(monitor.report(BEGIN_NS), "POSE")
    assert (shown.errors, shown.signals, shown.data) == ({"wrong length": 1}, [], "01")


def test_a_value_outside_the_range_of_the_dbc_is_marked_and_one_that_changed_as_well(monitor: BusMonitor) -> None:
    frames = [frame for frame in drive(0.5) if frame.can_id == 0x111]
    monitor.add(frames[:1])
    assert not any(signal.has_changed for signal in row(monitor.report(BEGIN_NS), "MOTION").signals)
    monitor.add([frames[1]._replace(data=b"\xff" * len(frames[1].data))])
    changed = row(monitor.report(BEGIN_NS), "MOTION").signals
    assert any(signal.has_changed for signal in changed)
    assert any(signal.is_out_of_range for signal in changed)


def test_both_buses_of_a_profile_are_listed_with_their_names() -> None:
    profile = load_profile("agilex_hunter_ins")
    database = load_database(profile)
    names = list(profile.all_buses)
    of_bus = {number: next(m for m in database.received if m.bus == number) for number in range(len(names))}
    monitor = BusMonitor(MessageFinder(database))
    monitor.add(
        CanFrame(m.can_id, bytes(m.length), BEGIN_NS, m.is_extended, bus=number) for number, m in of_bus.items()
    )
    shown = {each.bus: each.name for each in monitor.report(BEGIN_NS).rows}
    assert shown == {names[number]: message.name for number, message in of_bus.items()}


def test_the_page_lists_faulty_messages_first_and_only_what_is_searched_for(monitor: BusMonitor) -> None:
    frames = drive(1.0)
    monitor.add(frame for frame in frames if frame.can_id != 0x112 or frame.stamp_ns < BEGIN_NS + NS_PER_S // 2)
    report = monitor.report(end_ns(frames))
    content = signals_html(report)
    assert content.index("CHASSIS") < content.index("POSE")
    assert "YAW_RATE" in content
    only = signals_html(report, "yaw_rate")
    assert "YAW_RATE" in only
    assert "MOTION" in only
    assert "POSE" not in only
    assert "SPEED<" not in only
    assert "POS_X" in signals_html(report, "0x110")
    assert "0 of " in signals_html(report, "nothing of that name")


def test_the_page_shows_names_of_a_dbc_and_problems_as_text_and_is_bounded() -> None:
    bad = '<b onclick="x">'
    rows = [MessageRow(bus=bad, can_id=bad, name=bad, frames=1, rate_hz=0.0, age_s=0.0, data=bad)] * 500
    content = signals_html(BusReport(rows=rows, problem=bad))
    assert bad not in content
    assert content.count("vi-head") == 80
    assert "more, not shown" in content
    assert "the listener is starting" in signals_html(None)
