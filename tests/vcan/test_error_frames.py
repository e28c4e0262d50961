"""What the CAN hardware reports: error frames, forged on vcan0."""

import signal
import struct

import pytest
from vehicle_bus_contract.reference import FAULT
from vehicle_bus_contract.socketcan import open_socket

from .conftest import Programs
from .driving import driven, own_faults, summary, wait_until_driven
from .observer import CHANNEL, Observer
from .peer import Vehicle

pytestmark = pytest.mark.usefixtures("vehicle")

ERROR = 0x20000000
CLASSES = {
    "transmit timeout": (0x1, 0),
    "arbitration lost": (0x2, 0),
    "controller overflow": (0x4, 0x01),
    "error warning": (0x4, 0x04),
    "error passive": (0x4, 0x10),
    "error active": (0x4, 0x40),
    "protocol error": (0x8, 0),
    "transceiver": (0x10, 0),
    "no acknowledgement": (0x20, 0),
    "bus error": (0x80, 0),
    "restarted": (0x100, 0),
}
"""All that <linux/can/error.h> knows but bus off: class and data byte 1."""


def report(error_class: int, controller: int = 0) -> None:
    """Put one error frame on the bus, as a driver does."""
    with open_socket(CHANNEL) as raw:
        raw.send(struct.pack("=IB3x8s", ERROR | error_class, 8, bytes([0, controller]).ljust(8, b"\0")))


def test_a_controller_that_goes_bus_off_silences_the_loop_and_latches(programs: Programs, bus: Observer) -> None:
    loop, _ = driven(programs, bus)
    report(0x40)
    loop.wait_for_line(r"link DOWN: .*bus off")
    loop.wait_for_line(r"SILENT \(LINK_DOWN\)")
    begin = bus.wait_samples(5)
    end = bus.wait_samples(30)
    assert bus.record(begin, end).pairs == []
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4
    assert summary(programs)["link_events"]["bus off"] == 1


def test_can_controller_warnings_are_counted_and_driving_continues(programs: Programs, bus: Observer) -> None:
    loop, moving = driven(programs, bus)
    report(0x4, controller=0x08)
    report(0x4, controller=0x20)
    report(0x2)
    loop.wait_for_line("arbitration lost")
    end = bus.wait_samples(20)
    assert {pair.reason for pair in bus.record(moving, end).pairs} == {"NOMINAL"}
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    events = summary(programs)["link_events"]
    assert events == {"error warning": 1, "error passive": 1, "arbitration lost": 1}
    counters = summary(programs)["bus_counters"]
    assert counters["send_confirmed"] > 0
    assert 0 <= counters["sent"] - counters["send_confirmed"] < 40  # the last ones come after the last look


def test_each_class_of_error_frame_is_counted_by_name_and_never_decoded_as_state(
    programs: Programs, bus: Observer
) -> None:
    loop, moving = driven(programs, bus)
    for name, (error_class, controller) in CLASSES.items():
        report(error_class, controller)
        loop.wait_for_line(name)
    end = bus.wait_samples(20)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert not own_faults(bus.record(moving, end))
    found = summary(programs)
    assert found["link_events"] == dict.fromkeys(CLASSES, 1)
    assert found["bus_counters"]["error_frames"] == len(CLASSES)
    assert found["counts"]["link_losses"] == 0
    assert found["drops"] == {}


def test_after_bus_off_and_a_restart_the_vehicle_is_driven_again_only_when_armed(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, moving = driven(programs, bus)
    report(0x40)
    loop.wait_for_line("link RECOVERING")
    report(0x100)
    loop.wait_for_line("restarted")
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    vehicle.make_ready()
    quiet = bus.wait_samples(80, since=fault)
    assert bus.sent_by_controller(fault, quiet) == []
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=quiet)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert summary(programs)["link_events"] == {"bus off": 1, "restarted": 1}
