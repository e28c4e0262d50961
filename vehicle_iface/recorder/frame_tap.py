"""All frames of a SocketCAN interface as lines of a candump log, from a socket that sends nothing."""

import heapq
from collections.abc import Callable, Sequence
from contextlib import ExitStack

from vehicle_iface.bus.listening import ListeningSocket
from vehicle_iface.bus.raw_socket import EFF_FLAG, EFF_MASK, ERR_FLAG, ERR_MASK, RTR_FLAG, SFF_MASK
from vehicle_iface.bus.receive import BatchReceiver, Packet
from vehicle_iface.units import NS_PER_S

RECEIVE_BUFFER_BYTES = 16 << 20
"""Room for the frames received while the disk blocks, where the kernel allows it."""
REOPEN_NS = NS_PER_S // 10
_MAX_BATCHES = 64
_NS_PER_US = 1000


class FrameTap:
    """Receives every frame. A lost interface is reopened at 10 Hz; `BusError` only at the start."""

    def __init__(self, channel: str, notify: Callable[[str], None]) -> None:
        self._channel = channel
        self._notify = notify
        self._socket = ListeningSocket(channel, BatchReceiver, receive_bytes=RECEIVE_BUFFER_BYTES, reopen_ns=REOPEN_NS)
        self._socket.open()

    @property
    def lost(self) -> int:
        """Number of frames that the kernel dropped because its buffer was full."""
        return self._socket.lost

    def read(self, now_ns: int) -> list[bytes]:
        """Return all frames since the last call, as lines."""
        lines: list[bytes] = []

        def receive(receiver: BatchReceiver) -> int:
            packets = receiver.receive(wait=False)
            lines.extend(
                format_frame(self._channel, packet, receiver.flags(place)) for place, packet in enumerate(packets)
            )
            return len(packets)

        was_open = self._socket.is_open
        self._socket.read(now_ns, receive, most_batches=_MAX_BATCHES)
        if was_open and not self._socket.is_open:
            self._notify(f"{self._socket.problem}; no frames are recorded until it is back")
        elif self._socket.is_open and not was_open:
            self._notify(f"{self._channel}: is back; frames are recorded again")
        return lines

    def close(self) -> None:
        """Close the socket. May be called twice."""
        self._socket.close()


class FrameTaps:
    """The taps of several buses as one: the lines of one `read` are in the order of their stamps."""

    def __init__(self, channels: Sequence[str], notify: Callable[[str], None]) -> None:
        """Raises `BusError` when a bus cannot be opened."""
        self._taps: list[FrameTap] = []
        with ExitStack() as unless_all_open:
            for channel in channels:
                self._taps.append(FrameTap(channel, notify))
                unless_all_open.callback(self._taps[-1].close)
            unless_all_open.pop_all()

    @property
    def lost(self) -> int:
        """Number of frames that the kernel dropped because a buffer was full."""
        return sum(tap.lost for tap in self._taps)

    def read(self, now_ns: int) -> list[bytes]:
        """Return all frames since the last call, as lines, sorted by the fixed-width stamp in front."""
        lines = [tap.read(now_ns) for tap in self._taps]
        return lines[0] if len(lines) == 1 else list(heapq.merge(*lines, key=lambda line: line.partition(b")")[0]))

    def close(self) -> None:
        """Close all sockets. May be called twice."""
        for tap in self._taps:
            tap.close()


def format_frame(channel: str, packet: Packet, flags: int) -> bytes:
    """Format a frame like `candump -L`; `flags` is the flags byte of an FD frame."""
    word, data, is_fd, wall_ns, _, _ = packet
    seconds, rest_ns = divmod(wall_ns, NS_PER_S)
    stamp = f"{seconds:010d}.{rest_ns // _NS_PER_US:06d}"
    return f"({stamp}) {channel} {_format_data(word, data, is_fd, flags)}\n".encode()


def _format_data(word: int, data: bytes, is_fd: bool, flags: int) -> str:
    if word & ERR_FLAG:
        return f"{word & (ERR_FLAG | ERR_MASK):08X}#{data.hex().upper()}"
    name = f"{word & EFF_MASK:08X}" if word & EFF_FLAG else f"{word & SFF_MASK:03X}"
    if word & RTR_FLAG:
        return f"{name}#R{len(data) or ''}"
    return f"{name}##{flags & 0xF:X}{data.hex().upper()}" if is_fd else f"{name}#{data.hex().upper()}"
