"""Length of a frame on the wire in bits, stuff bits included (ISO 11898-1; Bosch CAN 2.0 and CAN FD 1.0)."""

from functools import cache
from typing import NamedTuple

from vehicle_iface.frame import CanFrame

_CRC15 = 0x4599
_CRC15_BITS = 15
_TAIL_BITS = 13
"""Unstuffed bits of a classical frame: CRC delimiter, acknowledgement (2), end of frame (7), intermission (3)."""
_FD_TAIL_BITS = 12
"""Last bits of an FD frame, at the nominal rate: acknowledgement, end of frame, intermission."""
_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Data length in bytes by data length code."""
_ROW = 5
"""After this many equal bits a stuff bit of the opposite value is inserted."""


class WireBits(NamedTuple):
    """Length of one frame in bit times."""

    nominal: int
    """Bits at the arbitration phase's bit rate."""
    fast: int
    """Bits at the data phase's bit rate; 0 for classical frames."""


def wire_bits(frame: CanFrame) -> WireBits:
    """Return the length of a data or remote frame from its start to the end of the intermission."""
    return _measure_fd(frame) if frame.is_fd else _classical_bits(frame)


def _classical_bits(frame: CanFrame) -> WireBits:
    length = len(frame.data)
    if frame.is_extended:
        # start 0, 11 bits, SRR 1, IDE 1, 18 bits, RTR, r1 0, r0 0, length
        high, low = frame.can_id >> 18, frame.can_id & 0x3FFFF
        head = ((high << 2 | 0b11) << 18 | low) << 7 | frame.is_remote << 6 | min(length, 8)
        count = 39
    else:  # start 0, 11 bits, RTR, IDE 0, r0 0, length
        head = frame.can_id << 7 | frame.is_remote << 6 | min(length, 8)
        count = 19
    data = b"" if frame.is_remote else frame.data
    bits, count = head << 8 * len(data) | int.from_bytes(data, "big"), count + 8 * len(data)
    bits = bits << _CRC15_BITS | _compute_crc15(bits, count)
    count += _CRC15_BITS
    return WireBits(count + _count_stuff_bits(bits, count) + _TAIL_BITS, 0)


def _measure_fd(frame: CanFrame) -> WireBits:
    """Return the length of an FD frame: identifier part at the nominal rate, data from the bit-rate switch on."""
    length = len(frame.data)
    code = next(code for code, room in enumerate(_FD_LENGTHS) if room >= length)
    if frame.is_extended:  # start, 11 bits, SRR, IDE, 18 bits, RRS, FDF 1, res 0, BRS 1
        high, low = frame.can_id >> 18, frame.can_id & 0x3FFFF
        head, count = ((high << 2 | 0b11) << 18 | low) << 4 | 0b0101, 36
    else:  # start, 11 bits, RRS 0, IDE 0, FDF 1, res 0, BRS 1
        head, count = frame.can_id << 5 | 0b00101, 17
    nominal = count + _count_stuff_bits(head, count)
    payload = frame.data.ljust(_FD_LENGTHS[code], b"\0")
    body = (head << 5 | code) << 8 * len(payload) | int.from_bytes(payload, "big")
    dynamic = count + 5 + 8 * len(payload)
    fast = dynamic + _count_stuff_bits(body, dynamic) - nominal
    # Stuff count (4) and checksum, with a fixed stuff bit before each four of them; then the delimiter.
    check = 4 + (17 if len(payload) <= 16 else 21)
    return WireBits(nominal + _FD_TAIL_BITS, fast + check + -(-check // 4) + 1)


def _compute_crc15(bits: int, count: int) -> int:
    """Compute the CRC of a classical frame; leading zeros do not change it."""
    crc, table = 0, _crc_table()
    for byte in bits.to_bytes(-(-count // 8), "big"):
        crc = (crc << 8 & 0x7FFF) ^ table[crc >> 7 ^ byte]
    return crc


def _count_stuff_bits(bits: int, count: int) -> int:
    """Count the stuff bits of a bit sequence."""
    whole, rest = divmod(count, 8)
    state, added, table = _START, 0, _stuffing_table()
    for place in range(count - 1, count - 1 - rest, -1):
        more, state = _advance(state, bits >> place & 1)
        added += more
    for byte in (bits & (1 << 8 * whole) - 1).to_bytes(whole, "big"):
        more, state = table[state][byte]
        added += more
    return added


_START = 2 * _ROW
"""State before the first bit. Other states: 2 × number of equal bits that came last (1 to 4) + their value."""


def _advance(state: int, bit: int) -> tuple[int, int]:
    """Process one bit: return the number of stuff bits after it, and the new state."""
    row = state // 2 + 1 if state != _START and state % 2 == bit else 1
    if row < _ROW:
        return 0, 2 * row + bit
    return 1, 2 + (1 - bit)


def _advance_byte(state: int, byte: int) -> tuple[int, int]:
    added = 0
    for place in range(7, -1, -1):
        more, state = _advance(state, byte >> place & 1)
        added += more
    return added, state


def _crc_entry(byte: int) -> int:
    crc = byte << 7
    for _ in range(8):
        crc = crc << 1 ^ (_CRC15 if crc & 0x4000 else 0)
    return crc & 0x7FFF


# Made when the first frame is looked at, and not by everybody who only imports this.
@cache
def _stuffing_table() -> list[list[tuple[int, int]]]:
    return [[_advance_byte(state, byte) for byte in range(256)] for state in range(_START + 1)]


@cache
def _crc_table() -> list[int]:
    return [_crc_entry(byte) for byte in range(256)]
