"""Notes on a vendor's DBC: what it leaves out or gets wrong about a signal or a message."""

import re
from typing import Annotated, Literal

import msgspec


def is_whole_number(text: str) -> bool:
    """Whether a key of `names` is a number on the bus."""
    return re.fullmatch(r"-?[0-9]{1,20}", text) is not None


class SignalNotes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a signal means: field = scale · (value in SI) + offset, in SI units of the field."""

    unit: str | None = None
    """The unit of the signal; left out, that of the DBC."""
    scale: float | None = None
    """Also turns one quantity into another: a wheel's rpm into m/s by its radius, a steering wheel into road wheels."""
    offset: float = 0.0
    range: tuple[float, float] | None = None
    """Smallest and greatest value in the DBC's unit; left out, those of the DBC."""
    names: dict[str, str] | None = None
    """Number = name, instead of the VAL_ table."""
    not_available: tuple[int, ...] = ()
    """Raw values by which the sender says that it has no value: the field is then missing."""


class J1939(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a J1939 message is recognised: by its PGN, whatever the priority."""

    source_address: Annotated[int, msgspec.Meta(ge=0, le=0xFF)] | None = None
    """Only from this address; left out, from any."""


class MessageNotes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the DBC leaves out or gets wrong about a message."""

    cycle_ms: Annotated[float, msgspec.Meta(gt=0.0)] | None = None
    sender: Literal["vehicle", "controller"] | None = None
    """Who sends it, where one placeholder name sends everything."""
    j1939: J1939 | None = None
