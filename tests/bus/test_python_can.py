"""Adapters that python-can knows, through its own virtual one."""

import itertools
from collections.abc import Iterator
from typing import Any

import can
import pytest
from can.interfaces import virtual

from vehicle_iface import clock
from vehicle_iface.bus import python_can
from vehicle_iface.bus.python_can import PythonCanBus
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame

_NUMBERS = itertools.count()
SOON_NS = 20_000_000


class Wire:
    """Our bus at one end, python-can's own at the other."""

    def __init__(self, can_ids: tuple[int, ...] = (0x100, 0x110)) -> None:
        channel = f"test {next(_NUMBERS)}"
        self.ours = PythonCanBus("virtual", channel, can_ids, bitrate=500_000)
        self.other = can.Bus(interface="virtual", channel=channel)

    def other_sends(self, can_id: int = 0x100, data: bytes = b"\x01", **kind: bool) -> None:
        self.other.send(can.Message(arbitration_id=can_id, data=data, **{"is_extended_id": False} | kind))


@pytest.fixture
def wire() -> Iterator[Wire]:
    wire = Wire()
    yield wire
    wire.ours.close()
    wire.other.shutdown()


def test_frames_come_in_order_stamped_with_the_time_at_which_they_were_read(wire: Wire) -> None:
    before_ns = clock.monotonic_ns()
    for number in range(20):
        wire.other_sends(data=bytes([number]))
    frames = wire.ours.drain()
    assert [frame.data for frame in frames] == [bytes([number]) for number in range(20)]
    assert all(before_ns <= frame.stamp_ns <= clock.monotonic_ns() for frame in frames)
    assert wire.ours.drain() == []
    assert wire.ours.counters()["received"] == 20


def test_a_frame_that_ended_the_waiting_is_not_lost(wire: Wire) -> None:
    wire.other_sends(data=b"\x07")
    wire.other_sends(data=b"\x08")
    assert wire.ours.wait(clock.monotonic_ns() + SOON_NS)
    assert wire.ours.wait(clock.monotonic_ns() + SOON_NS)
    assert [frame.data for frame in wire.ours.drain()] == [b"\x07", b"\x08"]


def test_waiting_ends_at_its_deadline_and_not_before(wire: Wire) -> None:
    until_ns = clock.monotonic_ns() + 3_000_000
    assert not wire.ours.wait(until_ns)
    assert clock.monotonic_ns() >= until_ns


def test_other_identifiers_are_filtered_out(wire: Wire) -> None:
    for can_id in (0x0FF, 0x100, 0x101, 0x110, 0x111):
        wire.other_sends(can_id)
    assert [frame.can_id for frame in wire.ours.drain()] == [0x100, 0x110]


def test_a_flood_of_other_identifiers_does_not_hold_back_what_is_behind_it(wire: Wire) -> None:
    for _ in range(2000):
        wire.other_sends(0x555)
    wire.other_sends(0x110)
    assert wire.ours.wait(clock.monotonic_ns())
    assert [frame.can_id for frame in wire.ours.drain()] == [0x110]


def test_a_frame_of_our_number_but_another_kind_comes_through_to_be_counted(wire: Wire) -> None:
    wire.other_sends(is_extended_id=True)
    wire.other_sends(data=b"", is_remote_frame=True)
    kinds = [(frame.is_extended, frame.is_remote, frame.is_fd) for frame in wire.ours.drain()]
    assert kinds == [(True, False, False), (False, True, False)]


def test_error_frames_are_counted_and_passed_over(wire: Wire) -> None:
    wire.other_sends(data=b"", is_error_frame=True)
    wire.other_sends(data=b"\x01")
    assert [frame.data for frame in wire.ours.drain()] == [b"\x01"]
    assert wire.ours.counters()["error_frames"] == 1


def test_a_sent_frame_reaches_the_other_end_and_not_the_sender(wire: Wire) -> None:
    assert wire.ours.send(CanFrame(0x080, bytes(range(8))))
    message = wire.other.recv(timeout=0)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (0x080, bytes(range(8)), False)
    assert wire.ours.drain() == []
    assert wire.ours.counters()["sent"] == 1


