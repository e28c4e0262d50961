"""One SocketCAN interface: all frames with the kernel's time stamps, the bench's own included.

A frame that the bench sent is received when it was on the bus (`CAN_RAW_RECV_OWN_MSGS`), so both ends of a latency
have stamps of one clock. Hardware stamps of the adapter are kept, too. The kernel's stamps are converted to the
monotonic clock by one offset, which changes only when the wall clock steps, so that they keep their order.
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
from dataclasses import dataclass, replace

from vehicle_bus_contract.reference import Frame
from vehicle_bus_contract.socketcan import FD_BYTES, LINK_LOST, decode, encode

SO_TIMESTAMPING = 37
CAN_RAW_ERR_FILTER = 2
RX_HARDWARE, RX_SOFTWARE, SOFTWARE, RAW_HARDWARE = 1 << 2, 1 << 3, 1 << 4, 1 << 6
MSG_CONFIRM = 0x800
STAMPS = struct.Struct("@6q")
ROOM_BYTES = 16 << 20
S = 1_000_000_000
DRIFT_NS = 500_000
QUEUE_FULL = (errno.ENOBUFS, errno.EAGAIN)
IN_FLIGHT = 32
"""At most this many frames of a closed socket can still be in flight when it is reopened."""


@dataclass(frozen=True, slots=True)
class RxFrame:
    """A frame that was on the bus."""

    frame: Frame
    """Its stamp is monotonic."""
    is_ours: bool
    """The bench sent it."""
    hardware_ns: int
    """Of the adapter's own clock, with an arbitrary zero; 0 without hardware stamps."""


class Bus:
    """Raises `OSError` when the interface cannot be used; later it reopens when the interface returns."""

    def __init__(self, channel: str, identifiers: Iterable[int] | None, number: int = 0) -> None:
        """Receive these identifiers and error frames; None: everything. Those of 29 bits have bit 31 set.

        Received frames bear the bus' number.
        """
        self.channel, self._number = channel, number
        self._filters = None if identifiers is None else list(identifiers)
        self._raw: socket.socket | None = None
        self._aside: list[socket.socket] = []
        self.rejected = 0
        """Frames that the transmit queue had no room for."""
        self._sent: deque[bytes] = deque(maxlen=IN_FLIGHT)
        self._in_flight: set[bytes] = set()
        self._probed_ns = 0
        self._clocks = Clocks()
        self._open()

    def send(self, frame: Frame) -> bool:
        """True if the kernel accepted it. `drain` yields it when it was on the bus."""
        if not self._ensure_open():
            return False
        assert self._raw is not None
        record = encode(frame)
        try:
            self._raw.send(record)
        except OSError as error:
            if error.errno in QUEUE_FULL:
                self.rejected += 1
            else:
                self._handle_link_loss(error)
            return False
        self._sent.append(_content(record))
        return True

    def drain(self) -> Iterator[RxFrame]:
        """All frames received since the last call."""
        if not self._ensure_open():
            return
        self._clocks.update()
        while self._raw is not None:
            try:
                record, ancillary, flags, _ = self._raw.recvmsg(FD_BYTES, 128)
            except BlockingIOError:
                return
            except OSError as error:
                self._handle_link_loss(error)
                return
            stamp_ns, hardware_ns = self._clocks.stamps(ancillary)
            yield RxFrame(
                _decode(record, stamp_ns, self._number),
                bool(flags & MSG_CONFIRM) or self._was_sent_before_reopen(record),
                hardware_ns,
            )

    def packets(self) -> int:
        """Number of frames that the interface has sent, of all programs."""
        with open(f"/sys/class/net/{self.channel}/statistics/tx_packets", encoding="ascii") as counter:
            return int(counter.read())

    def close(self) -> None:
        """May be called twice."""
        for raw in (self._raw, *self._aside):
            if raw is not None:
                raw.close()
        self._raw, self._aside = None, []

    def reopen(self) -> None:
        """Reopen by name, after the interface was created again."""
        self.close()
        with contextlib.suppress(OSError):
            self._open()

    def _open(self) -> None:
        raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        try:
            if self._filters is not None:
                masks = b"".join(struct.pack("=II", *_filter(can_id)) for can_id in self._filters)
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
        self._in_flight = set(self._sent)

    def _was_sent_before_reopen(self, record: bytes) -> bool:
        """True if the previous socket sent it: the kernel confirms frames only to the sending socket."""
        content = _content(record)
        if content not in self._in_flight:
            return False
        self._in_flight.remove(content)
        return True

    def _ensure_open(self) -> bool:
        """Try to reopen a lost interface, ten times a second. True if it is open."""
        if self._raw is None and time.monotonic_ns() - self._probed_ns > S // 10:
            self._probed_ns = time.monotonic_ns()
            with contextlib.suppress(OSError):
                self._open()
        return self._raw is not None

    def _handle_link_loss(self, error: OSError) -> None:
        """Keep the socket of a link that is down; set aside that of a deleted interface.

        Closing it now would block until the kernel has removed the interface.
        """
        if error.errno not in LINK_LOST:
            raise error
        if error.errno != errno.ENETDOWN and self._raw is not None:
            self._aside.append(self._raw)
            self._raw = None


