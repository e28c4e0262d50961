"""Describes messages to the C code, which then packs their payloads (`_wire_codec.c`).

It has no multiplexers, no complements and no user's checksum functions. Those messages are packed in Python, and so is
every value that is not plainly right.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

from cantools.database.conversion import IdentityConversion

from vehicle_iface import wire
from vehicle_iface.codec.compiled import MessageCodec, Value
from vehicle_iface.codec.layout import Field
from vehicle_iface.codec.protection import PayloadBits, Protection, ProtectionRecipe

Pack = Callable[[Sequence[Value], int], bytes | None]
"""Packs values, in the order and units of the codec, with a counter; None where Python decides."""
EXACT_BITS = 53
"""A double holds every integer of so many bits."""
MAX_LENGTH, MAX_NUMBER = 64, 0xFFFFFFFF


class FieldRecipe(NamedTuple):
    """One signal as numbers, in the order in which the C code reads them."""

    place: PayloadBits
    is_signed: bool
    is_float: bool
    is_enumerated: bool
    is_scaled: bool
    scale: float
    offset: float
    lowest: float
    highest: float
    raw_lowest: int
    raw_highest: int
    named: tuple[int, ...] | None


def build_pack(codec: MessageCodec, protection: Protection | None) -> Pack | None:
    """Return the function that packs a message in C; None if Python packs it."""
    recipe = ProtectionRecipe(None, None) if protection is None else protection.recipe
    if not wire.uses_c() or recipe is None or not _is_plain(codec) or not _has_room(codec, recipe):
        return None
    from vehicle_iface import _wire

    fields = tuple(_describe_field(field) for field in codec.layout.fields)
    return _wire.Packer(codec.base, fields, recipe.counter, recipe.checksum).pack


def _is_plain(codec: MessageCodec) -> bool:
    """Whether the message is checked and not multiplexed, and no two signals share bits."""
    fields = codec.layout.fields
    if not codec.checked or codec.length > MAX_LENGTH or codec.layout.branches:
        return False
    if any(field.parent is not None or not _has_exact_numbers(field) for field in fields):
        return False
    used = sorted(bit for field in fields for bit in _bits(field, codec.length))
    return all(a != b for a, b in pairwise(used)) and not any(codec.base[bit // 8] >> bit % 8 & 1 for bit in used)


def _has_exact_numbers(field: Field) -> bool:
    if field.is_float:
        return field.width in (32, 64)
    return field.width <= EXACT_BITS and abs(field.scale) < 1 << EXACT_BITS and abs(field.offset) < 1 << EXACT_BITS


def _has_room(codec: MessageCodec, recipe: ProtectionRecipe) -> bool:
    checksum = recipe.checksum
    if checksum is None:
        return True
    numbers = (checksum.poly, checksum.init, checksum.xor_out)
    return (
        checksum.width <= 32
        and all(0 <= number <= MAX_NUMBER for number in numbers)
        and all(len(part.content) <= MAX_LENGTH for part in checksum.cover)
        and codec.length <= MAX_LENGTH
    )


def _bits(field: Field, length: int) -> range | list[int]:
    """Return the bits of a field in little-endian numbering."""
    bits = range(field.shift, field.end)
    return [8 * (length - 1 - bit // 8) + bit % 8 for bit in bits] if field.is_big else bits


def _describe_field(field: Field) -> FieldRecipe:
    low, high, named = field.raw_minimum, field.raw_maximum, None
    is_enumerated = bool(field.enumeration())
    if is_enumerated:
        low, high, named = field.allowed_raw()
    return FieldRecipe(
        PayloadBits(field.shift, field.width, field.is_big),
        field.is_signed,
        field.is_float,
        is_enumerated,
        field.kind is not IdentityConversion,
        float(field.scale),
        float(field.offset),
        field.lowest,
        field.highest,
        low if not field.is_float else 0,
        high if not field.is_float else 0,
        None if named is None else tuple(sorted(named)),
    )