@pytest.fixture
def echoing(monkeypatch: pytest.MonkeyPatch) -> Iterator[Wire]:
    """An adapter that hands back what was sent through it, not marked as sent."""
    bus = can.Bus
    received = virtual.VirtualBus._recv_internal

    def open_echoing(**options: Any) -> can.BusABC:
        return bus(**options, receive_own_messages=True)

    def receive(self: Any, timeout: float | None) -> tuple[can.Message | None, bool]:
        message, is_filtered = received(self, timeout)
        if message is not None:
            message.is_rx = True
        return message, is_filtered

    monkeypatch.setattr(can, "Bus", open_echoing)
    monkeypatch.setattr(virtual.VirtualBus, "_recv_internal", receive)
    wire = Wire()
    yield wire
    wire.ours.close()
    wire.other.shutdown()


def test_a_frame_that_an_adapter_echoes_is_not_foreign(echoing: Wire) -> None:
    for number in range(3):
        assert echoing.ours.send(CanFrame(0x110, bytes([number])), CanFrame(0x100, bytes([number]))) == 2
        echoing.other_sends(0x110, bytes([number + 10]))
    assert [frame.data for frame in echoing.ours.drain()] == [b"\x0a", b"\x0b", b"\x0c"]
    assert echoing.ours.counters()["own_echoes"] == 6


def test_a_copy_of_a_frame_is_another_nodes_when_the_echo_has_come(echoing: Wire) -> None:
    echoing.ours.send(CanFrame(0x110, b"\x01"))
    echoing.other_sends(0x110, b"\x01")
    assert [frame.data for frame in echoing.ours.drain()] == [b"\x01"]


def test_a_copy_of_a_frame_is_another_nodes_when_the_echos_time_is_over(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire.ours.send(CanFrame(0x110, b"\x02"))
    late_ns = clock.monotonic_ns() + python_can.ECHO_NS + 1
    monkeypatch.setattr(clock, "monotonic_ns", lambda: late_ns)
    wire.other_sends(0x110, b"\x02")
    assert [frame.data for frame in wire.ours.drain()] == [b"\x02"]


def test_an_adapter_without_echo_keeps_no_record_of_what_was_sent(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    begin_ns = clock.monotonic_ns()
    for step in range(300):
        at_ns = begin_ns + step * 10_000_000
        monkeypatch.setattr(clock, "monotonic_ns", lambda at_ns=at_ns: at_ns)
        wire.ours.send(CanFrame(0x110, bytes([step % 256])))
    assert len(wire.ours._may_echo) <= 12


def test_a_frame_that_the_adapter_refuses_is_counted_and_lost(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise can.CanOperationError("transmit buffer full")

    monkeypatch.setattr(wire.ours._bus, "send", refuse)
    assert not wire.ours.send(CanFrame(0x080, b""))
    assert wire.ours.counters()["send_no_room"] == 1
    assert wire.ours.counters()["sent"] == 0


@pytest.mark.parametrize("error", [can.CanOperationError("gone"), OSError(19, "No such device")])
def test_an_adapter_that_is_gone_is_a_bus_error_with_its_name(
    wire: Wire, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(wire.ours._bus, "recv", fail)
    for act in (wire.ours.drain, lambda: wire.ours.wait(0)):
        with pytest.raises(BusError, match="python-can virtual test"):
            act()


def test_sending_on_a_device_that_is_gone_is_a_bus_error(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(19, "No such device")

    monkeypatch.setattr(wire.ours._bus, "send", fail)
    with pytest.raises(BusError, match="No such device"):
        wire.ours.send(CanFrame(0x080, b""))


@pytest.mark.parametrize("interface", ["no_such_adapter", "slcan"])
def test_an_adapter_that_cannot_be_opened_is_a_bus_error_with_its_name(interface: str) -> None:
    with pytest.raises(BusError, match=f"python-can {interface} nowhere: cannot be opened"):
        PythonCanBus(interface, "nowhere", [0x100], bitrate=500_000)


def test_closing_twice_is_allowed(wire: Wire) -> None:
    wire.ours.close()
    wire.ours.close()
