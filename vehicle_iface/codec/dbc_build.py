"""Builds cantools' messages from what was read and repaired, without its parser of DBC text."""

from collections import OrderedDict
from collections.abc import Mapping

from vehicle_iface.codec.cantools_classes import BaseConversion, DbcSpecifics, Message, NamedSignalValue, Signal
from vehicle_iface.codec.dbc_notes import DbcNotes
from vehicle_iface.codec.dbc_repair import EXTENDED, SoundMessage
from vehicle_iface.codec.dbc_source import SignalText, parse_number
from vehicle_iface.value import Value

_NOBODY = "Vector__XXX"
"""The name that editors write where there is no node."""
_FLOATS = (1, 2)
"""The numbers of SIG_VALTYPE_ for floats of 32 and 64 bits."""
_NO_ATTRIBUTES = DbcSpecifics()
"""The program reads attributes from `DbcNotes`; all signals share cantools' empty ones."""


class StatedE2E(Value, frozen=True, kw_only=True):
    """The attributes of AUTOSAR end-to-end protection that a DBC states for one message; None where it does not."""

    data_id: int | None
    profile: int | None


def build_message(message: SoundMessage, notes: DbcNotes) -> Message:
    """Build the message with its signals. Raises what cantools raises for a message that it cannot represent."""
    text, number = message.text, message.text.number
    senders = list(dict.fromkeys([text.sender or _NOBODY, *notes.senders.get(number, ())]))
    names = {signal.written: signal.name for signal in text.signals}
    return Message(
        frame_id=message.number & ~EXTENDED,
        is_extended_frame=bool(message.number & EXTENDED),
        is_fd=message.frame_format.endswith("CAN_FD"),
        protocol="j1939" if message.frame_format == "J1939PG" else None,
        name=text.name,
        length=text.length,
        senders=[] if senders == [_NOBODY] else senders,
        cycle_time=_find_cycle_ms(notes, number),  # type: ignore[arg-type]  # cantools has fractions, too
        comment=notes.comments.get((number, "")),
        signals=[_build_signal(message, signal, names, notes) for signal in text.signals],
        unused_bit_pattern=0xFF,
        strict=False,
    )


def find_e2e(notes: DbcNotes, number: int) -> StatedE2E | None:
    """Return what the attributes of a message state; None if there are none."""
    data_id, profile = (_find_number(notes, name, number) for name in ("E2EDataId", "E2EProfile"))
    if data_id is None and profile is None:
        return None
    return StatedE2E(
        data_id=None if data_id is None else int(data_id), profile=None if profile is None else int(profile)
    )


def _build_signal(message: SoundMessage, signal: SignalText, names: Mapping[str, str], notes: DbcNotes) -> Signal:
    number, written = message.text.number, signal.written
    condition, table = message.conditions.get(written), notes.value_names.get(number, written)
    return Signal(
        name=signal.name,
        start=signal.start,
        length=signal.length,
        byte_order="big_endian" if signal.is_big else "little_endian",
        is_signed=signal.is_signed,
        raw_initial=_find_number(notes, "GenSigStartValue", number, written),
        conversion=BaseConversion.factory(
            scale=signal.scale,
            offset=signal.offset,
            choices=OrderedDict((value, NamedSignalValue(value, name)) for value, name in table) if table else None,
            is_float=notes.value_types.get(number, written) in _FLOATS,
        ),
        minimum=signal.minimum if signal.has_range else None,
        maximum=signal.maximum if signal.has_range else None,
        unit=signal.unit or None,
        comment=notes.comments.get((number, written)),
        receivers=[] if signal.receivers == (_NOBODY,) else list(signal.receivers),
        is_multiplexer=signal.is_multiplexer,
        multiplexer_ids=list(condition.values) if condition else None,
        multiplexer_signal=names[condition.multiplexer] if condition else None,
        dbc_specifics=_NO_ATTRIBUTES,
    )


def _find_cycle_ms(notes: DbcNotes, number: int) -> float | None:
    """Return the period of a message in ms, or else the file's default; None for 0, which says that there is none."""
    own = _find_number(notes, "GenMsgCycleTime", number)
    default = notes.default("GenMsgCycleTime")
    return (parse_number(default) if own is None and default is not None else own) or None


def _find_number(notes: DbcNotes, attribute: str, number: int, signal: str = "") -> float | None:
    value = notes.attributes[attribute].get(number, signal)
    return None if value is None else parse_number(value)
