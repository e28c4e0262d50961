"""Keys of a profile for the protection of messages: `[e2e]`, and `[protection]` with its rules."""

from pathlib import Path
from typing import Annotated, Literal

import msgspec

Byte = Annotated[int, msgspec.Meta(ge=0, le=255)]
DataId = Annotated[int, msgspec.Meta(ge=0, le=0xFFFF)] | tuple[Byte, ...]
"""A number of 16 bits, or a byte for each value of the counter."""
DataIdMode = Literal["BOTH", "ALT", "LOW", "NIBBLE"]


class EndToEnd(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """AUTOSAR end-to-end protection of the messages in `data_ids`."""

    profile: Literal[1, 2, 5, 11]
    data_id_mode: DataIdMode = "BOTH"
    """Data id mode of profiles 1 and 11 (BOTH or NIBBLE); the others have only one."""
    crc_signal: str = "CRC"
    counter_signal: str = "COUNTER"
    max_counter_step: Annotated[int, msgspec.Meta(ge=1)] = 3
    """Maximum step of the counter; a greater step is a sequence error."""
    data_ids: dict[str, DataId]
    """The data id of each protected message; 16 bytes each in profile 2."""


class Checksum(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rule and signal of a checksum."""

    signal: str
    """Its name in the message."""
    kind: Literal["autosar-1", "autosar-2", "autosar-5", "autosar-11", "sum", "xor", "crc8", "crc16", "python"]
    over: Annotated[tuple[Literal["id", "length", "bytes", "data_id", "counter"], ...], msgspec.Meta(min_length=1)] = (
        "bytes",
    )
    """Covered data in this order (bytes: see `codec.checksums`). A data id that is not listed is last."""
    poly: Annotated[int, msgspec.Meta(ge=1, le=0xFFFF)] | None = None
    """Polynomial of a CRC without its highest power, most significant bit first, also where the CRC is reflected."""
    init: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Value before the first byte."""
    xor_out: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Exclusive or with the result."""
    reflect: bool = False
    """Whether a CRC takes each byte, and gives its result, least significant bit first."""
    table: Annotated[tuple[Byte, ...], msgspec.Meta(min_length=1)] | None = None
    """The data id of messages without one of their own: a byte for each value of the counter, or a single one."""
    data_id_mode: DataIdMode | None = None
    """Data id mode of autosar-1 and autosar-11; BOTH where it is left out."""
    function: str | None = None
    """FILE.py:NAME of kind python, relative to the profile: `checksum(can_id: int, data: bytes) -> int`."""


class FunctionPlace(msgspec.Struct, frozen=True, kw_only=True):
    """File and name of a user's checksum function."""

    file: Path
    name: str


def locate_function(function: str, folder: Path) -> FunctionPlace:
    """Split FILE.py:NAME, where FILE is relative to `folder`; nothing is checked."""
    file, _, name = function.rpartition(":")
    return FunctionPlace(file=folder / file, name=name)


class SequenceCounter(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A counter that steps by one from frame to frame."""

    signal: str
    """Its name in the message."""
    max_step: Annotated[int, msgspec.Meta(ge=1)] | None = None
    """Maximum step, a greater one is a sequence error; left out, 3 or as many as the counter's width allows."""


class ProtectionRule(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Protection shared by several messages: a checksum, a counter, or both."""

    checksum: Checksum | None = None
    counter: SequenceCounter | None = None


class ProtectedMessage(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The protection of one message."""

    use: str
    """Name of the rule."""
    data_id: DataId | None = None


class MessageProtection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rules by name, and the rule of each message."""

    rules: dict[str, ProtectionRule]
    """Rules by name; in the file `[protection.NAME]`, beside `messages`."""
    messages: dict[str, str | ProtectedMessage]


def gather_rules(document: dict[str, object]) -> None:
    """Put the rules of `[protection]` into a table `rules`, in place: the form that `MessageProtection` has."""
    table = document.get("protection")
    if isinstance(table, dict):
        rules = {name: rule for name, rule in table.items() if name != "messages"}
        document["protection"] = {"rules": rules} | {name: table[name] for name in ("messages",) if name in table}


def place_rule_in_file(fault: str) -> str:
    """Return the fault with its place as in the file."""
    return fault.replace("$.protection.rules", "$.protection", 1) if fault.startswith("$.protection.rules") else fault
