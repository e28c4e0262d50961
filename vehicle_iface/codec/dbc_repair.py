"""Repairs the messages of a DBC: reads oddities as they were meant, removes unusable signals and messages, reports
both."""

from collections.abc import Iterable, Iterator, Mapping

import msgspec

from vehicle_iface.codec.dbc_findings import DbcFindings
from vehicle_iface.codec.dbc_notes import DbcNotes
from vehicle_iface.codec.dbc_source import MessageText, SignalText
from vehicle_iface.value import Value

EXTENDED = 1 << 31
"""The bit that marks extended identifiers in a DBC."""
_GREATEST_STANDARD, _GREATEST_EXTENDED = 0x7FF, 0x1FFFFFFF
_FD_LENGTHS = (12, 16, 20, 24, 32, 48, 64)
"""Valid lengths of frames with more than 8 bytes."""
_MOST_MULTIPLEXER_VALUES = 4096
"""Largest number of multiplexer values for one signal, unless it is present for all of them."""
_FLOAT_WIDTHS = (16, 32, 64)
_TWICE = "names that are there twice"


class Condition(Value, frozen=True):
    """The values of a multiplexer for which a signal is present."""

    multiplexer: str
    """The multiplexer's name as written in the file."""
    values: tuple[int, ...]


class SoundMessage(Value, frozen=True, kw_only=True):
    """A usable message with its usable signals."""

    text: MessageText
    number: int
    """The identifier, with the `EXTENDED` bit for an extended one."""
    frame_format: str
    """The name for VFrameFormat; empty for a classical frame."""
    conditions: Mapping[str, Condition] = msgspec.field(default_factory=dict)
    """Maps the written name of each multiplexed signal to its condition."""


def repair_messages(messages: Iterable[MessageText], notes: DbcNotes, findings: DbcFindings) -> Iterator[SoundMessage]:
    """Yield the usable messages; report repairs and removals in `findings`."""
    by_name: dict[str, MessageText] = {}
    by_number: dict[int, MessageText] = {}
    for message in messages:
        _remove_unsound_signals(message, notes, findings)
        conditions = _resolve_multiplexing(message, notes, findings)
        frame_format = _choose_frame_format(message, notes, findings)
        first = by_name.setdefault(message.name, message)
        if first is not message:
            findings.add_error(message.line, message.name, f"is already in line {first.line}", _TWICE)
            continue
        number = _repair_number(message, findings)
        if number is None:
            continue
        first = by_number.setdefault(number, message)
        if first is not message:
            text = f"id {message.number} is already in line {first.line}, of {first.name}"
            findings.add_error(message.line, (message.name, first.name), text, "ids that are there twice")
            continue
        yield SoundMessage(text=message, number=number, frame_format=frame_format, conditions=conditions)


def _repair_number(message: MessageText, findings: DbcFindings) -> int | None:
    """Return the identifier with its flag; None if it is not a valid identifier."""
    can_id, is_flagged = message.number & ~EXTENDED, bool(message.number & EXTENDED)
    if message.number >> 32 or can_id > _GREATEST_EXTENDED:
        text = f"id {message.number}: must be at most {_GREATEST_EXTENDED:#x}, plus 2^31 for an extended one"
        findings.add_error(message.line, message.name, text, "ids of more than 29 bits")
        return None
    if can_id > _GREATEST_STANDARD and not is_flagged:
        text = f"id {can_id:#x} is above 0x7ff and lacks the flag of extended ones (2^31); it is taken as extended"
        findings.add_warning(message.line, message.name, text, "ids above 0x7ff without the flag of extended ones")
        return can_id | EXTENDED
    return message.number


def _choose_frame_format(message: MessageText, notes: DbcNotes, findings: DbcFindings) -> str:
    """Return the frame format that the file states; FD for a message that is too long for a classical frame."""
    stated, length = notes.frame_format(message.number), message.length
    if length <= 8:
        return "StandardCAN_FD" if stated.endswith("_FD") else stated if stated == "J1939PG" else ""
    if stated == "J1939PG":
        text = f"{length} bytes are more than one frame; transport protocols are not supported"
        findings.add_error(message.line, message.name, text, "messages of several frames")
        return stated
    if length not in _FD_LENGTHS:
        allowed = ", ".join(map(str, _FD_LENGTHS))
        text = f"{length} bytes: no frame has this length; must be 0 to 8, {allowed}"
        findings.add_error(message.line, message.name, text, "lengths that no frame has")
    elif not stated.endswith("_FD"):
        text = f"{length} bytes, but no VFrameFormat marks it as CAN FD; it is taken as an FD frame"
        findings.add_warning(message.line, message.name, text, "more than 8 bytes without the mark of CAN FD")
    return "StandardCAN_FD"


