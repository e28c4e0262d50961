"""One SocketCAN interface as the bench uses it: every frame with the kernel's stamp, the bench's own included.

A frame that the bench sent comes back when it was on the bus (`CAN_RAW_RECV_OWN_MSGS`), so both sides of a latency
carry stamps of one clock; where the adapter stamps in hardware, those are kept beside them. The kernel's stamps are
turned to the monotonic clock by one offset, found anew only when the wall clock has stepped, so that they keep their
order.
"""

import contextlib
import errno
import os
import re
import socket
import struct
import subprocess
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from _recorder import ERROR, EXTENDED, FD_BYTES, HEADER, REMOTE, ROOM_BYTES, text
from bus_contract import Frame

SO_TIMESTAMPING = 37
CAN_RAW_ERR_FILTER = 2
RX_HARDWARE, RX_SOFTWARE, SOFTWARE, RAW_HARDWARE = 1 << 2, 1 << 3, 1 << 4, 1 << 6
MSG_CONFIRM = 0x800
STAMPS = struct.Struct("@6q")
CLASSIC_BYTES = 16
S = 1_000_000_000
DRIFT_NS = 500_000
LINK_LOST = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO)
QUEUE_FULL = (errno.ENOBUFS, errno.EAGAIN)
UNDER_WAY = 32
"""So many frames at most may still be on their way from a socket that another one has followed."""
BIT_RATE_SWITCH = 1


@dataclass(frozen=True, slots=True)
class Heard:
    """A frame that was on the bus."""

    frame: Frame
    """Its stamp is monotonic."""
    is_ours: bool
    """The bench sent it."""
    hardware_ns: int
    """By the adapter's own clock, whose zero is anywhere; 0 where it has none."""


class Bus:
    """Raises `OSError` when the interface cannot be used; afterwards it comes and goes as the interface does."""

    def __init__(self, channel: str, identifiers: Iterable[int] | None) -> None:
        """Hear these 11-bit identifiers and error frames; None: everything."""
        self.channel = channel
        self._filters = None if identifiers is None else list(identifiers)
        self._raw: socket.socket | None = None
        self._aside: list[socket.socket] = []
        self.refused = 0
        """Frames that the queue had no room for."""
        self._sent: deque[bytes] = deque(maxlen=UNDER_WAY)
        self._under_way: set[bytes] = set()
        self._probed_ns = 0
        self._clocks = _Clocks()
        self._open()

    def send(self, frame: Frame) -> bool:
        """Whether it was taken. It comes back from `drain` when it was on the bus."""
        if not self._is_there():
            return False
        assert self._raw is not None
        record = encoded(frame)
        try:
            self._raw.send(record)
        except OSError as error:
            if error.errno in QUEUE_FULL:
                self.refused += 1
            else:
                self._lose(error)
            return False
        self._sent.append(_content(record))
        return True

    def drain(self) -> Iterator[Heard]:
        """What has come since the last time."""
        if not self._is_there():
            return
        self._clocks.look()
        while self._raw is not None:
            try:
                record, ancillary, flags, _ = self._raw.recvmsg(FD_BYTES, 128)
            except BlockingIOError:
                return
            except OSError as error:
                self._lose(error)
                return
            stamp_ns, hardware_ns = self._clocks.stamps(ancillary)
            yield Heard(_decoded(record, stamp_ns), bool(flags & MSG_CONFIRM) or self._was_ours(record), hardware_ns)

    def packets(self) -> int:
        """That have gone out on the interface, whosever they are."""
        with open(f"/sys/class/net/{self.channel}/statistics/tx_packets", encoding="ascii") as counter:
            return int(counter.read())

    def close(self) -> None:
        """May be called twice."""
        for raw in (self._raw, *self._aside):
            if raw is not None:
                raw.close()
        self._raw, self._aside = None, []

    def reopen(self) -> None:
        """Use the interface that has the name now."""
        self.close()
        with contextlib.suppress(OSError):
            self._open()

    def _open(self) -> None:
        raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        try:
            if self._filters is not None:
                masks = b"".join(struct.pack("=II", can_id, 0x7FF) for can_id in self._filters)
                raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, masks)
            raw.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, 0x1FFFFFFF)
            raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
            raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, 1)
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM_BYTES)
            raw.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPING, RX_HARDWARE | RX_SOFTWARE | SOFTWARE | RAW_HARDWARE)
            raw.setblocking(False)
            raw.bind((self.channel,))
        except OSError:
            raw.close()
            raise
        self._raw = raw
        self._under_way = set(self._sent)

    def _was_ours(self, record: bytes) -> bool:
        """Whether the socket before this one had sent it: the kernel confirms frames only to their own socket."""
        content = _content(record)
        if content not in self._under_way:
            return False
        self._under_way.remove(content)
        return True

    def _is_there(self) -> bool:
        """Opens it anew, ten times a second, after it was lost."""
        if self._raw is None and time.monotonic_ns() - self._probed_ns > S // 10:
            self._probed_ns = time.monotonic_ns()
            with contextlib.suppress(OSError):
                self._open()
        return self._raw is not None

    def _lose(self, error: OSError) -> None:
        """A link that is down keeps its socket; that of an interface that is gone is put aside.

        To close it now would wait for the kernel until the interface is really gone.
        """
        if error.errno not in LINK_LOST:
            raise error
        if error.errno != errno.ENETDOWN and self._raw is not None:
            self._aside.append(self._raw)
            self._raw = None


