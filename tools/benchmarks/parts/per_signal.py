"""A generic codec in the manner of opendbc's CANParser and CANPacker: tables in a loop, nothing generated.

Each signal is a row (first and last bit, scaling, byte order, sign); a payload is taken apart byte by byte into a
dictionary, and put together the same way. Integers and scaling only: no multiplexers, no floats, no ranges.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cantools.database import Message, Signal


@dataclass(slots=True)
class Row:
    """One signal, in numbers."""

    name: str
    lsb: int
    """Bit 0 is the lowest of byte 0, bit 8 the lowest of byte 1."""
    msb: int
    size: int
    is_signed: bool
    factor: float
    offset: float
    is_little_endian: bool


class PerSignalCodec:
    """One message."""

    def __init__(self, message: Message) -> None:
        self.length = message.length
        self.rows: Sequence[Row] = [_row(signal) for signal in message.signals]
        self.by_name = {row.name: row for row in self.rows}

    def decode(self, data: bytes) -> dict[str, float]:
        values = {}
        for row in self.rows:
            raw = _taken_out(data, row)
            if row.is_signed and raw >> (row.size - 1) & 1:
                raw -= 1 << row.size
            values[row.name] = raw * row.factor + row.offset
        return values

    def encode(self, values: Mapping[str, float]) -> bytes:
        data = bytearray(self.length)
        for name, value in values.items():
            row = self.by_name[name]
            raw = round((value - row.offset) / row.factor)
            if raw < 0:
                raw += 1 << row.size
            _put_in(data, row, raw)
        return bytes(data)


def _row(signal: Signal) -> Row:
    is_little_endian = signal.byte_order == "little_endian"
    lsb = msb = signal.start
    for _ in range(signal.length - 1):
        if is_little_endian:
            msb += 1
        else:
            lsb = lsb - 1 if lsb % 8 else lsb + 15
    return Row(signal.name, lsb, msb, signal.length, signal.is_signed, signal.scale, signal.offset, is_little_endian)


def _taken_out(data: bytes, row: Row) -> int:
    """From the byte with the highest bits to the one with the lowest."""
    raw, left = 0, row.size
    place, step = row.msb // 8, -1 if row.is_little_endian else 1
    while left > 0:
        low = row.lsb % 8 if place == row.lsb // 8 else 0
        high = row.msb % 8 if place == row.msb // 8 else 7
        width = high - low + 1
        left -= width
        raw |= (data[place] >> low & (1 << width) - 1) << left
        place += step
    return raw


def _put_in(data: bytearray, row: Row, raw: int) -> None:
    """From the byte with the lowest bits to the one with the highest."""
    left = row.size
    place, step = row.lsb // 8, 1 if row.is_little_endian else -1
    while left > 0:
        low = row.lsb % 8 if place == row.lsb // 8 else 0
        width = min(left, 8 - low)
        data[place] |= (raw & (1 << width) - 1) << low
        raw >>= width
        left -= width
        place += step
