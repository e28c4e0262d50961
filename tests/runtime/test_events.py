"""Events of a run: what happened is in the list, in the summary and on the telemetry."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tests.harness import Drive, straight
from vehicle_iface.runtime.activity import QUIET_NS, Activity, Change
from vehicle_iface.runtime.event_log import MAX_EVENTS, EventLog
from vehicle_iface.runtime.summary import table
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.telemetry import SessionInfo, TelemetryReader, TelemetryWriter
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.telemetry.layout import EVENT_SLOTS
from vehicle_iface.trajectories.mailbox import Mailbox

ONCE, BEGAN, ENDED = Phase.ONCE, Phase.BEGAN, Phase.ENDED


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[TelemetryWriter]:
    with TelemetryWriter(str(tmp_path / "loop"), SessionInfo(channel="embedded", bus="embedded")) as opened:
        yield opened


@pytest.fixture
def reader(writer: TelemetryWriter) -> Iterator[TelemetryReader]:
    with TelemetryReader(writer.address) as opened:
        opened.poll()
        yield opened


def events(drive: Drive, kind: EventKind) -> list[tuple[str, Phase]]:
    return [(event.name, event.phase) for event in drive.loop.events.log.kept if event.kind is kind]


def texts(drive: Drive, kind: EventKind) -> list[tuple[str, str]]:
    return [(event.name, event.text) for event in drive.loop.events.log.kept if event.kind is kind]


def end(drive: Drive) -> Drive:
    drive.loop.shutdown.request()
    drive.run_s(20.0)
    assert drive.loop.shutdown.is_done
    return drive


def test_a_drive_stopped_for_deviation_has_the_stop_in_its_summary_and_in_its_table() -> None:
    drive = Drive(start=BicycleState(y_m=3.2)).engage()
    drive.run_s(0.5)
    summary = end(drive).loop.summary()
    assert (summary.controller_state, summary.reason) == ("STANDBY", "SHUTDOWN")
    assert [(stop.reason, stop.reaction) for stop in summary.stops] == [
        ("DEVIATION", "stopped"),
        ("SHUTDOWN", "stopped"),
    ]
    assert summary.stops[0].duration_s == pytest.approx(0.5, abs=0.1)
    line, _ = (line for line in table(summary).splitlines() if line.lstrip().startswith("stop "))
    assert f"DEVIATION at {summary.stops[0].at_s:.1f} s" in line


def test_a_drive_without_a_stop_has_only_that_of_its_end() -> None:
    drive = Drive().engage(3.0)
    assert drive.loop.summary().stops == []
    summary = end(drive).loop.summary()
    assert [(stop.reason, stop.reaction) for stop in summary.stops] == [("SHUTDOWN", "stopped")]


def test_engaging_between_two_samples_is_no_stop() -> None:
    drive = Drive()
    drive.send_line("brake 1")
    drive.run_s(1.0)
    drive.send_line("mute STATE on")
    drive.send_line("brake 0")
    drive.run_s(0.05)
    assert drive.mode() is Mode.ENGAGING
    drive.send_line("mute STATE off")
    drive.engage()
    assert "NOT_ENGAGED" not in {name for name, _ in events(drive, EventKind.STOP)}


def test_a_stop_begins_with_its_first_command_and_ends_with_the_first_that_drives_on() -> None:
    drive = Drive().engage(3.0)
    drive.send_line("mute POSE on")
    drive.run_s(0.3)
    drive.send_line("mute POSE off")
    drive.run_s(3.0)
    assert events(drive, EventKind.STOP) == [("STATE_STALE", BEGAN), ("STATE_STALE", ENDED)]
    began, ended = (event.at_ns for event in drive.loop.events.log.kept if event.kind is EventKind.STOP)
    stale = [pair.at_ns for pair in drive.pairs() if pair["REASON"] == 6]
    assert began == stale[0]
    assert 0 < ended - stale[-1] <= 20_000_000


def test_a_driver_override_is_a_stop_that_released_until_armed() -> None:
    drive = Drive().engage(3.0)
    drive.send_line("brake 1")
    drive.run_s(0.2)
    (stop,) = drive.loop.summary().stops
    assert (stop.reason, stop.reaction) == ("DRIVER_OVERRIDE", "released")
    drive.send_line("brake 0")
    drive.loop.arming.request()
    drive.run_s(0.1)
    assert events(drive, EventKind.STOP)[-1] == ("DRIVER_OVERRIDE", ENDED)
    assert texts(drive, EventKind.REQUEST) == [("arm", "accepted")]


def test_a_lost_link_is_a_latched_silent_stop_and_an_event_of_the_link() -> None:
    drive = Drive().engage(3.0)
    drive.line.down = True
    drive.run_s(1.0)
    (stop,) = drive.loop.summary().stops
    assert (stop.reason, stop.reaction, stop.latched) == ("LINK_DOWN", "silent", True)
    assert texts(drive, EventKind.LINK) == [("DOWN", "tap: cut")]


def test_modes_and_requests_are_events_in_their_order() -> None:
    drive = Drive().engage()
    drive.loop.arming.request()
    drive.run_s(0.1)
    end(drive)
    assert [name for name, _ in texts(drive, EventKind.MODE)] == [
        "STARTING",
        "STANDBY",
        "ENGAGING",
        "ENGAGED",
        "ENDING",
        "RELEASED",
    ]
    assert texts(drive, EventKind.REQUEST) == [("arm", "rejected: it drives"), ("end", "by request")]
    numbers = [event.number for event in drive.loop.events.log.kept]
    assert numbers == list(range(1, len(numbers) + 1))


def test_a_second_request_is_an_event_of_its_own() -> None:
    drive = Drive().engage(3.0)
    drive.loop.shutdown.request()
    drive.run_s(0.1)
    drive.loop.shutdown.request()
    drive.run_s(0.1)
    assert texts(drive, EventKind.REQUEST) == [("end", "by request"), ("release at once", "")]


def test_a_limit_that_acts_is_an_event_at_its_beginning_and_its_end() -> None:
    drive = Drive().engage(4.5)
    drive.run_s(3.0)
    assert events(drive, EventKind.LIMIT) == [("accel_mps2", BEGAN), ("accel_mps2", ENDED)]
    summary = drive.loop.summary()
    limit = summary.limits["accel_mps2"]
    assert (limit.commands, limit.times) == (summary.limited["accel_mps2"], 1)
    assert limit.duration_s == pytest.approx(limit.commands * 0.01, abs=0.1)


def test_a_limit_that_still_acts_is_in_the_summary() -> None:
    drive = Drive().engage(0.5)
    assert events(drive, EventKind.LIMIT) == [("accel_mps2", BEGAN)]
    assert drive.loop.summary().limits["accel_mps2"].times == 1


def test_trajectories_are_events_with_the_reason_of_a_rejection() -> None:
    mailbox = Mailbox()
    drive = Drive(mailbox)
    drive.run_s(1.0)
    for _ in range(3):
        mailbox.put(straight(length_m=50.0))
        drive.run_s(0.1)
    sharp = straight(length_m=20.0)
    mailbox.put(replace(sharp, stamp_ns=drive.clock.t_ns + 20_000_000_000))
    drive.run_s(0.1)
    (accepted, rejected) = texts(drive, EventKind.TRAJECTORY)
    assert accepted == ("accepted", "51 points")
    assert rejected[0] == "rejected"
    assert "ahead of time.monotonic_ns()" in rejected[1]


def test_commands_that_come_late_are_a_missed_deadline() -> None:
    drive = Drive().engage(3.0)
    drive.stall(0.045)
    drive.run_s(1.0)
    assert [name for name, _ in events(drive, EventKind.DEADLINE)] == ["deadline_misses"] * 2


def test_dropped_frames_are_events_by_cause_and_message() -> None:
    drive = Drive().engage(3.0)
    drive.send_line("corrupt POSE 3")
    drive.run_s(2.0)
    assert ("dropped: bad CRC POSE", BEGAN) in events(drive, EventKind.FAULT)


def test_the_telemetry_and_the_summary_have_the_same_events(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    drive = Drive(telemetry=writer).engage(3.0)
    drive.send_line("brake 1")
    drive.run_s(0.5)
    kept = end(drive).loop.events.log.kept
    assert reader.events() == kept
    assert reader.events(after=3) == kept[3:]
    told = drive.loop.summary().events
    assert [(event.name, event.phase, event.text) for event in told] == [(e.name, e.phase, e.text) for e in kept]


def test_the_list_keeps_the_newest_events_and_counts_the_others() -> None:
    log = EventLog()
    for number in range(MAX_EVENTS + 7):
        log.add(number, EventKind.REASON, str(number))
    assert (log.count, len(log.kept), log.kept[0].number) == (MAX_EVENTS + 7, MAX_EVENTS, 8)


def test_a_reader_gets_what_is_left_of_events_that_were_overwritten(
    writer: TelemetryWriter, reader: TelemetryReader
) -> None:
    for number in range(1, EVENT_SLOTS + 11):
        writer.publish_event(LoopEvent(number=number, at_ns=number, kind=EventKind.REASON, name="NOMINAL"))
    assert [event.number for event in reader.events(after=2)] == list(range(11, EVENT_SLOTS + 11))


@pytest.mark.parametrize("text", ["x" * 600, "\u20ac" * 600, '"' * 600, "\x01" * 600])
def test_a_long_text_is_shortened(writer: TelemetryWriter, reader: TelemetryReader, text: str) -> None:
    writer.publish_event(LoopEvent(number=1, at_ns=1, kind=EventKind.LINK, name="n" * 100, text=text))
    (event,) = reader.events()
    assert event.text.endswith("…")
    assert text.startswith(event.text[:-1])


def test_a_count_ends_to_rise_when_it_was_quiet_for_a_while() -> None:
    counts = {"a": 3, "b": 0}
    activity = Activity(lambda: counts)
    assert activity.poll(0) == []
    counts["a"] += 2
    assert activity.poll(10) == [Change(10, "a", BEGAN, 2, 0)]
    counts["a"] += 1
    assert activity.poll(20) == []
    assert activity.poll(19 + QUIET_NS) == []
    assert activity.poll(20 + QUIET_NS) == [Change(20, "a", ENDED, 3, 10)]
    counts["a"] += 1
    assert [change.phase for change in activity.poll(21 + QUIET_NS)] == [BEGAN]
