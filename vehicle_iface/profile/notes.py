"""Notes on a vendor's DBC: what it leaves out or gets wrong about a signal or a message."""

import re
from typing import Annotated, Literal

import msgspec


def is_whole_number(text: str) -> bool:
    """Return whether a key of `names` is a number on the bus."""
    return re.fullmatch(r"-?[0-9]{1,20}", text) is not None


class SignalNotes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Meaning of a signal: field = scale · (value in SI) + offset, in SI units of the field."""

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
    """Raw values that mean "not available": the field is then missing."""


class J1939(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Identification of a J1939 message by its PGN, regardless of priority."""

    source_address: Annotated[int, msgspec.Meta(ge=0, le=0xFF)] | None = None
    """Accepted source address; left out, any."""


class MessageNotes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Notes on what the DBC leaves out or states wrongly about a message."""

    cycle_ms: Annotated[float, msgspec.Meta(gt=0.0)] | None = None
    sender: Literal["vehicle", "controller"] | None = None
    """Sending node, where the DBC has one placeholder for all nodes."""
    j1939: J1939 | None = None
