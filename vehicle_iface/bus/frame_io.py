"""Received datagrams to frames, and frames to datagrams: in C where it is built (`_wire.c`), or in Python."""

from collections.abc import Sequence
from typing import Protocol

from vehicle_iface import wire
from vehicle_iface.bus.raw_socket import SFF_MASK, pack_frame, unpack_frame
from vehicle_iface.bus.receive import BatchReceiver, Packet
from vehicle_iface.bus.transmit import BatchSender
from vehicle_iface.frame import CanFrame, unchecked_frame


class FrameReceiver(Protocol):
    """Receives frames from one CAN socket."""

    def receive(self, wait: bool, /) -> int:
        """Receive the queued frames, at most `BATCH`; return how many.

        With `wait`, sleep until the first, or the socket's time-out. Raises `OSError` for an error that the socket
        reports (interface down, gone, …).
        """
        ...

    def take(self, inbox: list[CanFrame], offset_ns: int, now_ns: int, /) -> int:
        """Append the received frames to `inbox`; return how many the kernel has dropped before them.

        `offset_ns` is added to the kernel's stamps. A frame without a stamp, or with one later than `now_ns`, gets
        `now_ns`.
        """
        ...


class FrameSender(Protocol):
    """Sends frames on one CAN socket."""

    def send(self, frames: tuple[CanFrame, ...], /) -> int:
        """Send at most `MOST_AT_ONCE` frames without waiting; return how many the kernel accepted.

        Sending ends at the first frame that finds the queue full. Raises `OSError` for any other error of the socket.
        """
        ...


def open_receiver(descriptor: int, bus: int) -> FrameReceiver:
    """Return a receiver of frames of bus number `bus` in the profile."""
    if wire.uses_c():
        from vehicle_iface import _wire

        return _wire.FrameReceiver(descriptor, CanFrame, bus)
    return PythonReceiver(descriptor, bus)


def open_sender(descriptor: int) -> FrameSender:
    """Return a sender."""
    if wire.uses_c():
        from vehicle_iface import _wire

        return _wire.FrameSender(descriptor, pack_frame)
    return PythonSender(descriptor)


class PythonReceiver:
    """The receiver in Python."""

    def __init__(self, descriptor: int, bus: int) -> None:
        self._receiver = BatchReceiver(descriptor)
        self._bus = bus
        self._packets: Sequence[Packet] = ()
        self._dropped = 0

    def receive(self, wait: bool, /) -> int:
        self._packets = ()
        self._packets = self._receiver.receive(wait=wait)
        return len(self._packets)

    def take(self, inbox: list[CanFrame], offset_ns: int, now_ns: int, /) -> int:
        bus, lost = self._bus, 0
        for packet in self._packets:
            word, data, is_fd, wall_ns, dropped, _ = packet
            # Never later than now: a wall clock set forwards between the stamp and our reading of it would make
            # an old frame look fresh.
            stamp_ns = wall_ns + offset_ns if wall_ns else now_ns
            if stamp_ns > now_ns:
                stamp_ns = now_ns
            if word <= SFF_MASK:  # the usual case: a standard data frame
                inbox.append(unchecked_frame((word, data, stamp_ns, False, False, is_fd, False, bus)))
            else:
                inbox.append(unpack_frame(packet, stamp_ns, bus))
            if dropped:
                lost += (dropped - self._dropped) & 0xFFFFFFFF
                self._dropped = dropped
        self._packets = ()
        return lost


class PythonSender:
    """The sender in Python."""

    def __init__(self, descriptor: int) -> None:
        self._sender = BatchSender(descriptor)

    def send(self, frames: tuple[CanFrame, ...], /) -> int:
        return self._sender.send([pack_frame(frame) for frame in frames])
