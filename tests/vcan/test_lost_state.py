"""State that is missing or damaged: what is dropped, when the vehicle is stopped, when the loop goes silent."""

import signal
from collections.abc import Callable
from itertools import pairwise

import pytest
from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import AUTONOMOUS, COUNTERS, FAULT, MS, SAMPLE, Frame, pack
from vehicle_bus_contract.socketcan import open_socket, send

from .conftest import Programs
from .driving import driven, own_faults, summary, wait_until_driven
from .observer import CHANNEL, Observer, decided, reasons
from .peer import ALWAYS, Vehicle

STOP_WITHIN_NS = 150 * MS
SLACK_NS = 60 * MS
SILENT_WITHIN_NS = 500 * MS
STATUS_STALE_NS = 100 * MS
HELD_NS = 200 * MS
"""A stop for stale state goes on for so long after the state is back."""


def gap(record: Record) -> tuple[int, int]:
    """The longest time without a complete sample: when it began and when it ended, ns."""
    stamps = [sample.stamp_ns for sample in record.samples]
    return max(pairwise(stamps), key=lambda ends: ends[1] - ends[0])


@pytest.mark.parametrize("samples", [8, 20, 35])
def test_a_stop_is_commanded_while_samples_are_missing_and_driving_resumes_after_it(
    programs: Programs, bus: Observer, vehicle: Vehicle, samples: int
) -> None:
    _, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.mute(samples)
    index, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_STALE", since=moving)
    index, _ = bus.wait_for("driving on", "DRIVE_COMMAND", REASON="NOMINAL", since=index)
    record = bus.record(moving, bus.wait_samples(50, since=index))
    lost_ns, back_ns = gap(record)
    stale = [pair for pair in record.pairs if pair.reason == "STATE_STALE"]
    assert reasons(record.pairs) == ["NOMINAL", "STATE_STALE", "NOMINAL"]
    assert all(pair.is_enabled and pair.is_stop for pair in stale)
    assert stale[0].stamp_ns - lost_ns <= STOP_WITHIN_NS + SLACK_NS
    assert all(lost_ns < pair.stamp_ns < back_ns + HELD_NS + SLACK_NS for pair in stale)
    assert stale[-1].stamp_ns >= back_ns + HELD_NS - SLACK_NS
    assert len(stale) >= (samples - 5) // 2  # each 10 ms from 50 ms on; half of them on a slow machine
    assert all(decoded["MODE"] == AUTONOMOUS for decoded in record.of("VEHICLE_STATUS"))
    assert not own_faults(record)


def test_half_a_second_without_state_silences_the_loop_until_armed_again(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.mute(ALWAYS)
    bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_STALE", since=moving)
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    record = bus.record(moving, fault)
    lost_ns, last_ns = record.samples[-1].stamp_ns, record.pairs[-1].stamp_ns
    assert reasons(record.pairs) == ["NOMINAL", "STATE_STALE"]
    assert SILENT_WITHIN_NS - SLACK_NS <= last_ns - lost_ns <= SILENT_WITHIN_NS + SLACK_NS
    vehicle.mute(0)
    bus.wait_samples(50)
    vehicle.make_ready()
    armed = bus.wait_samples(80)
    assert bus.sent_by_controller(fault, armed) == []
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=armed)
    end = bus.wait_samples(30, since=driving)
    assert not bus.record(driving, end).faults()


def test_a_frame_with_a_wrong_crc_is_dropped_and_counted_and_nothing_else_happens(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    for name in SAMPLE:
        vehicle.faults.crc[name] = 1
        bus.wait_samples(25)
    vehicle.faults.crc["MOTION"] = 2
    end = bus.wait_samples(30)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    record = bus.record(moving, end)
    assert len(record.crc_errors) == 5
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    drops = summary(programs)["drops"]
    assert [drops[f"bad CRC {name}"] for name in SAMPLE] == [1, 3, 1]


def test_four_wrong_crcs_in_a_row_cause_at_most_a_brief_stop(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    _, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.faults.crc["POSE"] = 4
    record = bus.record(moving, bus.wait_samples(50))
    assert set(reasons(record.pairs)) <= {"NOMINAL", "STATE_STALE"}
    # 40 ms without a sample, or 10 ms more where the next one is late: then the stop is held for 0.2 s.
    assert len([pair for pair in record.pairs if pair.is_stop]) <= 25
    assert record.pairs[-1].reason == "NOMINAL"
    assert all(decoded["MODE"] == AUTONOMOUS for decoded in record.of("VEHICLE_STATUS"))
    assert not own_faults(record)


def test_a_crc_that_is_always_wrong_stops_the_vehicle(programs: Programs, bus: Observer, vehicle: Vehicle) -> None:
    _, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.faults.crc["MOTION"] = ALWAYS
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    record = bus.record(moving, fault)
    assert reasons(record.pairs) == ["NOMINAL", "STATE_STALE"]
    stop = next(pair for pair in record.pairs if pair.is_stop)
    assert stop.stamp_ns - record.samples[-1].stamp_ns <= STOP_WITHIN_NS + SLACK_NS
    assert bus.sent_by_controller(fault, bus.wait_samples(60, since=fault)) == []


def test_repeated_and_jumping_counters_are_dropped_and_lost_ones_are_only_counted(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    vehicle.faults.repeated = 3
    bus.wait_samples(25)
    vehicle.faults.skipped = 7
    bus.wait_samples(25)
    vehicle.faults.skipped = 2
    end = bus.wait_samples(25)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    found = summary(programs)
    for name in SAMPLE:
        assert found["drops"][f"repeated {name}"] == 3
        assert found["drops"][f"wrong sequence {name}"] == 1
        assert found["lost"][name] == 2


def test_a_frozen_counter_stops_the_vehicle(programs: Programs, bus: Observer, vehicle: Vehicle) -> None:
    _, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    vehicle.faults.repeated = ALWAYS
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    record = bus.record(moving, fault)
    assert reasons(record.pairs) == ["NOMINAL", "STATE_STALE"]
    stop = next(pair for pair in record.pairs if pair.is_stop)
    assert stop.stamp_ns - record.samples[-1].stamp_ns <= STOP_WITHIN_NS + SLACK_NS


@pytest.mark.usefixtures("vehicle")
def test_frames_with_our_ids_and_a_wrong_kind_or_length_are_dropped_and_counted(
    programs: Programs, bus: Observer
) -> None:
    loop, moving = driven(programs, bus)
    names = (*SAMPLE, "VEHICLE_STATUS")
    with open_socket(CHANNEL) as raw:
        for name in names:
            for counter in range(COUNTERS):  # one of them would be the next one, if kind and length were right
                can_id, data = pack(name, counter, MODE=4) if name == names[-1] else pack(name, counter)
                assert send(raw, Frame(0, can_id, data[:5]))
                assert send(raw, Frame(0, can_id, b""))
                assert send(raw, Frame(0, can_id, data, is_extended=True))
                assert send(raw, Frame(0, can_id, data, is_remote=True))
                assert send(raw, Frame(0, can_id, data, is_fd=True))
            bus.wait_samples(5)
    end = bus.wait_samples(30)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    drops = summary(programs)["drops"]
    for name in names:
        assert drops[f"wrong length {name}"] == 2 * COUNTERS
        assert drops[f"wrong type {name}"] == 3 * COUNTERS


def test_a_missing_status_stops_the_vehicle_after_100_ms(programs: Programs, bus: Observer, vehicle: Vehicle) -> None:
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
def test_samples_that_stay_incomplete_stop_the_vehicle_and_then_silence_the_loop(
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
