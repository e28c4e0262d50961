"""CAN FD end to end on vcan0: vehicle and loop as two processes, judged by frames that are taken apart here."""

import re
import select
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest
from vehicle_bus_contract.judge import Sample, lateral_errors_m
from vehicle_bus_contract.reference import AUTONOMOUS, DecodedFrame, Frame, S
from vehicle_bus_contract.reference_fd import COUNTERS, LAYOUT, NAMES, intact, pack
from vehicle_bus_contract.socketcan import open_socket, receive_frames, send

from vehicle_iface.trajectories.shapes import make_route

from .conftest import Programs, mtu, set_mtu
from .observer import CHANNEL, PATIENCE_S

FD_MTU = 72
LATERAL_LIMIT_M = 0.3
DRIVE_SAMPLES = 600
"""6 s; `tools/long_drive` drives whole laps."""
TIMELY_NS = 40_000_000
"""A sample later than this after the one before may rightly be answered by a stop."""


class Record:
    """Every frame on vcan0 from a thread of its own, each of them of the contract and intact."""

    def __init__(self) -> None:
        self.decoded: list[DecodedFrame] = []
        self.wrong: list[str] = []
        self._raw = open_socket(CHANNEL)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="record")
        self._thread.start()

    def close(self) -> None:
        """Stop watching; the record stays."""
        self._over.set()
        self._thread.join()
        self._raw.close()

    def of(self, name: str, since: int = 0) -> list[DecodedFrame]:
        """All frames of a message."""
        return [decoded for decoded in self.decoded[since:] if decoded.name == name]

    def wait_for(self, what: str, name: str, since: int = 0, **wanted: float) -> int:
        """The index after the first frame with these values; fails, naming `what`, when it does not come."""
        deadline_s = time.monotonic() + PATIENCE_S
        index = since
        while time.monotonic() < deadline_s:
            while index < len(self.decoded):
                decoded, index = self.decoded[index], index + 1
                if decoded.name == name and all(decoded[signal] == value for signal, value in wanted.items()):
                    return index
            time.sleep(0.05)  # a test that looks more often takes time from the programs that it watches
        raise AssertionError(f"{what}: did not come in {PATIENCE_S:.0f} s; wrong: {self.wrong[:5]}")

    def wait_samples(self, count: int, since: int) -> int:
        """The index after so many samples."""
        for _ in range(count):
            since = self.wait_for("the vehicle's next sample", "STATE", since)
        return since

    def _watch(self) -> None:
        while not self._over.is_set():
            select.select([self._raw], [], [], 0.2)
            for frame in receive_frames(self._raw):
                decoded = intact(frame)
                if decoded is not None:
                    self.decoded.append(decoded)
                else:
                    self.wrong.append(str(frame))


@pytest.fixture(scope="module")
def fd_vcan0(vcan0: None) -> Iterator[None]:  # noqa: ARG001
    """The interface with room for FD frames; afterwards as it was."""
    before = mtu()
    set_mtu(FD_MTU)
    yield
    set_mtu(before)


@pytest.fixture
def record(fd_vcan0: None) -> Iterator[Record]:  # noqa: ARG001
    """Sees every frame of the test."""
    observer = Record()
    yield observer
    observer.close()


@pytest.fixture
def fd_programs(record: Record, tmp_path: Path) -> Iterator[Programs]:  # noqa: ARG001
    """Starts programs, and ends them all."""
    started = Programs(tmp_path)
    yield started
    print(started.text)
    started.kill_all()


def start_vehicle(programs: Programs, record: Record) -> None:
    """The simulated vehicle at the route's start."""
    x_m, y_m, heading_rad = make_route("figure8").start
    start = f"--start={x_m:.6f},{y_m:.6f},{heading_rad:.6f}"
    programs.start("sim", "--profile", "reference_fd", start, "--driver-socket", str(programs.folder / "pedals.sock"))
    record.wait_for("the vehicle's first sample", "STATE")


def steps(decoded: list[DecodedFrame]) -> set[int]:
    """By how much a counter has stepped."""
    return {(after.counter - before.counter) % COUNTERS for before, after in pairwise(decoded)}


