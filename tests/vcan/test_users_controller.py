"""A controller of the user's own that fails on the way: it raises, returns nonsense, is slow, hangs."""

import signal
import textwrap
from collections.abc import Callable
from itertools import combinations, groupby

import pytest
from vehicle_bus_contract.judge import Pair, Record
from vehicle_bus_contract.reference import FAULT, MS, S

from .conftest import Programs
from .driving import driven, is_standing, line_file, own_faults, summary
from .observer import Observer, decided, reasons
from .peer import Vehicle

WATCHDOG_NS = 100 * MS
STATUS_PERIOD_NS = 20 * MS
SLACK_NS = 60 * MS
LATCHED_FAULT = 4
ACCEL_RATE_MPS3, FRONT_RATE_RADPS = 30.0, 0.8
"""Of the reference vehicle's profile."""
JITTER_NS = 20 * MS
"""Between the instant for which a command was computed and its stamp on the wire."""
CONTROLLER = """
import time
from dataclasses import replace

from vehicle_iface.control.pure_pursuit import PurePursuit, PurePursuitConfig


class Moody(PurePursuit):
    def __init__(self, behavior):
        super().__init__(PurePursuitConfig(wheelbase_m=2.7), behavior=behavior)
        self.is_in_the_mood = True

    def compute_command_impl(self, state):
        wish = super().compute_command_impl(state)
        if state.x_m > 3.0 and self.is_in_the_mood:
{mood}
        return wish
"""


def arguments(programs: Programs, mood: str) -> list[str]:
    """Those of a loop with a controller that does this from 3 m on."""
    file = programs.folder / "moody.py"
    file.write_text(CONTROLLER.format(mood=textwrap.indent(mood, " " * 12)))
    return ["--trajectory", line_file(programs.folder), "--controller", f"{file}:Moody"]


@pytest.mark.usefixtures("vehicle")
@pytest.mark.parametrize(
    "mood", ["raise ZeroDivisionError('a mistake')", "return replace(wish, front_wheel_angle_rad=float('nan'))"]
)
def test_a_controller_that_raises_or_returns_a_non_number_stops_the_vehicle_and_is_logged_once(
    programs: Programs, bus: Observer, mood: str
) -> None:
    loop, moving = driven(programs, bus, *arguments(programs, mood))
    index, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="CONTROLLER_ERROR", since=moving)
    standing, _ = bus.wait_until("the vehicle stands", is_standing, since=index)
    record = bus.record(moving, bus.wait_samples(30, since=standing))
    assert decided(record) == ["NOMINAL", "CONTROLLER_ERROR"]
    assert all(pair.is_enabled and pair.is_stop for pair in record.pairs if pair.reason == "CONTROLLER_ERROR")
    assert not own_faults(record)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert loop.text.count("moody.py") == 1
    assert summary(programs)["counts"]["controller_errors"] > 30


def runs_that_drive(record: Record) -> list[list[Pair]]:
    """The pairs that drive, parted where a stop came between: a stop drops at once what drives."""
    return [list(pairs) for reason, pairs in groupby(record.pairs, lambda pair: pair.reason) if reason == "NOMINAL"]


def too_fast(pairs: list[Pair], rate_per_s: float, value_of: Callable[[Pair], float]) -> list[str]:
    """Where a value changes by more than its rate allows, be it from one pair to the next or over many of them."""
    return [
        f"{value_of(before):.4f} to {value_of(after):.4f} in {(after.stamp_ns - before.stamp_ns) / MS:.1f} ms"
        for before, after in combinations(pairs, 2)
        if abs(value_of(after) - value_of(before)) > rate_per_s * (after.stamp_ns - before.stamp_ns + JITTER_NS) / S
    ]


@pytest.mark.usefixtures("vehicle")
def test_a_controller_far_out_of_limits_is_limited_on_the_bus_and_counted(programs: Programs, bus: Observer) -> None:
    mood = (
        "sign = 1.0 if state.stamp_ns // 400_000_000 % 2 else -1.0\n"
        "return replace(wish, accel_mps2=1e6 * sign, front_wheel_angle_rad=1e6 * sign, speed_mps=1e6)"
    )
    loop, moving = driven(programs, bus, *arguments(programs, mood))
    record = bus.record(moving, bus.wait_samples(300, since=moving))
    assert set(decided(record)) <= {"NOMINAL", "DEVIATION"}
    assert not own_faults(record)
    longest = max(runs_that_drive(record), key=len)
    accels_mps2 = {pair.drive["ACCEL_REQUEST"] for pair in longest}
    assert max(accels_mps2) - min(accels_mps2) > 3.0  # far enough to show the rate
    for pairs in runs_that_drive(record):
        assert not too_fast(pairs, ACCEL_RATE_MPS3, lambda pair: pair.drive["ACCEL_REQUEST"])
        assert not too_fast(pairs, FRONT_RATE_RADPS, lambda pair: pair.steer["FRONT_WHEEL_ANGLE_REQUEST"])
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    limited = summary(programs)["limited"]
    assert min(limited["accel_mps2"], limited["front_wheel_angle_rad"], limited["speed_mps"]) > 0


def test_a_controller_that_is_always_slow_stops_the_vehicle(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    vehicle.watches = False  # a slow machine makes of a slow answer none at all
    loop, moving = driven(programs, bus, *arguments(programs, "time.sleep(0.06)"))
    index, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="DEADLINE_MISSED", since=moving)
    standing, _ = bus.wait_until("the vehicle stands", is_standing, since=index)
    record = bus.record(index, bus.wait_samples(30, since=standing))
    assert set(reasons(record.pairs)) <= {"DEADLINE_MISSED", "STATE_STALE"}
    assert all(pair.is_enabled and pair.is_stop for pair in record.pairs)
    assert not record.counter_gaps
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert summary(programs)["counts"]["controller_too_slow"] >= 3


@pytest.mark.usefixtures("vehicle")
def test_a_controller_that_is_slow_once_causes_a_brief_stop(programs: Programs, bus: Observer) -> None:
    mood = "self.is_in_the_mood = False\ntime.sleep(0.06)"
    loop, moving = driven(programs, bus, *arguments(programs, mood))
    index, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="DEADLINE_MISSED", since=moving)
    index, _ = bus.wait_for("driving on", "DRIVE_COMMAND", REASON="NOMINAL", since=index)
    bus.wait_samples(30, since=index)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    found = summary(programs)["counts"]
    assert found["controller_too_slow"] == 1
    assert found["deadline_misses"] >= 1


@pytest.mark.usefixtures("vehicle")
@pytest.mark.parametrize(
    ("mood", "leaves_time"), [("time.sleep(1000.0)", True), ("while True: pass", False)], ids=["waits", "computes"]
)
def test_a_controller_that_hangs_silences_the_loop_and_the_process_ends_with_its_place(
    programs: Programs, bus: Observer, mood: str, leaves_time: bool
) -> None:
    loop, moving = driven(programs, bus, *arguments(programs, mood))
    index, fault = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    assert loop.wait_for_end() == LATCHED_FAULT
    assert "the loop hangs" in loop.text
    assert "moody.py" in loop.text
    record = bus.record(moving, index)
    assert decided(record) == ["NOMINAL"]
    assert bus.sent_by_controller(index) == []
    if leaves_time:  # to the vehicle, which shares the one processor: else it stands still as long
        assert fault.stamp_ns - record.pairs[-1].stamp_ns <= WATCHDOG_NS + STATUS_PERIOD_NS + SLACK_NS
