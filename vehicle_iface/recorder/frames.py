"""All frames of a SocketCAN interface as lines of a candump log, from a socket that sends nothing."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from vehicle_iface.bus.raw_socket import (
    EFF_FLAG,
    EFF_MASK,
    ERR_FLAG,
    ERR_MASK,
    RTR_FLAG,
    SFF_MASK,
    dropped_frames,
    opened,
)
from vehicle_iface.bus.receive import BATCH, BatchReceiver, Packet
from vehicle_iface.errors import BusError
from vehicle_iface.units import NS_PER_S

if TYPE_CHECKING:
    import socket

RECEIVE_BUFFER_BYTES = 16 << 20
"""Room for what comes while the disk takes nothing, where the kernel allows it."""
REOPEN_NS = NS_PER_S // 10
_MOST_BATCHES = 64
_NS_PER_US = 1000


class FrameTap:
    """Hears everything. An interface that goes away is looked for at 10 Hz; `BusError` only at the start."""

    def __init__(self, channel: str, say: Callable[[str], None]) -> None:
        self._channel = channel
        self._say = say
        self._lost_before = 0
        self._lost_now = 0
        self._reopen_ns = 0
        self._socket: socket.socket | None = None
        self._open()

    @property
    def lost(self) -> int:
        """Frames that the kernel had no room for while we did not come."""
        return self._lost_before + self._lost_now

    def take(self, now_ns: int) -> list[bytes]:
        """The lines of all frames since the last call."""
        lines: list[bytes] = []
        if self._socket is None and not self._reopened(now_ns):
            return lines
        try:
            for _ in range(_MOST_BATCHES):
                packets = self._receiver.receive(wait=False)
                lines += [
                    line(self._channel, packet, self._receiver.flags(place)) for place, packet in enumerate(packets)
                ]
                if len(packets) < BATCH:
                    break
            assert self._socket is not None
            self._lost_now = dropped_frames(self._socket)
        except OSError as error:
            self._say(f"{self._channel}: {error.strerror}; no frame is recorded until it is back")
            self.close()
            self._reopen_ns = now_ns + REOPEN_NS
        return lines

    def close(self) -> None:
        """Give the socket back. May be called twice."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None
        self._lost_before, self._lost_now = self.lost, 0

    def _open(self) -> None:
        self._socket = opened(self._channel, None, receive_bytes=RECEIVE_BUFFER_BYTES, errors=True)
        self._receiver = BatchReceiver(self._socket.fileno())

    def _reopened(self, now_ns: int) -> bool:
        if now_ns < self._reopen_ns:
            return False
        self._reopen_ns = now_ns + REOPEN_NS
        try:
            self._open()
        except BusError:
            return False
        self._say(f"{self._channel}: is back, its frames are recorded again")
        return True


def line(channel: str, packet: Packet, flags: int) -> bytes:
    """A frame as `candump -L` writes it; `flags` is the byte of that name of an FD frame."""
    word, data, is_fd, wall_ns, _, _ = packet
    seconds, rest_ns = divmod(wall_ns, NS_PER_S)
    return f"({seconds:010d}.{rest_ns // _NS_PER_US:06d}) {channel} {_frame_text(word, data, is_fd, flags)}\n".encode()


def _frame_text(word: int, data: bytes, is_fd: bool, flags: int) -> str:
    if word & ERR_FLAG:
        return f"{word & (ERR_FLAG | ERR_MASK):08X}#{data.hex().upper()}"
    name = f"{word & EFF_MASK:08X}" if word & EFF_FLAG else f"{word & SFF_MASK:03X}"
    if word & RTR_FLAG:
        return f"{name}#R{len(data) or ''}"
    return f"{name}##{flags & 0xF:X}{data.hex().upper()}" if is_fd else f"{name}#{data.hex().upper()}"
