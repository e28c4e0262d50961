"""Logs of `candump -L`, read and written."""

from collections.abc import Iterator
from pathlib import Path

from vehicle_bus_contract.reference import Frame, S
from vehicle_bus_contract.socketcan import ERROR


def read_candump(path: Path) -> Iterator[Frame]:
    """The frames of a `candump -L` log; `ValueError` naming the line that is none."""
    with path.open(encoding="ascii", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            if line.strip():
                try:
                    yield _frame(line)
                except (ValueError, IndexError):
                    raise ValueError(f"line {number}: {line.strip()[:60]!r} is no line of candump -L") from None


def candump_line(frame: Frame, channel: str, offset_ns: int = 0) -> str:
    """The frame as `candump -L` writes it, without the end of the line; the offset is added to its stamp."""
    seconds, rest_ns = divmod(frame.stamp_ns + offset_ns, S)
    return f"({seconds:010d}.{rest_ns // 1000:06d}) {channel} {_text(frame)}"


def _frame(line: str) -> Frame:
    """`(1700000000.123456) vcan0 080#1122334455667788`, `#R` for a remote frame, `##F…` for FD with its flags."""
    words = line.split()
    seconds, _, fraction = words[0].strip("()").partition(".")
    word, _, payload = words[2].partition("#")
    is_fd, is_remote = payload.startswith("#"), payload.startswith("R")
    number = int(word, 16)
    return Frame(
        stamp_ns=int(seconds) * S + int(fraction.ljust(9, "0")[:9]),
        can_id=number & 0x1FFFFFFF,
        data=b"" if is_remote else bytes.fromhex(payload[2:] if is_fd else payload),
        is_extended=len(word) == 8,
        is_remote=is_remote,
        is_fd=is_fd,
        is_error=len(word) == 8 and bool(number & ERROR),
    )


def _text(frame: Frame) -> str:
    payload = frame.data.hex().upper()
    if frame.is_error:
        return f"{frame.can_id | ERROR:08X}#{payload}"
    name = f"{frame.can_id:08X}" if frame.is_extended else f"{frame.can_id & 0x7FF:03X}"
    if frame.is_remote:
        return f"{name}#R{len(frame.data) or ''}"
    return f"{name}##1{payload}" if frame.is_fd else f"{name}#{payload}"
