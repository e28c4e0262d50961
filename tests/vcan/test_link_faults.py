"""An interface that goes down, comes back, is deleted, and is made anew under its name."""

import fcntl
import signal
import socket
import struct
import subprocess
import time
from typing import Any

import pytest
from vehicle_bus_contract.reference import FAULT, DecodedFrame, S

from .conftest import IFF_UP, Program, Programs
from .driving import driven, summary, wait_until_driven
from .observer import CHANNEL, Observer
from .peer import Vehicle

NOTICED_WITHIN_S = 0.1
SLACK_S = 0.06
_SIOCGIFFLAGS, _SIOCSIFFLAGS = 0x8913, 0x8914


def switch(*states: bool) -> int:
    """Set the link up or down, one state right after the other; the wall clock, ns, then."""
    name = CHANNEL.encode()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        flags = struct.unpack_from("16xH", fcntl.ioctl(control, _SIOCGIFFLAGS, struct.pack("16sH22x", name, 0)))[0]
        for is_up in states:
            wanted = flags | IFF_UP if is_up else flags & ~IFF_UP
            fcntl.ioctl(control, _SIOCSIFFLAGS, struct.pack("16sH22x", name, wanted))
    return time.time_ns()  # the clock of the kernel's stamps


def delete() -> int:
    """Delete the interface; the wall clock, ns, then."""
    _ip("link", "del", CHANNEL)
    return time.time_ns()


def create() -> None:
    """A new interface with the old name."""
    _ip("link", "add", "dev", CHANNEL, "type", "vcan")
    _ip("link", "set", CHANNEL, "up")


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


def noticed_s(found: dict[str, Any], first: DecodedFrame, cut_ns: int) -> float:
    """How long after the fault the loop noted it; its clock is tied to ours by its first enabled command."""
    engaged_s = next(change["at_s"] for change in found["transitions"] if change["mode"] == "ENGAGING")
    silent_s = next(change["at_s"] for change in found["transitions"] if change["mode"] == "SILENT")
    return float(silent_s - engaged_s - (cut_ns - first.stamp_ns) / S)


def recovers(bus: Observer, vehicle: Vehicle, loop: Program, since: int) -> None:
    """The loop is silent although the bus is well, and drives again once it is armed again."""
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=since)
    vehicle.make_ready()
    quiet = bus.wait_samples(80, since=fault)
    assert bus.sent_by_controller(since, quiet) == []
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=quiet)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()


def ended(programs: Programs, loop: Program) -> dict[str, Any]:
    """The summary of a loop that is asked to end, and does so without a fault."""
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    return summary(programs)


def states(found: dict[str, Any]) -> list[str]:
    """What the link has been."""
    return [change["state"] for change in found["link"]["transitions"]]


@pytest.mark.parametrize("kind", ["blip", "down"])
def test_a_link_loss_is_detected_at_once_even_if_the_link_returns_at_once(
    programs: Programs, bus: Observer, vehicle: Vehicle, kind: str
) -> None:
    loop, moving = driven(programs, bus)
    _, first = bus.wait_for("the first command", "DRIVE_COMMAND", ENABLE=1)
    cut_ns = switch(False, True) if kind == "blip" else switch(False)
    loop.wait_for_line("link DOWN")
    if kind == "down":
        time.sleep(0.5)
        switch(True)
    loop.wait_for_line("link RECOVERING")
    cut = bus.wait_samples(5)
    assert not bus.record(moving, cut).violations
    recovers(bus, vehicle, loop, cut)
    found = ended(programs, loop)
    assert found["counts"]["link_losses"] == 1
    assert noticed_s(found, first, cut_ns) < NOTICED_WITHIN_S + SLACK_S
    assert "DOWN" in states(found)
    assert found["link"]["state"] == "UP"


@pytest.mark.parametrize("absent_s", [0.0, 1.0], ids=["at-once", "after-1-s"])
def test_a_recreated_interface_is_reopened_by_the_same_process_and_driven_when_armed(
    programs: Programs, bus: Observer, vehicle: Vehicle, absent_s: float
) -> None:
    loop, moving = driven(programs, bus)
    _, first = bus.wait_for("the first command", "DRIVE_COMMAND", ENABLE=1)
    before = socket.if_nametoindex(CHANNEL)
    cut_ns = delete()
    try:
        time.sleep(absent_s)
    finally:
        create()
    assert socket.if_nametoindex(CHANNEL) != before
    cut = bus.now()
    bus.reconnect()
    vehicle.reconnect()
    loop.wait_for_line("link RECOVERING")
    assert not bus.record(moving, cut).violations
    recovers(bus, vehicle, loop, cut)
    found = ended(programs, loop)
    assert found["counts"]["link_losses"] == 1
    assert noticed_s(found, first, cut_ns) < NOTICED_WITHIN_S + SLACK_S
    assert {"GONE", "DOWN"} & set(states(found))
    assert absent_s == 0.0 or "GONE" in states(found)
    assert found["link"]["state"] == "UP"


@pytest.mark.usefixtures("vehicle")
def test_a_loop_without_its_interface_waits_and_exits_with_4_on_request(programs: Programs, bus: Observer) -> None:
    loop, _ = driven(programs, bus)
    delete()
    try:
        loop.wait_for_line("link GONE")
        time.sleep(0.5)
        assert loop.is_running
        loop.send_signal(signal.SIGTERM)
        assert loop.wait_for_end() == 4
    finally:
        create()
    found = summary(programs)
    assert found["latched_fault"] == "LINK_DOWN"
    assert found["link"]["state"] == "GONE"


def test_an_arming_while_the_interface_is_absent_does_not_count_when_it_returns(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop, _ = driven(programs, bus)
    delete()
    try:
        loop.wait_for_line("link GONE")
        loop.send_signal(signal.SIGUSR1)
        time.sleep(0.3)
    finally:
        create()
    cut = bus.now()
    bus.reconnect()
    vehicle.reconnect()
    recovers(bus, vehicle, loop, cut)