def _remove_unsound_signals(message: MessageText, notes: DbcNotes, findings: DbcFindings) -> None:
    by_name: dict[str, SignalText] = {}
    for signal in list(message.signals):
        dotted = f"{message.name}.{signal.name}"
        first = by_name.setdefault(signal.name, signal)
        if first is not signal:
            _remove(message, signal, f"is already in line {first.line}", _TWICE, findings)
            continue
        is_float = notes.value_types.get(message.number, signal.written) in (1, 2)
        if signal.length == 0:
            _remove(message, signal, "has no bits", "signals without bits", findings)
        elif signal.first_bit + signal.length > 8 * message.length:
            text = f"bits {signal.start}|{signal.length} do not fit into {message.length} bytes"
            _remove(message, signal, text, "signals beyond their message", findings)
        elif signal.scale == 0:
            _remove(message, signal, "factor 0: every value would be the same", "factors of 0", findings)
        elif is_float and signal.length not in _FLOAT_WIDTHS:
            text = f"a float of {signal.length} bits; 16, 32 and 64 are possible"
            _remove(message, signal, text, "floats of odd widths", findings)
        elif not signal.minimum <= signal.maximum:
            text = f"range {signal.written_range} has swapped ends"
            findings.add_error(signal.line, dotted, text, "ranges with swapped ends")


def _remove(message: MessageText, signal: SignalText, text: str, kind: str, findings: DbcFindings) -> None:
    """Remove a signal from its message and report an error."""
    findings.add_error(signal.line, f"{message.name}.{signal.name}", text, kind)
    message.remove(signal)


def _resolve_multiplexing(message: MessageText, notes: DbcNotes, findings: DbcFindings) -> dict[str, Condition]:
    """Return the condition of each multiplexed signal. Signals whose multiplexer is missing, or that depend on
    themselves, are removed."""
    conditions: dict[str, Condition] = {}
    while True:
        multiplexers = {signal.written: signal for signal in message.signals if signal.is_multiplexer}
        conditions = {}
        unsound: list[tuple[SignalText, str]] = []
        for signal in message.signals:
            if not signal.is_multiplexed:
                continue
            found = _find_condition(message, signal, multiplexers, notes)
            if isinstance(found, str):
                unsound.append((signal, found))
            elif found is not None:
                conditions[signal.written] = found
        unsound += ((signal, "depends on itself") for signal in message.signals if _is_circular(signal, conditions))
        if not unsound:
            return conditions
        for signal, text in unsound:
            _remove(message, signal, text, "multiplexed signals without a multiplexer", findings)


def _find_condition(
    message: MessageText, signal: SignalText, multiplexers: Mapping[str, SignalText], notes: DbcNotes
) -> Condition | str | None:
    """Return the condition of a multiplexed signal, None if it is always present, or a text about what is wrong."""
    others = [one for one in multiplexers.values() if one is not signal]
    stated = notes.multiplexing.get(message.number, signal.written)
    if stated is not None and stated.multiplexer in multiplexers:
        width = multiplexers[stated.multiplexer].length
        most = (1 << width) - 1
        ranges = [(low, min(high, most)) for low, high in stated.ranges if low <= min(high, most)]
        if (0, most) in ranges:
            return None
        count = sum(high - low + 1 for low, high in ranges)
        if not 0 < count <= _MOST_MULTIPLEXER_VALUES:
            return (
                f"is there for {count} values of {stated.multiplexer}; must be 1 to {_MOST_MULTIPLEXER_VALUES}, or all"
            )
        values = sorted({value for low, high in ranges for value in range(low, high + 1)})
        return Condition(stated.multiplexer, tuple(values))
    roots = [one for one in others if not one.is_multiplexed]
    parents = others if len(others) == 1 else roots
    if len(parents) == 1:
        return Condition(parents[0].written, (int(signal.marker.strip("mM")),))
    if not others:
        return f"is multiplexed, but {message.name} has no multiplexer"
    return f"is multiplexed, but no SG_MUL_VAL_ says by which of {len(others)} multiplexers"


def _is_circular(signal: SignalText, conditions: Mapping[str, Condition]) -> bool:
    """Whether a signal depends on itself."""
    seen: set[str] = set()
    name = signal.written
    while name in conditions and name not in seen:
        seen.add(name)
        name = conditions[name].multiplexer
    return name == signal.written and bool(seen)
