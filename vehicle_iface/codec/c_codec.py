"""Describes messages to the C code, which then packs and unpacks their payloads (`_wire_pack.c`, `_wire_unpack.c`).

It has no multiplexers, no complements and no user's checksum functions. Python packs and unpacks those messages, and
every value and frame that is not plainly right.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from itertools import pairwise
from typing import NamedTuple

from vehicle_iface import wire
from vehicle_iface.codec.cantools_classes import IdentityConversion, LinearIntegerConversion
from vehicle_iface.codec.compiled import MessageCodec, Value
from vehicle_iface.codec.database import BoundMessage, Conversion
from vehicle_iface.codec.layout import Field
from vehicle_iface.codec.protection import PayloadBits, Protection, ProtectionRecipe
from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.frame import CanFrame

Pack = Callable[[Sequence[Value], int], bytes | None]
"""Packs values, in the order and units of the codec, with a counter; None where Python decides."""
Unpack = Callable[[CanFrame, int], DecodedMessage | None]
"""Returns the message of a frame that has this counter; None where Python decides."""
EXACT_BITS = 53
"""A double holds every integer of so many bits."""
MAX_LENGTH, MAX_NUMBER = 64, 0xFFFFFFFF


class Scaling(IntEnum):
    """How a raw number becomes a value; the numbers are those of `_wire.h`."""

    IDENTITY = 0
    LINEAR = 1
    WHOLE = 2
    """Computed in integers."""


_SCALINGS = {IdentityConversion: Scaling.IDENTITY, LinearIntegerConversion: Scaling.WHOLE}


class FieldRecipe(NamedTuple):
    """One signal as numbers, in the order in which the C code reads them."""

    place: PayloadBits
    is_signed: bool
    is_float: bool
    is_enumerated: bool
    scaling: Scaling
    scale: float
    offset: float
    lowest: float
    highest: float
    raw_lowest: int
    raw_highest: int
    named: tuple[int, ...] | None


class InputRecipe(NamedTuple):
    """One received signal as numbers, in the order in which the C code reads them."""

    field: FieldRecipe
    raws: tuple[int, ...] | None
    """The raw numbers of an enumeration that the decoder translates, …"""
    numbers: tuple[int, ...] | None
    """… and to what."""
    missing: tuple[int, ...] | None
    is_converted: bool
    unit_scale: float
    unit_offset: float


def build_pack(codec: MessageCodec, protection: Protection | None) -> Pack | None:
    """Return the function that packs a message in C; None if Python packs it."""
    recipe = ProtectionRecipe(None, None) if protection is None else protection.recipe
    if not wire.uses_c() or recipe is None or not _is_plain(codec) or not _has_room(codec, recipe):
        return None
    from vehicle_iface import _wire

    fields = tuple(_describe_field(field) for field in codec.layout.fields)
    return _wire.Packer(codec.base, fields, recipe.counter, recipe.checksum).pack


def build_unpack(message: BoundMessage) -> Unpack | None:
    """Return the function that checks and unpacks a frame in C; None if Python does."""
    codec, protection = message.codec, message.protection
    recipe = ProtectionRecipe(None, None) if protection is None else protection.recipe
    if not wire.uses_c() or recipe is None or not _is_exact(codec) or not _has_room(codec, recipe):
        return None
    if not all(map(_is_plain_input, codec.layout.fields, message.from_wire)):
        return None
    from vehicle_iface import _wire

    inputs = tuple(map(_describe_input, codec.layout.fields, message.from_wire, message.conversions))
    unpacker = _wire.Unpacker(
        DecodedMessage, message.name, message.length, message.is_fd, inputs, recipe.counter, recipe.checksum
    )
    return unpacker.unpack


def _is_exact(codec: MessageCodec) -> bool:
    """Whether the message is checked and not multiplexed, and a double holds every number of it."""
    layout = codec.layout
    return (
        codec.checked
        and codec.length <= MAX_LENGTH
        and not layout.branches
        and all(field.parent is None and _has_exact_numbers(field) for field in layout.fields)
    )


def _is_plain(codec: MessageCodec) -> bool:
    """Whether the message is exact, and no two signals share bits."""
    if not _is_exact(codec):
        return False
    used = sorted(bit for field in codec.layout.fields for bit in _bits(field, codec.length))
    return all(a != b for a, b in pairwise(used)) and not any(codec.base[bit // 8] >> bit % 8 & 1 for bit in used)


def _is_plain_input(field: Field, from_wire: Mapping[int, int] | None) -> bool:
    """Whether only raw integers are missing or translated."""
    if from_wire is not None and field.kind is not IdentityConversion:
        return False
    return not field.is_float or (from_wire is None and not field.missing)


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


def _describe_field(field: Field, *, is_received: bool = False) -> FieldRecipe:
    low, high, named = field.raw_minimum, field.raw_maximum, None
    is_enumerated = bool(field.enumeration())
    if not field.is_float and (is_enumerated or is_received):
        low, high, named = field.allowed_raw()
    return FieldRecipe(
        PayloadBits(field.shift, field.width, field.is_big),
        field.is_signed,
        field.is_float,
        is_enumerated,
        _SCALINGS.get(field.kind, Scaling.LINEAR),
        float(field.scale),
        float(field.offset),
        field.lowest,
        field.highest,
        low if not field.is_float else 0,
        high if not field.is_float else 0,
        None if named is None else tuple(sorted(named)),
    )


def _describe_input(field: Field, from_wire: Mapping[int, int] | None, conversion: Conversion | None) -> InputRecipe:
    table, unit = from_wire or {}, conversion or Conversion(1.0, 0.0)
    return InputRecipe(
        _describe_field(field, is_received=True),
        tuple(table) if from_wire is not None else None,
        tuple(table.values()) if from_wire is not None else None,
        tuple(field.missing),
        conversion is not None and from_wire is None,
        float(unit.scale),
        float(unit.offset),
    )