def unreasonable(record: Record, since: int) -> list[DecodedFrame]:
    """Commands that neither drive nor stop for a sample that was late on the wire."""
    samples = [decoded.stamp_ns for decoded in record.of("STATE")]
    late = [after for before, after in pairwise(samples) if after - before > TIMELY_NS]
    found = [decoded for decoded in record.of("COMMAND", since) if decoded.reason != "NOMINAL"]
    return [
        decoded
        for decoded in found
        if decoded.reason not in ("STATE_STALE", "DEADLINE_MISSED")
        or not any(abs(decoded.stamp_ns - stamp_ns) < S // 2 for stamp_ns in late)
    ]


@pytest.mark.timeout(180)
def test_two_processes_drive_the_figure_of_eight_on_can_fd(fd_programs: Programs, record: Record) -> None:
    start_vehicle(fd_programs, record)
    loop = fd_programs.run("--profile", "reference_fd", "--arm", "--route", "figure8")
    begin = record.wait_for("the vehicle engages", "VEHICLE_STATUS", MODE=AUTONOMOUS)
    end = record.wait_samples(DRIVE_SAMPLES, begin)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    route = make_route("figure8")
    samples = [
        Sample(decoded.stamp_ns, decoded["POS_X"], decoded["POS_Y"], decoded["HEADING"], decoded["SPEED"])
        for decoded in record.decoded[begin:end]
        if decoded.name == "STATE"
    ]
    assert max(lateral_errors_m(samples, route.x_m.tolist(), route.y_m.tolist())) < LATERAL_LIMIT_M
    assert sum(sample.speed_mps for sample in samples) * 0.01 > 10.0
    assert record.wrong == []
    assert {decoded.name for decoded in record.decoded} == set(LAYOUT)
    for name in LAYOUT:
        assert steps(record.of(name)) == {1}
    driven = [decoded for decoded in record.decoded[begin:end] if decoded.name == "COMMAND"]
    assert abs(len(driven) - len(samples)) <= 0.05 * len(samples)
    assert all(decoded["ENABLE"] == 1 for decoded in driven)
    assert [decoded for decoded in unreasonable(record, begin) if decoded.reason != "SHUTDOWN"] == []
    last = record.of("COMMAND")[-1]
    assert (last["ENABLE"], last.reason) == (0, "SHUTDOWN")
    assert abs(record.of("STATE")[-1]["SPEED"]) < 0.06
    assert re.search(r"samples +\d+ complete, 0 incomplete", loop.text)


@pytest.mark.timeout(120)
def test_frames_of_another_kind_or_a_wrong_checksum_change_nothing(fd_programs: Programs, record: Record) -> None:
    start_vehicle(fd_programs, record)
    loop = fd_programs.run("--profile", "reference_fd", "--arm", "--route", "figure8")
    begin = record.wait_for("the vehicle engages", "VEHICLE_STATUS", MODE=AUTONOMOUS)
    begin = record.wait_samples(200, begin)
    raw = open_socket(CHANNEL)
    with suppress(OSError):
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, 0)
    for count in range(50):
        can_id, data = pack("STATE", count, POS_X=1e6, SPEED=50.0, POSE_VALID=1)
        assert send(raw, Frame(0, can_id, bytes((data[0] ^ 1, *data[1:])), is_fd=True))
        assert send(raw, Frame(0, can_id, data[:8]))
        assert send(raw, Frame(0, can_id, data[:24], is_fd=True))
        time.sleep(0.02)  # fewer than the vehicle's own: most of them damaged would be another matter
    raw.close()
    record.wait_samples(100, begin)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert len(record.wrong) == 150
    assert [decoded for decoded in unreasonable(record, begin) if decoded.reason != "SHUTDOWN"] == []
    assert steps(record.of("COMMAND")) == {1}
    assert re.search(r"STATE.*bad CRC|bad CRC.*STATE", loop.text)


def test_the_contract_has_every_identifier() -> None:
    assert sorted(NAMES) == [0x080, 0x082, 0x100, 0x110, 0x180]
