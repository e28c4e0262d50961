"""The protection of one message (checksum, counter) as decoder and encoder use it, whatever its kind."""

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from vehicle_iface.value import Value

Payload = bytes | bytearray
NO_COUNTER = -1
"""What `Protection.read_counter` returns where the message has no counter."""


class PayloadBits(NamedTuple):
    """The bits of one signal, counted from the least significant one of the payload in the signal's byte order."""

    shift: int
    width: int
    is_big: bool


class PartKind(IntEnum):
    """What a checksum covers; the numbers are those of `_wire_codec.c`."""

    CONSTANT = 0
    PAYLOAD = 1
    TABLE = 2
    COUNTER = 3


class CoveredPart(NamedTuple):
    """One part of what a checksum covers."""

    kind: PartKind
    content: bytes
    """The constant, a mask for each byte of the payload, a byte for each counter, or as many as the counter has."""
    first: int = 0
    end: int = 0
    """The bytes first … end − 1 of the payload are left out."""


class Reduction(IntEnum):
    """How covered bytes become a checksum; the numbers are those of `_wire_codec.c`."""

    CRC = 0
    CRC_REFLECTED = 1
    SUM = 2
    XOR = 3


class ChecksumRecipe(NamedTuple):
    """A checksum as numbers; see `checksums`."""

    place: PayloadBits
    kind: Reduction
    width: int
    poly: int
    init: int
    xor_out: int
    cover: tuple[CoveredPart, ...]


class ProtectionRecipe(NamedTuple):
    """Counter and checksum as numbers, from which the C code computes what the functions of `Protection` do."""

    counter: PayloadBits | None
    checksum: ChecksumRecipe | None


class Protection(Value, frozen=True, kw_only=True):
    """A checksum, a counter, or both."""

    intact: Callable[[bytes], bool]
    """Checks whether a payload of full length carries the right checksum; always true without a checksum."""
    read_counter: Callable[[bytes], int]
    """Reads the counter of a payload, which may be invalid; `NO_COUNTER` if the message has none."""
    protect: Callable[[bytearray, int], None]
    """Writes the counter and then the checksum into a payload, in place."""
    counter_states: int
    """Number of valid counter values, which are 0 … counter_states − 1; 1 without a counter."""
    max_step: int
    """The largest accepted step of the counter; 0 without a counter."""
    recipe: ProtectionRecipe | None = None
    """The same for the C code; None for a kind that it does not have."""

    @property
    def has_counter(self) -> bool:
        return self.counter_states > 1

    def next_counter(self, counter: int) -> int:
        """Return the counter after `counter`."""
        return (counter + 1) % self.counter_states
