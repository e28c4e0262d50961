"""Writes every frame of a SocketCAN interface to the output as `candump -L` does, until SIGINT or SIGTERM.

`python tools/_recorder.py vcan0 > LOG.candump`, where can-utils is missing.
"""

import contextlib
import select
import signal
import socket
import struct
import sys
from collections.abc import Iterator

SO_TIMESTAMP = 29
ROOM_BYTES = 16 << 20
HEADER = struct.Struct("=IBB2x")
STAMP = struct.Struct("@qq")
FD_BYTES = 72
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
QUIET_S = 0.2


def main() -> None:
    over = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.append(True))
    channel = sys.argv[1]
    with opened(channel) as raw:
        while not over:
            select.select([raw], [], [], QUIET_S)
            for record, seconds, microseconds in received(raw):
                print(f"({seconds:010d}.{microseconds:06d}) {channel} {text(record)}")
            sys.stdout.flush()


def opened(channel: str) -> socket.socket:
    """A socket that hears everything and stamps it."""
    raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    raw.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMP, 1)
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM_BYTES)
    raw.setblocking(False)
    raw.bind((channel,))
    return raw


def received(raw: socket.socket) -> Iterator[tuple[bytes, int, int]]:
    """What has come: the kernel's record, and its stamp in seconds and microseconds."""
    with contextlib.suppress(BlockingIOError):
        while True:
            record, ((_, _, stamp), *_), _, _ = raw.recvmsg(FD_BYTES, 64)
            yield record, *STAMP.unpack(stamp)


def text(record: bytes) -> str:
    """The frame as candump writes it."""
    word, length, flags = HEADER.unpack_from(record)
    if word & ERROR:
        return f"{word:08X}#{record[8 : 8 + length].hex().upper()}"
    name = f"{word & 0x1FFFFFFF:08X}" if word & EXTENDED else f"{word & 0x7FF:03X}"
    if word & REMOTE:
        return f"{name}#R{length or ''}"
    mark = f"##{flags & 0xF:X}" if len(record) == FD_BYTES else "#"
    return f"{name}{mark}{record[8 : 8 + length].hex().upper()}"


if __name__ == "__main__":
    main()
