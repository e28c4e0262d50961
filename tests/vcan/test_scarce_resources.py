"""Little time, many open files, little memory, a viewer that stands still: the loop with few resources."""

import re
import resource
import signal
import socket
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from vehicle_bus_contract.reference import AUTONOMOUS, MS

from .conftest import ROOT, Programs
from .driving import driven, line_file, own_faults, summary, wait_until_driven
from .observer import CHANNEL, Observer, decided
from .peer import Vehicle

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


@pytest.mark.parametrize("late_s", [0.03, 0.1])
def test_one_late_pass_is_counted_and_only_fresh_samples_get_a_command_after_it(
    programs: Programs, bus: Observer, vehicle: Vehicle, late_s: float
) -> None:
    vehicle.watches = False  # its 100 ms would be over
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    begin_s = time.monotonic()
    loop.send_signal(signal.SIGSTOP)
    time.sleep(late_s)
    resumed = bus.now()
    loop.send_signal(signal.SIGCONT)
    paused_s = time.monotonic() - begin_s  # a busy machine makes it longer
    record = bus.record(resumed, bus.wait_samples(30, since=resumed))
    assert set(decided(record)) <= {"NOMINAL"}
    assert not record.violations
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    found = summary(programs)["counts"]
    assert found["deadline_misses"] >= 2
    if late_s > 0.05:
        assert found["samples_expired"] >= 4
    else:  # none waited long enough, so each of them was answered
        assert found["samples_expired"] <= (0 if paused_s < 0.04 else paused_s / 0.01)


@pytest.mark.usefixtures("vehicle")
def test_the_loop_drives_with_more_than_1024_open_descriptors(programs: Programs, bus: Observer) -> None:
    what = ["run", "--arm", "--trajectory", line_file(programs.folder), "--summary"]
    telemetry, report = programs.telemetry, str(programs.folder / "summary.json")
    loop = programs.start_python("-c", WITH_MANY_FILES, *what, report, "--telemetry", telemetry, name="run")
    moving = wait_until_driven(bus)
    record = bus.record(moving, bus.wait_samples(50, since=moving))
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert summary(programs)["counts"]["link_losses"] == 0


@pytest.mark.usefixtures("vehicle")
def test_without_more_memory_the_loop_drives_on_and_rejects_trajectories_that_do_not_fit(
    programs: Programs, bus: Observer
) -> None:
    file = str(programs.folder / "posted")
    programs.start_python(POSTER, file, "line", "300", "100", name="poster")
    loop = programs.start_command(
        *("env", "MALLOC_MMAP_THRESHOLD_=65536"),  # whatever is large is new memory, and not what was freed
        *(sys.executable, "-m", "vehicle_iface", "run", "--arm", "--channel", CHANNEL, "--trajectory-mailbox", file),
        *("--telemetry", programs.telemetry, "--summary", str(programs.folder / "summary.json")),
        name="run",
    )
    moving = wait_until_driven(bus)
    pid = loop._process.pid
    held = dict(re.findall(r"(\w+):\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text()))
    for limit, name in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
        resource.prlimit(pid, limit, (int(held[name]) * 1024,) * 2)
    assert programs.start_python(POSTER, file, "long", name="poster").wait_for_end() == 0
    loop.wait_for_line("no memory|Unable to allocate|MemoryError")
    refused = bus.wait_samples(10)
    assert programs.start_python(POSTER, file, "line", "300", "90", "10", name="poster").wait_for_end() == 0
    record = bus.record(refused, bus.wait_samples(10))
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    record = bus.record(moving, refused)
    assert set(decided(record)) <= {"NOMINAL", "STATE_STALE"}  # on a slow machine it takes long to be refused memory
    assert all(decoded["MODE"] == AUTONOMOUS for decoded in record.of("VEHICLE_STATUS"))
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert summary(programs)["counts"]["trajectories"] >= 5


@pytest.mark.usefixtures("vehicle")
def test_too_little_memory_at_the_start_ends_the_loop_before_its_first_frame(programs: Programs, bus: Observer) -> None:
    what = ["run", "--arm", "--trajectory", line_file(programs.folder)]
    loop = programs.start_python("-c", WITH_LITTLE_MEMORY, *what, name="run")
    assert loop.wait_for_end() != 0
    assert re.search("memory|allocate|failed to map|new thread", loop.text, re.IGNORECASE)
    assert bus.sent_by_controller() == []


@pytest.mark.usefixtures("vehicle")
def test_a_stopped_viewer_and_pages_that_never_read_change_nothing_on_the_bus(
    programs: Programs, bus: Observer
) -> None:
    viewer = programs.start("view", "--connect", programs.telemetry, "--port", "0")
    host, port = viewer.wait_for_line(r"viewer: http://([\d.]+):(\d+)").groups()
    loop, moving = driven(programs, bus)
    with ExitStack() as pages:
        for _ in range(LATE_PAGES):
            page = pages.enter_context(socket.create_connection((host, int(port))))
            page.sendall(f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        bus.wait_samples(50)
        viewer.send_signal(signal.SIGSTOP)
        end = bus.wait_samples(100)
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL"]
    assert record.faults() == []
    assert viewer.is_running
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
