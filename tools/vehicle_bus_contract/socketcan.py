"""Frames on a SocketCAN interface: a raw socket with the kernel's stamps, and the kernel's own frame format."""

import errno
import socket
import struct
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from vehicle_bus_contract.reference import Frame, S

CLASSIC_BYTES, FD_BYTES = 16, 72
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
SO_TIMESTAMPNS, SO_RXQ_OVFL, SO_RCVBUFFORCE = 35, 40, 33  # <asm-generic/socket.h>
LINK_LOST = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO)
BUFFER_BYTES = 64 << 20
_HEADER = struct.Struct("=IBB2x")
_STAMP = struct.Struct("@qq")
_COUNT = struct.Struct("@I")
_BIT_RATE_SWITCH = 1


class ReceivedFrame(NamedTuple):
    """One frame at one socket."""

    frame: Frame
    """Its stamp is the kernel's, in ns of the wall clock."""
    is_own: bool
    """A program on this end of the wire has sent it."""
    dropped: int = 0
    """Frames that this socket had no room for so far."""


def open_socket(channel: str, can_ids: Iterable[int] | None = None) -> socket.socket:
    """A socket that never waits, for these 11-bit identifiers or, with None, for every frame."""
    raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    if can_ids is not None:
        filters = b"".join(struct.pack("=II", can_id, 0x7FF) for can_id in can_ids)
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
    raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    for option in (SO_TIMESTAMPNS, SO_RXQ_OVFL):
        raw.setsockopt(socket.SOL_SOCKET, option, 1)
    try:
        raw.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, BUFFER_BYTES)
    except PermissionError:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    raw.setblocking(False)
    raw.bind((channel,))
    return raw


def receive(raw: socket.socket) -> Iterator[ReceivedFrame]:
    """All that has arrived; passes over a link that went down. Raises `OSError` for other faults."""
    while True:
        try:
            record, ancillary, flags, _ = raw.recvmsg(FD_BYTES, 64)
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno not in LINK_LOST:
                raise
            continue  # the kernel reports it once
        stamp_ns = dropped = 0
        for _, kind, content in ancillary:
            if kind == SO_TIMESTAMPNS:
                seconds, nanoseconds = _STAMP.unpack(content)
                stamp_ns = seconds * S + nanoseconds
            elif kind == SO_RXQ_OVFL:
                (dropped,) = _COUNT.unpack(content)
        yield ReceivedFrame(decode(record, stamp_ns), bool(flags & socket.MSG_DONTROUTE), dropped)


def receive_frames(raw: socket.socket) -> list[Frame]:
    """All that has arrived, the frames alone."""
    return [received.frame for received in receive(raw)]


def send(raw: socket.socket, frame: Frame) -> bool:
    """Whether the frame was taken."""
    try:
        raw.send(encode(frame))
    except OSError:
        return False
    return True


def encode(frame: Frame) -> bytes:
    """The kernel's record of a frame, classical or FD."""
    word = frame.can_id
    word |= EXTENDED if frame.is_extended else 0
    word |= REMOTE if frame.is_remote else 0
    word |= ERROR if frame.is_error else 0
    size, flags = (FD_BYTES, _BIT_RATE_SWITCH) if frame.is_fd else (CLASSIC_BYTES, 0)
    return (_HEADER.pack(word, len(frame.data), flags) + frame.data).ljust(size, b"\0")


def decode(record: bytes, stamp_ns: int) -> Frame:
    """The frame in a kernel's record. Damage may leave bits above the eleven of a standard identifier; they stay."""
    word, length, _ = _HEADER.unpack_from(record)
    return Frame(
        stamp_ns=stamp_ns,
        can_id=word & 0x1FFFFFFF,
        data=record[8 : 8 + length],
        is_extended=bool(word & EXTENDED),
        is_remote=bool(word & REMOTE),
        is_fd=len(record) == FD_BYTES,
        is_error=bool(word & ERROR),
    )
