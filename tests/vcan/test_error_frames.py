"""What the CAN hardware reports: error frames, forged on vcan0."""

import signal
import struct

import pytest

from .conftest import Programs
from .contract import Observer, raw_socket
from .driving import driven, summary

pytestmark = pytest.mark.usefixtures("vehicle")

ERROR = 0x20000000


def report(error_class: int, controller: int = 0) -> None:
    """Put one error frame on the bus, as a driver does."""
    with raw_socket() as raw:
        raw.send(struct.pack("=IB3x8s", ERROR | error_class, 8, bytes([0, controller]).ljust(8, b"\0")))


def test_a_controller_that_goes_bus_off_silences_the_loop_and_latches(programs: Programs, bus: Observer) -> None:
    loop, _ = driven(programs, bus)
    report(0x40)
    loop.says(r"link DOWN: .*bus off")
    loop.says(r"SILENT \(LINK_DOWN\)")
    begin = bus.wait_samples(5)
    end = bus.wait_samples(30)
    assert bus.record(begin, end).pairs == []
    loop.tell(signal.SIGTERM)
    assert loop.ends() == 4
    assert summary(programs)["link_events"]["bus off"] == 1


def test_warnings_of_the_controller_are_counted_and_the_vehicle_drives_on(programs: Programs, bus: Observer) -> None:
    loop, moving = driven(programs, bus)
    report(0x4, controller=0x08)
    report(0x4, controller=0x20)
    report(0x2)
    loop.says("arbitration lost")
    end = bus.wait_samples(20)
    assert {pair.reason for pair in bus.record(moving, end).pairs} == {"NOMINAL"}
    loop.tell(signal.SIGTERM)
    assert loop.ends() == 0
    events = summary(programs)["link_events"]
    assert events == {"error warning": 1, "error passive": 1, "arbitration lost": 1}
    counters = summary(programs)["bus_counters"]
    assert counters["send_confirmed"] > 0
    assert 0 <= counters["sent"] - counters["send_confirmed"] < 40  # the last ones come after the last look
