"""Builds checksums from parts: selects the covered bytes, then computes a sum, exclusive or, or CRC of them.

The key `over` of a profile names the covered parts in their order:

* `id`: the identifier, low byte first; 2 bytes, or 4 for an extended one.
* `length`: the payload's length in bytes, 1 byte.
* `bytes`: the payload without the checksum's own bits. A byte that contains only checksum bits is omitted; in a byte
  that the checksum shares, its bits are 0.
* `data_id`: a number as 2 bytes, low byte first; for a list, the byte at the index given by the counter.
* `counter`: the counter in as few bytes as hold it, low byte first.

A checksum of at most 4 bits is computed over nibbles, a wider one over bytes. A sum is taken modulo 2^width.
"""

import operator
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Literal

from vehicle_iface.codec.layout import Field
from vehicle_iface.codec.protection import CoveredPart, PartKind, Payload, PayloadBits
from vehicle_iface.value import Value

_NIBBLE = 4
_NIBBLE_SUMS = bytes((byte >> 4) + (byte & 0x0F) for byte in range(256))
_NIBBLE_XORS = bytes(byte >> 4 ^ byte & 0x0F for byte in range(256))
_Part = Callable[[Payload], Payload]


class BitPlace(Value, frozen=True):
    """The bits of one signal in the payload, read as one integer of the signal's byte order."""

    shift: int
    width: int
    order: Literal["little", "big"]

    @classmethod
    def of(cls, field: Field) -> "BitPlace":
        return cls(field.shift, field.width, "big" if field.is_big else "little")

    @property
    def bits(self) -> PayloadBits:
        """The same as numbers."""
        return PayloadBits(self.shift, self.width, self.order == "big")

    @property
    def mask(self) -> int:
        """The largest number that the bits can hold."""
        return (1 << self.width) - 1

    def read(self, data: Payload) -> int:
        return int.from_bytes(data, self.order) >> self.shift & self.mask

    def clear(self, data: Payload) -> bytes:
        """Return the payload with these bits set to 0."""
        return (int.from_bytes(data, self.order) & ~(self.mask << self.shift)).to_bytes(len(data), self.order)

    def write(self, data: bytearray, number: int) -> None:
        bits = int.from_bytes(data, self.order) & ~(self.mask << self.shift) | number << self.shift
        data[:] = bits.to_bytes(len(data), self.order)


class CoveredMessage(Value, frozen=True, kw_only=True):
    """The parts of a message that a checksum may cover."""

    can_id: int
    is_extended: bool
    length: int
    """Length of the payload in bytes."""
    checksum: BitPlace
    counter: BitPlace | None
    data_id: int | tuple[int, ...] | None
    """A number of 2 bytes, or a list with one byte, or one byte for each value of the counter."""


def build_cover(over: Sequence[str], message: CoveredMessage) -> Callable[[Payload], Payload]:
    """Build the function that extracts the covered bytes from a payload whose counter is already written."""
    parts = [_PARTS[name](message) for name in over]
    return parts[0] if len(parts) == 1 else lambda data: b"".join([part(data) for part in parts])


def _cover_constant(value: bytes) -> _Part:
    return lambda _data: value


def _cover_id(message: CoveredMessage) -> _Part:
    return _cover_constant(message.can_id.to_bytes(4 if message.is_extended else 2, "little"))


def _cover_length(message: CoveredMessage) -> _Part:
    return _cover_constant(bytes([message.length]))


def _own_bytes(message: CoveredMessage) -> tuple[bytes, int, int]:
    """Return the checksum's bits in each byte, and the range of the bytes that contain only those."""
    place = message.checksum
    own = (place.mask << place.shift).to_bytes(message.length, place.order)
    whole = [index for index, bits in enumerate(own) if bits == 0xFF]
    return (own, whole[0], whole[-1] + 1) if whole else (own, 0, 0)


def _cover_bytes(message: CoveredMessage) -> _Part:
    own, first, end = _own_bytes(message)
    shared = [(index, 0xFF ^ bits) for index, bits in enumerate(own) if 0 < bits < 0xFF]

    def cover(data: Payload) -> Payload:
        covered = bytearray(data)
        for index, others in shared:
            covered[index] &= others
        del covered[first:end]
        return covered

    return cover