def _filter(can_id: int) -> tuple[int, int]:
    """Identifier and mask; of 29 bits neither the priority nor the sender counts, as in a J1939 group."""
    return (can_id, 0x83FFFF00) if can_id >> 31 else (can_id, 0x7FF)


def _content(record: bytes) -> bytes:
    """The record without its flags, which the kernel changes."""
    return record[:5] + record[6:]


def _decode(record: bytes, stamp_ns: int, number: int) -> Frame:
    """The frame of a record; a standard identifier has 11 bits even if damage has set more."""
    frame = decode(record, stamp_ns)
    if number:
        frame = replace(frame, bus=number)
    return frame if frame.is_extended or frame.is_error else replace(frame, can_id=frame.can_id & 0x7FF)


class Clocks:
    """Converts wall-clock stamps to the monotonic clock. The frames of one socket are in order, so their stamps are."""

    def __init__(self) -> None:
        self._offset_ns = 0
        self._now_ns = 0
        self._newest_ns = 0

    def update(self) -> None:
        """Take over a new offset if the wall clock has stepped: if the offset changed by more than its uncertainty."""
        before_ns, wall_ns, self._now_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        offset_ns, uncertainty_ns = wall_ns - (before_ns + self._now_ns) // 2, self._now_ns - before_ns
        if abs(offset_ns - self._offset_ns) > uncertainty_ns + DRIFT_NS:
            self._offset_ns = offset_ns

    def stamps(self, ancillary: list[tuple[int, int, bytes]]) -> tuple[int, int]:
        """Monotonic stamp, and the adapter's. A frame from before a step gets the time of the update.

        A wall clock that steps back by less than a second, as a virtual machine's does, does not step the stamps back.
        """
        stamp_ns, hardware_ns = self._read(ancillary)
        self._newest_ns = max(self._newest_ns, stamp_ns)
        return self._newest_ns, hardware_ns

    def _read(self, ancillary: list[tuple[int, int, bytes]]) -> tuple[int, int]:
        for _, kind, data in ancillary:
            if kind == SO_TIMESTAMPING and len(data) >= STAMPS.size:
                soft_s, soft_ns, _, _, hard_s, hard_ns = (int(number) for number in STAMPS.unpack_from(data))
                stamp_ns = soft_s * S + soft_ns - self._offset_ns
                is_sound = abs(self._now_ns - stamp_ns) < S
                return stamp_ns if is_sound else self._now_ns, hard_s * S + hard_ns
        return self._now_ns, 0


def is_virtual(channel: str) -> bool:
    """True for vcan and vxcan, and for an interface that does not exist. Anything else may have a wire (slcan)."""
    if os.path.exists(f"/sys/class/net/{channel}/device"):
        return False
    try:
        said = subprocess.run(["ip", "-details", "link", "show", channel], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return False
    return said.returncode != 0 or re.search(r"^\s+v[x]?can\b", said.stdout, re.MULTILINE) is not None
