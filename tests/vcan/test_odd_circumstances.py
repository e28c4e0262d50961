"""A vehicle that drops out by itself, a loop that is late for once, and one with a thousand files open."""

import signal
import time

import pytest

from .conftest import Programs
from .contract import MS, READY, Observer, decided, reasons
from .driving import driven, line_file, own_faults, summary, wait_until_driven
from .peer import Vehicle

NOTICED_WITHIN_NS = 200 * MS
SLACK_NS = 60 * MS
LATCHED_FAULT = 4
WITH_MANY_FILES = """
import os, resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (4096, max(4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1])))
held = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)]
from vehicle_iface.cli import main
sys.exit(main(sys.argv[1:]))
"""


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
    telemetry, report = str(programs.folder / "telemetry"), str(programs.folder / "summary.json")
    loop = programs.start_python("-c", WITH_MANY_FILES, *what, report, "--telemetry", telemetry, name="run")
    moving = wait_until_driven(bus)
    record = bus.record(moving, bus.wait_samples(50, since=moving))
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    loop.tell(signal.SIGTERM)
    assert loop.ends() == 0
    assert summary(programs)["counts"]["link_losses"] == 0