def _content(record: bytes) -> bytes:
    """Without the flags, to which the kernel adds."""
    return record[:5] + record[6:]


def _decoded(record: bytes, stamp_ns: int) -> Frame:
    word, length, _ = HEADER.unpack_from(record)
    return Frame(
        stamp_ns=stamp_ns,
        can_id=word & (0x1FFFFFFF if word & (EXTENDED | ERROR) else 0x7FF),
        data=record[8 : 8 + length],
        is_extended=bool(word & EXTENDED),
        is_remote=bool(word & REMOTE),
        is_error=bool(word & ERROR),
        is_fd=len(record) == FD_BYTES,
    )


class _Clocks:
    """Turns wall-clock stamps to the monotonic clock."""

    def __init__(self) -> None:
        self._offset_ns = 0
        self._now_ns = 0

    def look(self) -> None:
        """Whether the wall clock went another way than the monotonic one: by more than can be told, it has stepped."""
        before_ns, wall_ns, self._now_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        offset_ns, doubt_ns = wall_ns - (before_ns + self._now_ns) // 2, self._now_ns - before_ns
        if abs(offset_ns - self._offset_ns) > doubt_ns + DRIFT_NS:
            self._offset_ns = offset_ns

    def stamps(self, ancillary: list[tuple[int, int, bytes]]) -> tuple[int, int]:
        """Monotonic, and the adapter's. A frame from before a step is as old as the look."""
        for _, kind, data in ancillary:
            if kind == SO_TIMESTAMPING and len(data) >= STAMPS.size:
                soft_s, soft_ns, _, _, hard_s, hard_ns = (int(number) for number in STAMPS.unpack_from(data))
                stamp_ns = soft_s * S + soft_ns - self._offset_ns
                is_sound = abs(self._now_ns - stamp_ns) < S
                return stamp_ns if is_sound else self._now_ns, hard_s * S + hard_ns
        return self._now_ns, 0


def encoded(frame: Frame) -> bytes:
    """The kernel's record of a frame, classical or FD."""
    word = frame.can_id
    word |= EXTENDED if frame.is_extended else 0
    word |= REMOTE if frame.is_remote else 0
    word |= ERROR if frame.is_error else 0
    room = FD_BYTES if frame.is_fd else CLASSIC_BYTES
    flags = BIT_RATE_SWITCH if frame.is_fd else 0
    return (HEADER.pack(word, len(frame.data), flags) + frame.data).ljust(room, b"\0")


def is_virtual(channel: str) -> bool:
    """Whether no wire is behind an interface. One that is not known for certain has one (slcan looks like none)."""
    if os.path.exists(f"/sys/class/net/{channel}/device"):
        return False
    try:
        said = subprocess.run(["ip", "-details", "link", "show", channel], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return False
    return said.returncode != 0 or re.search(r"^\s+v[x]?can\b", said.stdout, re.MULTILINE) is not None


def candump_line(frame: Frame, channel: str, wall_offset_ns: int) -> str:
    """As `candump -L` writes it."""
    seconds, rest_ns = divmod(frame.stamp_ns + wall_offset_ns, S)
    return f"({seconds:010d}.{rest_ns // 1000:06d}) {channel} {text(encoded(frame))}"
