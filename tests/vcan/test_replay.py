"""An old log that is played back where no vehicle is. Its frames are as intact and in sequence as they once were.

End-to-end protection has no time stamp: at its own pace the log of a vehicle alone is the same as a vehicle.
What is promised is that it is obeyed no longer than it lasts and then not again without a new arming, that the log of
a vehicle that is being driven is never taken over, and that the log of a whole bus betrays itself by its commands.
"""

import signal
from itertools import pairwise

import pytest
from vehicle_bus_contract.judge import examine
from vehicle_bus_contract.reference import AUTONOMOUS, COUNTERS, GREATEST_STEP, MS, PAIR, SAMPLE, Frame, S

from .conftest import ROOT, Program, Programs
from .driving import driven, line_file, own_faults, summary
from .observer import CONTROLLER_IDS, Observer, reasons
from .peer import Vehicle

PLAYER = str(ROOT / "tests" / "vcan" / "player.py")
STOP_WITHIN_NS, SILENT_WITHIN_NS, SLACK_NS = 150 * MS, 500 * MS, 60 * MS


@pytest.fixture(scope="module")
def log(vcan0: None, tmp_path_factory: pytest.TempPathFactory) -> list[Frame]:  # noqa: ARG001
    """All frames from before a vehicle was taken over until it had driven for a second."""
    bus, vehicle = Observer(), Vehicle()
    programs = Programs(tmp_path_factory.mktemp("log"))
    try:
        vehicle.start()
        driven(programs, bus)
        bus.wait_samples(100)
    finally:
        programs.kill_all()
        vehicle.close()
        bus.close()
    return bus.frames


def of_vehicle(log: list[Frame]) -> list[Frame]:
    """The frames of the vehicle alone."""
    return [frame for frame in log if frame.can_id not in CONTROLLER_IDS]


def of_driven(log: list[Frame]) -> list[Frame]:
    """The vehicle's frames from its first AUTONOMOUS on."""
    record = examine(log)
    begin_ns = next(decoded.stamp_ns for decoded in record.of("VEHICLE_STATUS") if decoded["MODE"] == AUTONOMOUS)
    return [frame for frame in of_vehicle(log) if frame.stamp_ns >= begin_ns]


def armed(programs: Programs) -> Program:
    """A loop that would drive if there were a vehicle."""
    loop = programs.run("--arm", "--trajectory", line_file(programs.folder))
    loop.wait_for_line("armed")
    return loop


def play(programs: Programs, log: list[Frame], *, times: int = 1) -> Program:
    """Another process that puts these frames on the bus, at their own pace."""
    path = programs.folder / "log"
    path.write_text("".join(f"{frame.stamp_ns / S:.6f} {frame.can_id:X} {frame.data.hex()}\n" for frame in log))
    return programs.start_python(PLAYER, str(path), str(times), name="player")


def test_the_log_of_a_whole_bus_silences_the_loop_at_the_first_command_in_it(
    programs: Programs, bus: Observer, log: list[Frame]
) -> None:
    loop = armed(programs)
    assert play(programs, log).wait_for_end() == 0
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4
    found = summary(programs)
    commands = [i for i, frame in enumerate(log) if frame.can_id in CONTROLLER_IDS]
    assert found["latched_fault"] == "DUPLICATE_COMMANDER"
    assert found["counts"]["foreign_commands"] == len(commands)
    # Only the player sends the vehicle's frames: so many of them came before its first command.
    played = [i for i, frame in enumerate(bus.frames) if frame.can_id not in CONTROLLER_IDS]
    begin = played[commands[0]]
    assert len(bus.sent_by_controller(begin)) - len(commands) <= len(PAIR)
    before_ns = bus.frames[played[commands[0] - 1]].stamp_ns  # the last that was played before a command was
    bus.is_foreign = lambda frame: frame.stamp_ns > before_ns


def test_a_replayed_vehicle_log_is_followed_only_once_and_only_until_its_end(
    programs: Programs, bus: Observer, log: list[Frame]
) -> None:
    loop = armed(programs)
    assert play(programs, of_vehicle(log)).wait_for_end() == 0
    loop.wait_for_line("SILENT .STATE_STALE")
    quiet = bus.now()
    record = bus.record()
    last_ns = record.samples[-1].stamp_ns
    stops = [pair for pair in record.pairs if pair.is_stop]
    assert reasons(record.pairs) == ["NOT_ENGAGED", "NOMINAL", "STATE_STALE"]
    assert last_ns < stops[0].stamp_ns <= last_ns + STOP_WITHIN_NS + SLACK_NS
    assert record.pairs[-1].stamp_ns <= last_ns + SILENT_WITHIN_NS + SLACK_NS
    assert not own_faults(record)
    assert play(programs, of_vehicle(log)).wait_for_end() == 0
    assert bus.sent_by_controller(quiet) == []
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4


def test_a_replayed_log_of_a_driven_vehicle_is_never_engaged(
    programs: Programs, bus: Observer, log: list[Frame]
) -> None:
    loop = armed(programs)
    assert play(programs, of_driven(log), times=3).wait_for_end() == 0
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    record = bus.record()
    assert not any(pair.is_enabled for pair in record.pairs)
    assert {pair.reason for pair in record.pairs} <= {"NOT_ENGAGED", "SHUTDOWN"}
    found = summary(programs)
    for name in SAMPLE:
        steps = [(after.counter - before.counter) % COUNTERS for before, after in pairwise(record.of(name))]
        assert found["drops"].get(f"wrong sequence {name}", 0) == sum(step > GREATEST_STEP for step in steps)
        assert found["drops"].get(f"repeated {name}", 0) == steps.count(0)
