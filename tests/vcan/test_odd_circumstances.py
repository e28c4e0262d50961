"""A vehicle that drops out or says half of it, a loop late for once, a thousand open files, a viewer that stands."""

import re
import resource
import signal
import socket
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from .conftest import ROOT, Programs
from .contract import AUTONOMOUS, FAULT, MS, READY, Observer, decided, reasons
from .driving import driven, line_file, own_faults, summary, wait_until_driven
from .peer import ALWAYS, Vehicle

NOTICED_WITHIN_NS = 200 * MS
SLACK_NS = 60 * MS
STOP_WITHIN_NS, STATUS_STALE_NS = 150 * MS, 100 * MS
LATCHED_FAULT = 4
LATE_PAGES = 20
WITH_MANY_FILES = """
import os, resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (4096, max(4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1])))
held = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)]
from vehicle_iface.cli import main
sys.exit(main(sys.argv[1:]))
"""
WITH_LITTLE_MEMORY = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (60 << 20, 60 << 20))
from vehicle_iface.cli import main
sys.exit(main(sys.argv[1:]))
"""
POSTER = str(ROOT / "tests" / "vcan" / "poster.py")


def test_a_vehicle_that_drops_out_by_itself_is_let_go_within_200_ms_and_for_good(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.engages = False
    vehicle.mode = READY
    index, left = bus.wait_for("the vehicle drops out", "VEHICLE_STATUS", MODE=READY, since=moving)
    vehicle.engages = True
    end = bus.wait_samples(80, since=index)
    answers = bus.record(moving, end).answers
    after = [pair for stamp_ns, pair in answers if stamp_ns > left.stamp_ns]
    assert reasons(after) == ["VEHICLE_NOT_AUTONOMOUS"]
    assert not any(pair.is_enabled for pair in after)
    assert after[0].stamp_ns - left.stamp_ns <= NOTICED_WITHIN_NS + SLACK_NS
    loop.tell(signal.SIGTERM)
    assert loop.ends() == LATCHED_FAULT


def test_a_status_that_stays_away_stops_the_vehicle_after_100_ms(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    _, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.faults.muted["VEHICLE_STATUS"] = ALWAYS
    index, stop = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_STALE", SAFE_STOP=1, ENABLE=1, since=moving)
    end = bus.wait_samples(30, since=index)
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL", "STATE_STALE"]
    waited_ns = stop.stamp_ns - record.of("VEHICLE_STATUS")[-1].stamp_ns
    assert STATUS_STALE_NS <= waited_ns <= STOP_WITHIN_NS + SLACK_NS
    vehicle.faults.muted["VEHICLE_STATUS"] = 0
    bus.wait_for("driving on", "DRIVE_COMMAND", REASON="NOMINAL", ENABLE=1, since=end)


HALVES: dict[str, Callable[[Vehicle], None]] = {
    "one part of each sample lacks": lambda vehicle: vehicle.faults.muted.update(MOTION=ALWAYS),
    "a number that stands for nothing": lambda vehicle: setattr(vehicle, "pose_frame", 2),
}


@pytest.mark.parametrize("says_half", HALVES.values(), ids=HALVES)
def test_samples_that_are_never_whole_stop_the_vehicle_and_then_there_is_silence(
    programs: Programs, bus: Observer, vehicle: Vehicle, says_half: Callable[[Vehicle], None]
) -> None:
    _, moving = driven(programs, bus)
    half = bus.wait_samples(30, since=moving)
    says_half(vehicle)
    begin_ns = bus.frames[half].stamp_ns
    _, stop = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_STALE", SAFE_STOP=1, ENABLE=1, since=half)
    assert stop.stamp_ns - begin_ns <= STOP_WITHIN_NS + SLACK_NS
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=half)
    assert reasons(bus.pairs(moving, fault)) == ["NOMINAL", "STATE_STALE"]
    assert bus.sent_by_controller(fault, bus.wait_samples(30, since=fault)) == []


@pytest.mark.parametrize("late_s", [0.03, 0.1])
def test_one_late_pass_is_counted_and_only_young_samples_are_answered_after_it(
    programs: Programs, bus: Observer, vehicle: Vehicle, late_s: float
) -> None:
    vehicle.watches = False  # its 100 ms would be over
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    loop.tell(signal.SIGSTOP)
    time.sleep(late_s)
    resumed = bus.now()
    loop.tell(signal.SIGCONT)
    record = bus.record(resumed, bus.wait_samples(30, since=resumed))
    assert set(decided(record)) <= {"NOMINAL"}
    assert not record.violations
    loop.tell(signal.SIGTERM)
    assert loop.ends() == 0
    found = summary(programs)["counts"]
    assert found["deadline_misses"] >= 2
    assert found["too_old_to_answer"] >= (4 if late_s > 0.05 else 0)


@pytest.mark.usefixtures("vehicle")
def test_with_more_than_1024_descriptors_open_the_loop_drives_as_ever(programs: Programs, bus: Observer) -> None:
    what = ["run", "--arm", "--trajectory", line_file(programs.folder), "--summary"]
    telemetry, report = programs.telemetry, str(programs.folder / "summary.json")
    loop = programs.start_python("-c", WITH_MANY_FILES, *what, report, "--telemetry", telemetry, name="run")
    moving = wait_until_driven(bus)
    record = bus.record(moving, bus.wait_samples(50, since=moving))
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    loop.tell(signal.SIGTERM)
    assert loop.ends() == 0
    assert summary(programs)["counts"]["link_losses"] == 0


@pytest.mark.usefixtures("vehicle")
def test_a_loop_that_is_given_no_more_memory_drives_on_and_refuses_what_does_not_fit(
    programs: Programs, bus: Observer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MALLOC_MMAP_THRESHOLD_", "65536")  # whatever is large is new memory, and not what was freed
    file = str(programs.folder / "posted")
    programs.start_python(POSTER, file, "line", "300", "100", name="poster")
    loop, moving = driven(programs, bus, "--trajectory-post", file)
    pid = loop._process.pid
    held = dict(re.findall(r"(\w+):\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text()))
    for limit, name in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
        resource.prlimit(pid, limit, (int(held[name]) * 1024,) * 2)
    assert programs.start_python(POSTER, file, "long", name="poster").ends() == 0
    loop.says("no memory|Unable to allocate|MemoryError")
    refused = bus.wait_samples(10)
    assert programs.start_python(POSTER, file, "line", "300", "90", "10", name="poster").ends() == 0
    record = bus.record(refused, bus.wait_samples(10))
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    record = bus.record(moving, refused)
    assert set(decided(record)) <= {"NOMINAL", "STATE_STALE"}  # on a slow machine it takes long to be refused memory
    assert all(told["MODE"] == AUTONOMOUS for told in record.of("VEHICLE_STATUS"))
    loop.tell(signal.SIGTERM)
    assert loop.ends() == 0
    assert summary(programs)["counts"]["trajectories"] >= 5


@pytest.mark.usefixtures("vehicle")
def test_a_loop_that_has_too_little_memory_to_begin_with_ends_before_its_first_frame(
    programs: Programs, bus: Observer
) -> None:
    what = ["run", "--arm", "--trajectory", line_file(programs.folder)]
    loop = programs.start_python("-c", WITH_LITTLE_MEMORY, *what, name="run")
    assert loop.ends() != 0
    assert re.search("memory|allocate|failed to map|new thread", loop.text, re.IGNORECASE)
    assert bus.sent_by_controller() == []


@pytest.mark.usefixtures("vehicle")
def test_a_stopped_viewer_and_pages_that_never_read_change_nothing_on_the_bus(
    programs: Programs, bus: Observer
) -> None:
    viewer = programs.start("view", "--connect", programs.telemetry, "--port", "0")
    host, port = viewer.says(r"viewer: http://([\d.]+):(\d+)").groups()
    loop, moving = driven(programs, bus)
    with ExitStack() as pages:
        for _ in range(LATE_PAGES):
            page = pages.enter_context(socket.create_connection((host, int(port))))
            page.sendall(f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        bus.wait_samples(50)
        viewer.tell(signal.SIGSTOP)
        end = bus.wait_samples(100)
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL"]
    assert record.faults() == []
    assert viewer.is_running
    loop.tell(signal.SIGTERM)
    assert loop.ends() == 0
