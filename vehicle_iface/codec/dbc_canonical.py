"""Writes repaired messages as a DBC that every parser reads alike."""

import re
from collections.abc import Iterable, Iterator, Mapping

from cantools.database.can import Database

from vehicle_iface.codec.dbc_notes import FRAME_FORMAT, FRAME_FORMATS, NUMERIC_ATTRIBUTES, DbcNotes
from vehicle_iface.codec.dbc_repair import SoundMessage
from vehicle_iface.codec.dbc_source import SignalText
from vehicle_iface.codec.dbc_text import KEYWORDS

_PLAIN_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_NOBODY = "Vector__XXX"


class CanonicalWriter:
    """Writes messages one by one. A name that a parser could misread is replaced by an alias in the text;
    `restore_names` puts it back in the database."""

    def __init__(self, notes: DbcNotes) -> None:
        self._notes = notes
        self._alias_of: dict[str, str] = {}
        self._aliases: dict[str, str] = {}
        """The other way round."""

    def write_head(self) -> str:
        """Write the definitions of the attributes that the messages use."""
        lines = ['VERSION ""']
        for name in NUMERIC_ATTRIBUTES:
            kind = "SG_" if name == "GenSigStartValue" else "BO_"
            values = [str(self._notes.default(name) or 0), *self._notes.attributes[name].values()]
            is_whole = all(re.fullmatch(r"[-+]?\d+", value) for value in values)
            lines.append(f'BA_DEF_ {kind} "{name}" {"INT" if is_whole else "FLOAT"};')
        lines.append(f'BA_DEF_DEF_ "GenMsgCycleTime" {self._notes.default("GenMsgCycleTime") or 0};')
        names = ",".join(f'"{name}"' for name in FRAME_FORMATS)
        lines.append(f'BA_DEF_ BO_ "{FRAME_FORMAT}" ENUM {names};\nBA_DEF_DEF_ "{FRAME_FORMAT}" "StandardCAN";\n')
        return "\n".join(lines)

    def write_messages(self, messages: Iterable[SoundMessage]) -> str:
        return "".join("\n".join(self._lines(message)) + "\n" for message in messages)

    def restore_names(self, database: Database) -> None:
        """Replace all aliases in the database by the original names."""
        if not self._aliases:
            return
        for message in database.messages:
            if not {message.name, *(signal.name for signal in message.signals)}.isdisjoint(self._aliases):
                message.name = self._aliases.get(message.name, message.name)
                for signal in message.signals:
                    signal.name = self._aliases.get(signal.name, signal.name)
                    parent = signal.multiplexer_signal
                    signal.multiplexer_signal = None if parent is None else self._aliases.get(parent, parent)
                message.refresh(strict=False)
        database.refresh()

    def _lines(self, message: SoundMessage) -> Iterator[str]:
        text, number, notes = message.text, message.number, self._notes
        yield f"BO_ {number} {self._name(text.name)}: {text.length} {_node(text.sender)}"
        for signal in text.signals:
            yield self._signal_line(message, signal)
        if text.number in notes.senders:
            yield f"BO_TX_BU_ {number} : {','.join(map(_node, notes.senders[text.number]))};"
        yield from self._attribute_lines(text.number, "", f"BO_ {number}")
        if message.frame_format:
            yield f'BA_ "{FRAME_FORMAT}" BO_ {number} {FRAME_FORMATS.index(message.frame_format)};'
        if comment := notes.comments.get((text.number, "")):
            yield f"CM_ BO_ {number} {_quote(comment)};"
        names = {signal.written: self._name(signal.name) for signal in text.signals}
        for signal in text.signals:
            yield from self._note_lines(message, signal, names)

    def _signal_line(self, message: SoundMessage, signal: SignalText) -> str:
        condition = message.conditions.get(signal.written)
        multiplexed = f"m{condition.values[0]}" if condition else ""
        marker = f" {multiplexed}{'M' if signal.is_multiplexer else ''}".rstrip()
        scale, offset, minimum, maximum = map(_number, signal.numbers)
        layout = f"{signal.start}|{signal.length}@{'0' if signal.is_big else '1'}{'-' if signal.is_signed else '+'}"
        receivers = ",".join(map(_node, signal.receivers)) or _NOBODY
        values = f"({scale},{offset}) [{minimum}|{maximum}] {_quote(signal.unit)} {receivers}"
        return f" SG_ {self._name(signal.name)}{marker} : {layout} {values}"

    def _note_lines(self, message: SoundMessage, signal: SignalText, names: Mapping[str, str]) -> Iterator[str]:
        """Write the further statements about a signal."""
        notes, written, name = self._notes, signal.written, names[signal.written]
        source, number = message.text.number, message.number
        if condition := message.conditions.get(written):
            ranges = ", ".join(f"{low}-{high}" for low, high in _group(condition.values))
            yield f"SG_MUL_VAL_ {number} {name} {names[condition.multiplexer]} {ranges};"
        if kind := notes.value_types.get(source, written):
            yield f"SIG_VALTYPE_ {number} {name} : {kind};"
        if table := notes.value_names.get(source, written):
            yield f"VAL_ {number} {name} {' '.join(f'{value} {_quote(text)}' for value, text in table)} ;"
        yield from self._attribute_lines(source, written, f"SG_ {number} {name}")
        if comment := notes.comments.get((source, written)):
            yield f"CM_ SG_ {number} {name} {_quote(comment)};"

    def _attribute_lines(self, number: int, signal: str, place: str) -> Iterator[str]:
        for name in NUMERIC_ATTRIBUTES:
            value = self._notes.attributes[name].get(number, signal)
            if value is not None:
                yield f'BA_ "{name}" {place} {value};'

    def _name(self, name: str) -> str:
        if _PLAIN_NAME.fullmatch(name) and name not in KEYWORDS:
            return name
        alias = self._alias_of.setdefault(name, f"alias_{len(self._alias_of)}_of_an_odd_name")
        self._aliases[alias] = name
        return alias


def _node(name: str) -> str:
    """Return a node's name as one word; a placeholder if it has no name."""
    return re.sub(r"[^A-Za-z0-9_]", "_", f"_{name}" if name[:1].isdigit() else name) or _NOBODY


def _number(written: str) -> str:
    """Add the digit before the decimal point if it is missing."""
    return re.sub(r"^([-+]?)\.", r"\g<1>0.", written) if "." in written[:2] else written


def _quote(text: str) -> str:
    """Return a string literal. A backslash at its end would escape the quotation mark, so a blank follows it."""
    escaped = text.replace('"', '\\"')
    return f'"{escaped} "' if escaped.endswith("\\") else f'"{escaped}"'


def _group(values: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Group successive numbers, each group as first and last."""
    first = last = None
    for value in values:
        if last is not None and first is not None and value != last + 1:
            yield first, last
            first = value
        first, last = value if first is None else first, value
    if first is not None and last is not None:
        yield first, last
