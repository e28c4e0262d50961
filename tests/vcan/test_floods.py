"""Another program that floods the bus: with foreign identifiers, with the vehicle's, and with ours."""

import signal
from collections.abc import Iterator
from statistics import median

import pytest
from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import FAULT, NAMES, PAIR, intact

from .conftest import ROOT, Programs
from .driving import driven, summary, wait_until_driven
from .observer import CONTROLLER_IDS, Observer, decided
from .peer import Vehicle
from .verdict import breaches

FLOODER = str(ROOT / "tests" / "vcan" / "flooder.py")
STRANGERS = tuple(f"{can_id:X}" for can_id in (0x000, 0x07F, 0x101, 0x113, 0x200, 0x7FF))
WORSE = 3.0
"""How many times as late as before an answer may be, in the middle, while somebody else uses the one processor too."""


@pytest.fixture
def listener(vcan0: None) -> Iterator[Observer]:  # noqa: ARG001
    """Sees only what is of the contract: to look at a flood, too, would take time from those under test."""
    observer = Observer(can_ids=NAMES)
    yield observer
    observer.close()
    assert breaches(observer.frames) == []


def latency_ns(record: Record) -> float:
    """The middle one of the times from a sample to its answer."""
    return median(pair.stamp_ns - sample_ns for sample_ns, pair in record.answers)


@pytest.mark.usefixtures("vehicle")
def test_a_flood_of_foreign_frames_loses_no_sample_and_delays_no_command(
    programs: Programs, bus: Observer, listener: Observer
) -> None:
    loop, moving = driven(programs, listener)
    bus.close()
    calm = listener.wait_samples(100)
    flooder = programs.start_python(FLOODER, "6000", "2000", *STRANGERS, name="flooder")
    flooder.wait_for_line("frames/s")
    flooded = listener.now()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    before, during = listener.record(moving, calm), listener.record(calm, flooded)
    found = summary(programs)
    assert decided(during) == ["NOMINAL"]
    assert during.faults() == []
    assert latency_ns(during) < WORSE * latency_ns(before)
    assert found["drops"] == {}
    assert not any(found["lost"].values())
    assert found["incomplete_samples"] == found["counts"]["samples_expired"] == 0
    assert found["bus_counters"]["receive_overflow"] == 0


@pytest.mark.usefixtures("vehicle")
def test_a_flood_of_damaged_frames_with_the_vehicles_identifiers_is_dropped_and_stops_the_vehicle(
    programs: Programs, bus: Observer
) -> None:
    """Among enough noise some has a right checksum: while most frames are damaged, no intact one is believed."""
    loop, moving = driven(programs, bus)
    flooder = programs.start_python(FLOODER, "2000", "1000", "110", "111", name="flooder")
    flooder.wait_for_line("frames/s")
    stop, _ = bus.wait_for("a stop", "DRIVE_COMMAND", SAFE_STOP=1, REASON="STATE_STALE", ENABLE=1, since=moving)
    bus.wait_for("the vehicle's own watchdog", "VEHICLE_STATUS", MODE=FAULT, since=stop)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4
    record = bus.record(moving, bus.wait_samples(5))
    assert not record.violations
    assert {pair.reason for pair in record.pairs if pair.is_enabled} == {"NOMINAL", "STATE_STALE"}
    drops = summary(programs)["drops"]
    assert min(drops["bad CRC POSE"], drops["bad CRC MOTION"]) > 100
    assert min(drops["too many damaged POSE"], drops["too many damaged MOTION"]) > 10


def test_a_flood_of_our_own_identifiers_silences_the_loop_until_it_is_over_and_armed_again(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    own = [f"{can_id:X}" for can_id in sorted(CONTROLLER_IDS)]
    bus.is_foreign = lambda frame: frame.can_id in CONTROLLER_IDS and intact(frame) is None
    flooder = programs.start_python(FLOODER, "1000", "500", *own, name="flooder")
    loop.wait_for_line("SILENT .DUPLICATE_COMMANDER")
    loop.send_signal(signal.SIGUSR1)  # in vain while it lasts, and the vehicle is not let go for it
    loop.wait_for_line("OBSERVING")
    flooder.wait_for_line("frames/s")
    bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    over = bus.wait_samples(5)
    record = bus.record(moving, over)
    first_ns = min(stamp_ns for _, stamp_ns in record.damaged)
    assert len([decoded for decoded in record.decoded if decoded.name in PAIR and decoded.stamp_ns >= first_ns]) <= len(
        PAIR
    )
    vehicle.make_ready()
    quiet = bus.wait_samples(80, since=over)
    assert bus.sent_by_controller(over, quiet) == []
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=quiet)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert summary(programs)["counts"]["foreign_commands"] == 1000
