"""Frames that are lost, doubled, overtaken and damaged on their way, by the kernel's own netem.

What arrived is taken from the loop's end of the cable, and counted there frame by frame.
"""

import signal
from collections import Counter
from itertools import pairwise
from typing import Any

import pytest
from vehicle_bus_contract.cable import LOOP_END, VEHICLE_END, Cable
from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import AUTONOMOUS, CONTROLLER_SENDS, COUNTERS, FAULT, GREATEST_STEP, SAMPLE

from .conftest import Program, Programs
from .driving import driven, own_faults, summary, wait_until_driven
from .observer import Observer, decided, reasons
from .peer import Vehicle

STATE_IDS = (0x110, 0x7FC)
"""POSE, MOTION and CHASSIS: value and mask."""
HEARD = (*SAMPLE, "VEHICLE_STATUS")


def drops(programs: Programs, loop: Program) -> dict[str, Any]:
    """The summary of a loop that is asked to end, and does so without a fault."""
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    return summary(programs)


def steps(record: Record, name: str) -> Counter[int]:
    """How often a message's counter stepped by how much, as its intact frames arrived."""
    return Counter((after.counter - before.counter) % COUNTERS for before, after in pairwise(record.of(name)))


def missing(record: Record, name: str) -> int:
    """How many frames the steps of a message's counter leave out."""
    return sum((step - 1) * count for step, count in steps(record, name).items())


@pytest.mark.usefixtures("far_vehicle")
def test_one_percent_of_lost_state_frames_is_counted_and_driving_continues(
    cable_programs: Programs, cable: Cable, loop_end: Observer
) -> None:
    loop, moving = driven(cable_programs, loop_end)
    cable.queue(VEHICLE_END, "netem", "loss", "1%")
    loop_end.wait_samples(400)
    cable.remove_queue(VEHICLE_END)
    end = loop_end.wait_samples(20)
    found = drops(cable_programs, loop)
    assert decided(loop_end.record(moving, end)) == ["NOMINAL"]
    assert not own_faults(loop_end.record(moving, end))
    assert found["lost"] == {name: missing(loop_end.record(), name) for name in HEARD}
    assert sum(found["lost"].values()) > 0
    assert found["drops"] == {}


@pytest.mark.usefixtures("far_vehicle")
def test_duplicated_state_frames_are_dropped_as_repeated_and_answered_once(
    cable_programs: Programs, cable: Cable, loop_end: Observer
) -> None:
    loop, moving = driven(cable_programs, loop_end)
    cable.queue(VEHICLE_END, "netem", "duplicate", "10%")
    loop_end.wait_samples(150)
    cable.remove_queue(VEHICLE_END)
    end = loop_end.wait_samples(20)
    found = drops(cable_programs, loop)
    assert decided(loop_end.record(moving, end)) == ["NOMINAL"]
    assert not own_faults(loop_end.record(moving, end))
    assert found["drops"] == {f"repeated {name}": steps(loop_end.record(), name)[0] for name in HEARD}
    assert all(found["drops"].values())
    assert not any(found["lost"].values())


@pytest.mark.usefixtures("far_vehicle")
def test_reordered_state_frames_are_dropped_as_out_of_sequence(
    cable_programs: Programs, cable: Cable, loop_end: Observer
) -> None:
    loop, moving = driven(cable_programs, loop_end)
    cable.queue(VEHICLE_END, "netem", "delay", "20ms", "reorder", "10%")
    loop_end.wait_samples(150)
    cable.remove_queue(VEHICLE_END)
    end = loop_end.wait_samples(30)
    found = drops(cable_programs, loop)
    record = loop_end.record(moving, end)
    assert set(reasons(record.pairs)) <= {"NOMINAL", "STATE_STALE"}
    assert record.pairs[-1].reason == "NOMINAL"
    assert record.violations == []
    assert [gap for gap in record.counter_gaps if gap.startswith(CONTROLLER_SENDS)] == []
    for name in HEARD:
        wrong = sum(count for step, count in steps(loop_end.record(), name).items() if step > GREATEST_STEP)
        assert found["drops"][f"wrong sequence {name}"] == wrong > 0


@pytest.mark.usefixtures("far_vehicle")
def test_damaged_state_frames_are_dropped_by_cause_and_driving_continues(
    cable_programs: Programs, cable: Cable, loop_end: Observer
) -> None:
    loop, moving = driven(cable_programs, loop_end)
    cable.queue_some(VEHICLE_END, *STATE_IDS, "corrupt", "5%")
    loop_end.wait_samples(200)
    cable.remove_queue(VEHICLE_END)
    end = loop_end.wait_samples(20)
    found = drops(cable_programs, loop)
    record = loop_end.record()
    assert set(reasons(loop_end.record(moving, end).pairs)) <= {"NOMINAL", "STATE_STALE"}
    assert not own_faults(loop_end.record(moving, end))
    wrong = Counter(name for name, _ in record.damaged)
    malformed = Counter(text.split()[0] for text in record.malformed)
    assert sum(wrong.values()) > 0
    for name in HEARD:
        assert found["drops"].get(f"bad CRC {name}", 0) == wrong[name]
        shapes = found["drops"].get(f"wrong length {name}", 0) + found["drops"].get(f"wrong type {name}", 0)
        assert shapes == malformed[name]


def test_lost_duplicated_and_damaged_commands_are_compensated_by_the_next_ones(
    cable_programs: Programs, cable: Cable, loop_end: Observer, vehicle_end: Observer, far_vehicle: Vehicle
) -> None:
    loop, moving = driven(cable_programs, vehicle_end)
    begin = loop_end.now()
    cable.queue(LOOP_END, "netem", "loss", "1%", "duplicate", "1%", "corrupt", "1%")
    vehicle_end.wait_samples(300)
    cable.remove_queue(LOOP_END)
    end = vehicle_end.wait_samples(20)
    arrived = vehicle_end.record(moving, end)
    assert any(steps(arrived, name).keys() - {1} for name in CONTROLLER_SENDS)  # it was a bad cable
    assert all(decoded["MODE"] == AUTONOMOUS for decoded in arrived.of("VEHICLE_STATUS"))
    assert abs(far_vehicle.y_m) < 0.1
    assert decided(loop_end.record(begin)) == ["NOMINAL"]
    assert not own_faults(loop_end.record(begin))
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0


def test_a_cable_cut_of_60_ms_stops_briefly_and_one_of_600_ms_silences_until_armed(
    cable_programs: Programs, cable: Cable, loop_end: Observer, far_vehicle: Vehicle
) -> None:
    loop, moving = driven(cable_programs, loop_end)
    cable.lose_all(VEHICLE_END, 0.06)
    moment = loop_end.wait_samples(50)
    record = loop_end.record(moving, moment)
    assert reasons(record.pairs) in (["NOMINAL", "STATE_STALE", "NOMINAL"], ["NOMINAL"])
    assert all(decoded["MODE"] == AUTONOMOUS for decoded in record.of("VEHICLE_STATUS"))
    assert not own_faults(record)
    cable.lose_all(VEHICLE_END, 0.6)
    loop.wait_for_line("SILENT .STATE_STALE")
    fault, _ = loop_end.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moment)
    record = loop_end.record(moment, fault)
    assert reasons(record.pairs) == ["NOMINAL", "STATE_STALE"]
    assert not own_faults(record)
    far_vehicle.make_ready()
    quiet = loop_end.wait_samples(60, since=fault)
    assert loop_end.sent_by_controller(fault, quiet) == []
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(loop_end, since=quiet)
    assert not loop_end.record(driving, loop_end.wait_samples(30, since=driving)).faults()
