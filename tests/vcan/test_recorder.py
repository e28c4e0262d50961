"""The recorder on a real bus and real disks: what it writes is what was there, and its troubles are its own."""

import json
import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from vehicle_iface.telemetry import TelemetryReader

from .conftest import Program, Programs
from .driving import driven, own_faults, summary
from .observer import CHANNEL, Observer, decided
from .peer import Vehicle

TOO_LONG_S = 6.5
"""More than the telemetry's ring (512 snapshots) and the kernel's default receive buffer (some 550 frames) hold."""
BAD_USAGE = 2


@pytest.fixture
def memory() -> Iterator[Path]:
    """A folder in this kernel's own memory: what is mapped on the host's files is not seen by another process."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        yield Path(folder)


@pytest.fixture
def disk(memory: Path) -> Iterator[Callable[[str], Path]]:
    """Mounts a small disk of the test's own."""
    place = memory / "disk"
    place.mkdir()
    made: list[Path] = []

    def mount(options: str) -> Path:
        subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)], check=True)
        made.append(place)
        return place

    yield mount
    for each in made:
        subprocess.run(["umount", "-l", str(each)], check=True)


def recorded(programs: Programs, bus: Observer, memory: Path, folder: Path) -> tuple[Program, int]:
    """A drive that is recorded to `folder`."""
    telemetry = str(memory / "telemetry")
    return driven(programs, bus, "--route", "figure8", "--record", str(folder), "--telemetry", telemetry)


def report(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "recorder.json").read_text())
    return content


def numbers(folder: Path) -> list[int]:
    """Of the snapshots that were written."""
    return [int(line.rpartition(",")[2]) for line in (folder / "snapshots.csv").read_text().splitlines()[1:]]


def count_published(memory: Path) -> int:
    """How many snapshots the loop has published."""
    with TelemetryReader(str(memory / "telemetry")) as reader:
        reader.poll()
        newest = reader.newest()
    assert newest is not None
    return newest.sequence


def recorder_of(loop: Program) -> int:
    pid = loop._process.pid
    (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(child)


def ended(programs: Programs, loop: Program) -> dict[str, Any]:
    """The loop's summary, after an end in order."""
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    return summary(programs)


def assert_driven_as_ever(bus: Observer, begin: int, end: int) -> None:
    """Each sample answered once by one pair, nothing doubled, nothing late beyond the contract, no stop."""
    record = bus.record(begin, end)
    assert len(record.samples) > 50
    assert decided(record) == ["NOMINAL"]
    assert own_faults(record) == []


def test_every_frame_on_the_bus_is_in_the_log_and_can_utils_reads_it(
    programs: Programs, bus: Observer, vehicle: Vehicle, memory: Path
) -> None:
    vehicle.watches = False  # this is about the log: a kernel that stands still for a moment is not
    folder = memory / "drive"
    loop, moving = recorded(programs, bus, memory, folder)
    end = bus.wait_samples(100, since=moving)
    found = ended(programs, loop)["recorder"]
    seen = [
        f"({frame.stamp_ns // 10**9:010d}.{frame.stamp_ns // 1000 % 10**6:06d}) {CHANNEL} "
        f"{frame.can_id:03X}#{frame.data.hex().upper()}"
        for frame in bus.frames[moving:end]
    ]
    lines = (folder / "frames.log").read_text().splitlines()
    first = lines.index(seen[0])
    assert lines[first : first + len(seen)] == seen
    assert found["written"]["frames"] == len(lines)
    assert set(found["lost"].values()) == {0}
    assert numbers(folder) == list(range(1, count_published(memory) + 1))
    asc = subprocess.run(
        ["log2asc", "-I", str(folder / "frames.log"), CHANNEL], capture_output=True, text=True, check=True
    )
    assert len(re.findall(r"\bRx\b|\bTx\b", asc.stdout)) == len(lines)


@pytest.mark.usefixtures("vehicle")
def test_a_full_disk_ends_only_the_recording(
    programs: Programs, bus: Observer, memory: Path, disk: Callable[[str], Path]
) -> None:
    folder = disk("size=400k") / "drive"
    loop, _ = recorded(programs, bus, memory, folder)
    begin = bus.now()
    loop.wait_for_line(
        r"recorder: \S+: (No space left on device|no room for all of it); new lines are lost and counted"
    )
    assert_driven_as_ever(bus, begin, bus.wait_samples(150))
    found = ended(programs, loop)
    lost = found["recorder"]["lost"]
    assert lost["frames"] > 500
    assert lost["snapshots"] > 100
    assert loop.wait_for_line(r"  recorder +\S+: .* written, .* LOST")
    assert report(folder)["lost"] == lost
    for name in ("frames", "snapshots", "trajectories", "counters"):
        (file,) = folder.glob(f"{name}.*")
        assert file.read_bytes()[-1:] in (b"\n", b"")
    assert found["recorder"]["written"]["frames"] == len((folder / "frames.log").read_text().splitlines())
    assert (
        len(numbers(folder)) == found["recorder"]["written"]["snapshots"] == count_published(memory) - lost["snapshots"]
    )


@pytest.mark.usefixtures("vehicle")
@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("ro", r"Read-only file system; `mount -o remount,rw`"),
        ("size=8k", r"No space left on device; make room there"),
    ],
)
def test_a_full_disk_at_the_start_is_rejected_before_driving(
    programs: Programs, bus: Observer, disk: Callable[[str], Path], options: str, complaint: str
) -> None:
    place = disk(options)
    begin = bus.now()
    loop = programs.run("--arm", "--route", "figure8", "--record", str(place / "drive"))
    assert loop.wait_for_end() == BAD_USAGE
    assert re.fullmatch(rf"vehicle-iface: --record {place}/drive: cannot be written: {complaint}.*", loop.text)
    assert bus.sent_by_controller(begin) == []
    assert not list(place.glob("drive/*"))


@pytest.mark.usefixtures("vehicle")
def test_a_paused_recorder_loses_the_frames_of_the_pause_and_a_killed_one_all_later_frames(
    programs: Programs, bus: Observer, memory: Path
) -> None:
    folder = memory / "drive"
    loop, _ = recorded(programs, bus, memory, folder)
    begin = bus.now()
    pid = recorder_of(loop)
    os.kill(pid, signal.SIGSTOP)
    time.sleep(TOO_LONG_S)
    os.kill(pid, signal.SIGCONT)
    match = loop.wait_for_line(r"recorder: too slow: ([\d,]+) frames, ([\d,]+) snapshots, ([\d,]+) trajectories lost")
    lost = report(folder)["lost"]
    assert [int(count.replace(",", "")) for count in match.groups()] == [
        lost["frames"],
        lost["snapshots"],
        lost["trajectories"],
    ]
    assert lost["snapshots"] > 50
    assert lost["frames"] > 1000
    os.kill(pid, signal.SIGKILL)
    loop.wait_for_line("the recorder exited")
    assert_driven_as_ever(bus, begin, bus.wait_samples(50))
    found = ended(programs, loop)["recorder"]
    assert "later data is LOST" in found["text"]
