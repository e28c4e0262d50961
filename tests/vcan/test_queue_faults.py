"""A transmit queue that does not empty, and one that empties slowly."""

import signal

import pytest
from vehicle_bus_contract.cable import CLOSED, LOOP_END, OPEN, Cable
from vehicle_bus_contract.judge import examine
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, NAMES, PAIR, Frame

from .conftest import Programs
from .driving import driven, is_standing, own_faults, summary, wait_until_driven
from .observer import Observer, decided
from .peer import Vehicle

SLOW = ("tbf", "rate", "8kbit", "burst", "32", "limit", "4000")
"""62 frames of 16 bytes in a second; the loop would send 220."""


def whole_pairs(frames: list[Frame]) -> list[Frame]:
    """Without the command that the closing queue has let through alone, if its last one is such."""
    commands = [frame for frame in frames if NAMES.get(frame.can_id) in PAIR]
    cut = commands[-1] if NAMES[commands[-1].can_id] == PAIR[0] else None
    return [frame for frame in frames if frame is not cut]


@pytest.mark.parametrize("mend", ["changed", "deleted"])
def test_a_stuck_queue_silences_the_loop_and_releases_at_most_one_old_pair_later(
    cable_programs: Programs, cable: Cable, vehicle_end: Observer, far_vehicle: Vehicle, mend: str
) -> None:
    loop, moving = driven(cable_programs, vehicle_end)
    cable.queue(LOOP_END, *CLOSED)
    loop.wait_for_line("SILENT .LINK_DOWN")
    fault, _ = vehicle_end.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    assert not own_faults(examine(whole_pairs(vehicle_end.frames[moving:fault])))
    far_vehicle.make_ready()
    loop.send_signal(signal.SIGUSR1)  # in vain: the link is down
    vehicle_end.wait_samples(100)
    before = vehicle_end.now()
    if mend == "changed":
        cable.queue(LOOP_END, *OPEN)
    else:
        cable.remove_queue(LOOP_END)
    after = vehicle_end.wait_samples(50, since=before)
    late = vehicle_end.record(before, after)
    assert sum(pair.is_enabled for pair in late.pairs) <= 1
    assert len(late.pairs) <= (1 if mend == "changed" else 0)
    assert not {AUTONOMOUS} & {decoded["MODE"] for decoded in late.of("VEHICLE_STATUS")}
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(vehicle_end, since=after)
    end = vehicle_end.wait_samples(30, since=driving)
    assert not vehicle_end.record(driving, end).faults()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    found = summary(cable_programs)
    assert found["bus_counters"]["send_no_room"] > 0
    assert found["counts"]["link_losses"] >= 1
    assert "DOWN" in [change["state"] for change in found["link"]["transitions"]]
    assert found["link"]["state"] == "UP"


@pytest.mark.usefixtures("far_vehicle")
def test_a_slow_queue_gets_stops_with_unbroken_counters_and_driving_resumes_when_it_is_fast(
    cable_programs: Programs, cable: Cable, vehicle_end: Observer
) -> None:
    loop, moving = driven(cable_programs, vehicle_end)
    cable.queue(LOOP_END, *SLOW)
    slow, _ = vehicle_end.wait_for("a stop", "DRIVE_COMMAND", REASON="LINK_DOWN", SAFE_STOP=1, ENABLE=1, since=moving)
    standing, _ = vehicle_end.wait_until("the vehicle stands", is_standing, since=slow)
    record = vehicle_end.record(slow, standing)
    assert {pair.reason for pair in record.pairs} == {"LINK_DOWN"}
    assert all(decoded["MODE"] == AUTONOMOUS for decoded in record.of("VEHICLE_STATUS"))
    assert [gap for gap in record.counter_gaps if gap.startswith(PAIR)] == []
    assert record.violations == []
    cable.queue(LOOP_END, *OPEN)
    driving = wait_until_driven(vehicle_end, since=vehicle_end.now())
    end = vehicle_end.wait_samples(30, since=driving)
    assert decided(vehicle_end.record(driving, end)) == ["NOMINAL"]
    assert not vehicle_end.record(driving, end).faults()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    found = summary(cable_programs)
    assert found["bus_counters"]["send_no_room"] > 10
    assert found["counts"]["link_losses"] == 0
