"""A loop that stands still for seconds, and a wall clock that is set while it drives."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import FAULT, MS, Frame, S, pack
from vehicle_bus_contract.socketcan import open_socket, send

from .conftest import Programs
from .driving import driven, own_faults, summary, wait_until_driven
from .observer import CHANNEL, Observer, decided
from .peer import Vehicle

PERIOD_NS = 10 * MS
CROWD, SHORTEST_NS = 12, 40 * MS
STEPS_S = (3600, -3600, 10, -10)
A_STEP_NS = 5 * S
FLOOD = 4000
"""More than the kernel keeps, even where it allows the megabyte that is asked for."""


def rightly_sent(record: Record) -> bool:
    """Whether no more commands left than one in each command period: the samples of a pause are not caught up.

    Those of a pass that is late for once may be answered together.
    """
    together = zip(record.pairs, record.pairs[CROWD - 1 :], strict=False)
    is_burst = any(last.stamp_ns - first.stamp_ns < SHORTEST_NS for first, last in together)
    return not is_burst and len(record.pairs) <= (record.end_ns - record.begin_ns) // PERIOD_NS + 2


@pytest.fixture
def wall_clock() -> Iterator[None]:
    """A wall clock that may be set, because it is only the user-mode kernel's own; right again afterwards."""
    if "User Mode Linux" not in Path("/proc/cpuinfo").read_text():
        pytest.fail(
            "this machine's own clock must not be set; run it where tools/vcan boots a kernel of its own: "
            "tools/vcan python -m pytest tests/vcan on a machine without SocketCAN",
            pytrace=False,
        )
    wall_ns, monotonic_ns = time.time_ns(), time.monotonic_ns()
    yield
    time.clock_settime_ns(time.CLOCK_REALTIME, wall_ns + time.monotonic_ns() - monotonic_ns)


def test_after_a_pause_of_two_seconds_no_command_is_enabled_until_armed_again_and_there_is_no_burst(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    loop.send_signal(signal.SIGSTOP)
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    paused = bus.wait_samples(200, since=moving)
    assert bus.sent_by_controller(fault, paused) == []
    resumed = bus.now()
    loop.send_signal(signal.SIGCONT)
    end = bus.wait_samples(60, since=resumed)
    record = bus.record(resumed, end)
    assert not any(pair.is_enabled for pair in record.pairs)
    assert rightly_sent(record)
    vehicle.make_ready()
    ready = bus.wait_samples(80, since=end)
    assert not any(pair.is_enabled for pair in bus.record(end, ready).pairs)
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=ready)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert summary(programs)["counts"]["samples_expired"] > 100


@pytest.mark.parametrize("samples", [470, 30], ids=["all of it", "so little of it that the kernel keeps every frame"])
def test_after_a_pause_of_five_seconds_without_a_watchdog_old_state_causes_only_stops(
    programs: Programs, bus: Observer, vehicle: Vehicle, samples: int
) -> None:
    vehicle.watches = False
    loop, _ = driven(programs, bus)
    loop.send_signal(signal.SIGSTOP)
    paused = bus.now()
    bus.wait_samples(samples, since=paused)
    vehicle.mute(40)  # from 0.3 s before the pause ends until 0.1 s after it
    time.sleep(0.3)
    resumed = bus.now()
    loop.send_signal(signal.SIGCONT)
    back, _ = bus.wait_for("the vehicle's next sample", "CHASSIS", since=resumed)
    end = bus.wait_samples(60, since=back)
    record = bus.record(resumed, back)
    assert all(pair.is_stop or not pair.is_enabled for pair in record.pairs)
    assert rightly_sent(record)
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=end)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()


def test_an_overflow_of_the_receive_queue_in_a_pause_is_counted_and_old_samples_get_no_command(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    loop.send_signal(signal.SIGSTOP)
    bus.wait_samples(30)
    can_id, data = pack("MOTION", 0)
    with open_socket(CHANNEL, can_ids=()) as raw:
        for _ in range(FLOOD):
            assert send(raw, Frame(0, can_id, data))
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    resumed = bus.wait_samples(50, since=fault)
    loop.send_signal(signal.SIGCONT)
    end = bus.wait_samples(60, since=resumed)
    record = bus.record(resumed, end)
    assert not any(pair.is_enabled and not pair.is_stop for pair in record.pairs)
    assert rightly_sent(record)
    vehicle.make_ready()
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=end)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    found = summary(programs)
    assert found["bus_counters"]["receive_overflow"] > FLOOD // 4


@pytest.mark.usefixtures("vehicle", "wall_clock")
def test_wall_clock_steps_of_an_hour_and_ten_seconds_are_counted_and_change_nothing(
    programs: Programs, bus: Observer
) -> None:
    loop, moving = driven(programs, bus)
    for step_s in STEPS_S:
        bus.wait_samples(30)
        time.clock_settime_ns(time.CLOCK_REALTIME, time.time_ns() + step_s * S)
    end = bus.wait_samples(30)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    frames = bus.frames[moving:end]
    jumps = [i for i in range(1, len(frames)) if abs(frames[i].stamp_ns - frames[i - 1].stamp_ns) > A_STEP_NS]
    assert len(jumps) == len(STEPS_S)
    for begin, until in zip([0, *jumps], [*jumps, len(frames)], strict=True):
        record = bus.record(moving + begin, moving + until)
        assert decided(record) == ["NOMINAL"]
        assert not own_faults(record)
        assert len(record.pairs) > 10
    found = summary(programs)
    assert found["bus_counters"]["wall_clock_steps"] == len(STEPS_S)
    assert found["drops"] == {}
    assert found["counts"]["stops_on_stale_state"] == found["counts"]["samples_expired"] == 0
    assert sum(found["lost"].values()) == found["incomplete_samples"] == 0
