"""The listener's process: for which session it is started, what it reports, and how it ends."""

import os
import select
import socket
import struct
import time
from collections.abc import Iterator

import msgspec
import pytest

from vehicle_iface import clock
from vehicle_iface.bus import listening
from vehicle_iface.bus.receive import SO_TIMESTAMPNS
from vehicle_iface.errors import ConfigError
from vehicle_iface.telemetry import SessionInfo, WriterState
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.bus_table.listener import Listener
from vehicle_iface_viewer.bus_table.report import BusReport, BusSamples, MessageRow, Samples, SignalValue
from vehicle_iface_viewer.bus_table.source import NO_FRAMES, ListenerProcess, has_frames
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.signals import signals_html


def view(session: int, *, bus: str = "SocketCAN absent7", channel: str = "absent7", profile: str = "reference") -> View:
    info = SessionInfo(channel=channel, bus=bus, profile=profile)
    return View(now_ns=0, address="a", writer_state=WriterState.LIVE, session=session, info=info)


@pytest.fixture
def source() -> Iterator[ListenerProcess]:
    opened = ListenerProcess(None)
    yield opened
    opened.close()


def wait_for_report(source: ListenerProcess, of: View) -> BusReport:
    while (report := source.read(of)) is None:
        process = source._process
        assert process is not None
        assert process.stdout is not None
        select.select([process.stdout], [], [])
    return report


def test_a_bus_that_is_absent_is_named_and_asked_for_again(source: ListenerProcess) -> None:
    first = wait_for_report(source, view(1))
    assert (first.rows, first.frames) == ([], 0)
    assert "absent7" in first.problem or "no SocketCAN" in first.problem
    process = source._process
    assert process is not None
    assert process.poll() is None


def test_a_session_without_a_bus_of_its_own_or_a_known_profile_has_no_listener(source: ListenerProcess) -> None:
    embedded = source.read(view(1, bus="embedded bus (no SocketCAN used)"))
    assert embedded is not None
    assert (embedded.note, embedded.problem) == (NO_FRAMES, "")
    sessions = (None, view(1).info, view(1, bus="embedded bus (no SocketCAN used)").info)
    assert [has_frames(each) for each in sessions] == [True, True, False]
    shown = signals_html(embedded)
    assert "there are no frames to list" in shown
    assert "vi-bad" not in shown
    other = source.read(view(2, profile="mine"))
    assert other is not None
    assert "start view with --profile FILE" in other.problem
    assert source._process is None


def test_a_profile_of_another_name_than_the_loops_is_refused() -> None:
    source = ListenerProcess("reference_fd")
    report = source.read(view(1))
    assert report is not None
    assert "view --profile is reference_fd, and the loop drives reference" in report.problem
    with pytest.raises(ConfigError, match=r"missing\.toml"):
        ListenerProcess("missing.toml")


def test_a_new_session_starts_another_listener_and_ends_the_old_one(source: ListenerProcess) -> None:
    wait_for_report(source, view(1))
    old = source._process
    wait_for_report(source, view(2))
    assert old is not None
    assert old.poll() is not None
    assert source._process is not old


def test_a_listener_that_has_died_is_named(source: ListenerProcess) -> None:
    source.read(view(1))
    process = source._process
    assert process is not None
    process.kill()
    process.wait()
    report = source.read(view(1))
    assert report is not None
    assert "the listener has ended (status -9)" in report.problem


def test_half_a_line_is_no_report(source: ListenerProcess) -> None:
    reading, writing = os.pipe()
    source._session = 1

    class _Process:
        stdout = open(reading, "rb", buffering=0)  # noqa: SIM115  # closed below
        returncode = None

        def poll(self) -> None: ...
        def kill(self) -> None: ...
        def communicate(self) -> None: ...

    os.set_blocking(reading, False)
    source._process = _Process()  # type: ignore[assignment]
    line = msgspec.json.encode(BusReport(frames=7)) + b"\n"
    os.write(writing, line[:9])
    assert source.read(view(1)) is None
    os.write(writing, line[9:] + line[:5])
    report = source.read(view(1))
    assert report is not None
    assert report.frames == 7
    os.close(writing)
    _Process.stdout.close()


def test_the_listener_is_asked_for_what_is_plotted_and_older_samples_are_not_taken_for_it(
    source: ListenerProcess,
) -> None:
    wait_for_report(source, view(1))
    process = source._process
    assert process is not None
    row = MessageRow(bus="", can_id="0x111", name="MOTION", frames=1, rate_hz=0.0, age_s=0.0, data="")
    values = [SignalValue(name=name, value="1") for name in ("SPEED", "YAW_RATE")]
    source.signals.update(BusReport(rows=[msgspec.structs.replace(row, signals=values)]))
    requests = []
    for name in ("MOTION.SPEED", "MOTION.YAW_RATE"):
        source.signals.want(name)
        source.read(view(1))
        assert source._unsent == b""
        requests.append(source._request)
    for number, signals in zip(requests, ([[7], []], [[8], [9]]), strict=True):
        samples = [Samples(times, [1.0] * len(times)) for times in signals]
        source._receive(BusSamples(request=number, signals=samples))
    assert source.signals.between("MOTION.SPEED", 0, 99)["at_ns"].tolist() == [8]
    assert source.signals.between("MOTION.YAW_RATE", 0, 99)["at_ns"].tolist() == [9]
    later = wait_for_report(source, view(1))
    assert later.problem
    assert process.poll() is None  # it has understood both requests


def test_the_listener_ends_when_the_viewer_has_gone() -> None:
    source = ListenerProcess(None)
    wait_for_report(source, view(1))
    process = source._process
    assert process is not None
    assert process.stdin is not None
    process.stdin.close()
    process.stdin = None
    while process.poll() is None:
        time.sleep(0.02)
    assert process.returncode == 0
    source.close()


@pytest.mark.parametrize("is_stamped", [True, False])
def test_a_frame_without_a_stamp_or_with_one_later_than_now_is_stamped_now(
    monkeypatch: pytest.MonkeyPatch, *, is_stamped: bool
) -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    near.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, int(is_stamped))
    monkeypatch.setattr(listening, "open_socket", lambda *_, **__: near)
    wall_ns = clock.wall_ns
    monkeypatch.setattr(clock, "wall_ns", lambda: wall_ns() - 60 * NS_PER_S)  # set back since the frame was received
    far.send(struct.pack("=IB3x8s", 0x123, 2, b"ab"))
    before_ns = clock.monotonic_ns()
    (frame,) = Listener({"vehicle": "can0", "ins": "can1"}).read(0)[:1]
    assert before_ns <= frame.stamp_ns <= clock.monotonic_ns()
    assert (frame.can_id, frame.data, frame.bus) == (0x123, b"ab", 0)
    near.close()
    far.close()