def _cover_data_id(message: CoveredMessage) -> _Part:
    data_id, counter = message.data_id, message.counter
    if data_id is None or isinstance(data_id, int):
        return _cover_constant((data_id or 0).to_bytes(2, "little"))
    if counter is None or len(data_id) == 1:
        return _cover_constant(bytes(data_id[:1]))
    rows, read = [bytes([byte]) for byte in data_id], counter.read
    return lambda data: rows[read(data) % len(rows)]


def _cover_counter(message: CoveredMessage) -> _Part:
    counter = message.counter
    if counter is None:
        return _cover_constant(b"")
    read, size = counter.read, -(-counter.width // 8)
    return lambda data: read(data).to_bytes(size, "little")


_PARTS: dict[str, Callable[[CoveredMessage], _Part]] = {
    "id": _cover_id,
    "length": _cover_length,
    "bytes": _cover_bytes,
    "data_id": _cover_data_id,
    "counter": _cover_counter,
}


def describe_cover(over: Sequence[str], message: CoveredMessage) -> tuple[CoveredPart, ...]:
    """Return the same parts as `build_cover`, as numbers."""
    return tuple(_describe_part(name, message) for name in over)


def _describe_part(name: str, message: CoveredMessage) -> CoveredPart:
    counter, data_id = message.counter, message.data_id
    if name == "bytes":
        own, first, end = _own_bytes(message)
        return CoveredPart(PartKind.PAYLOAD, bytes(0xFF ^ bits for bits in own), first, end)
    if name == "data_id" and isinstance(data_id, tuple) and len(data_id) > 1 and counter is not None:
        return CoveredPart(PartKind.TABLE, bytes(data_id))
    if name == "counter" and counter is not None:
        return CoveredPart(PartKind.COUNTER, bytes(-(-counter.width // 8)))
    return CoveredPart(PartKind.CONSTANT, bytes(_PARTS[name](message)(b"")))


def sum_function(width: int, init: int = 0, xor_out: int = 0) -> Callable[[Payload], int]:
    """Build a function that sums bytes, or nibbles for widths up to 4 bits, modulo 2^width."""
    mask = (1 << width) - 1
    if width <= _NIBBLE:
        return lambda covered: (init + sum(covered.translate(_NIBBLE_SUMS)) & mask) ^ xor_out
    return lambda covered: (init + sum(covered) & mask) ^ xor_out


def xor_function(width: int, init: int = 0, xor_out: int = 0) -> Callable[[Payload], int]:
    """Build a function that computes the exclusive or of bytes, or of nibbles for widths up to 4 bits."""
    mask, last = (1 << width) - 1, init ^ xor_out
    if width <= _NIBBLE:
        return lambda covered: reduce(operator.xor, covered.translate(_NIBBLE_XORS), last) & mask
    return lambda covered: reduce(operator.xor, covered, last) & mask


def crc_function(
    bits: int, poly: int, init: int = 0, xor_out: int = 0, *, reflect: bool = False
) -> Callable[[Payload], int]:
    """Build a function that computes the CRC of bytes.

    `poly`, `init` and `xor_out` are written most significant bit first, as in catalogues of CRCs.
    """
    if reflect:
        return _reflected_crc(bits, poly, init, xor_out)
    mask, shift, top = (1 << bits) - 1, bits - 8, 1 << bits - 1
    table = []
    for register in (byte << shift for byte in range(256)):
        for _ in range(8):
            register = (register << 1 ^ (poly if register & top else 0)) & mask
        table.append(register)

    def crc(covered: Payload) -> int:
        register = init
        for byte in covered:
            register = table[register >> shift ^ byte] ^ register << 8 & mask
        return register ^ xor_out

    return crc


def _reflected_crc(bits: int, poly: int, init: int, xor_out: int) -> Callable[[Payload], int]:
    poly, first = _reverse_bits(poly, bits), _reverse_bits(init, bits)
    table = []
    for register in range(256):
        for _ in range(8):
            register = register >> 1 ^ (poly if register & 1 else 0)
        table.append(register)

    def crc(covered: Payload) -> int:
        register = first
        for byte in covered:
            register = table[(register ^ byte) & 0xFF] ^ register >> 8
        return register ^ xor_out

    return crc


def _reverse_bits(number: int, bits: int) -> int:
    return int(f"{number:0{bits}b}"[::-1], 2)
