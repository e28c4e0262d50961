"""Reads a DBC's further statements about messages and signals: names of values, attributes, multiplexing.

Each statement is found by the number of its message and the written name of its signal. Statements that do not matter
here (nodes, environment variables, groups, other attributes) are not parsed, so faults in them are not reported.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator
from typing import Generic, TypeVar

import msgspec

from vehicle_iface.codec.dbc_findings import DbcFindings
from vehicle_iface.codec.dbc_source import NUMBER, MessageText, shorten, unquote
from vehicle_iface.codec.dbc_text import STRING, Statement, cut_short
from vehicle_iface.value import Value

T = TypeVar("T")
Place = tuple[int, str]
"""The number of a message, and the written name of its signal; "" for the message itself."""
FRAME_FORMAT = "VFrameFormat"
NUMERIC_ATTRIBUTES = ("GenMsgCycleTime", "GenSigStartValue", "E2EDataId", "E2EProfile")
_ATTRIBUTES = frozenset({*NUMERIC_ATTRIBUTES, FRAME_FORMAT})
"""The attributes that the program reads."""
_WHOLE = frozenset({"E2EDataId", "E2EProfile"})
FRAME_FORMATS = (
    *("StandardCAN", "ExtendedCAN", "reserved", "J1939PG"),
    *["reserved"] * 10,
    *("StandardCAN_FD", "ExtendedCAN_FD"),
)
"""The names of VFrameFormat in the order of their numbers, as the format's own editor defines them."""
_PAIR = re.compile(rf"({NUMBER})\s*({STRING})\s*")
_NAMES_OF_VALUES = re.compile(rf"(?:(\d{{1,10}})\s+)?(\w+)\s*((?:{NUMBER}\s*{STRING}\s*)*)(\w*)")
_RANGES = re.compile(r"(\d{1,10})\s+(\w+)\s+(\w+)\s+(\d+\s*-\s*\d+(?:[\s,]+\d+\s*-\s*\d+)*)")
_RANGE = re.compile(r"(\d{1,10})\s*-\s*(\d{1,10})")
_VALUE_TYPE = re.compile(r"(\d{1,10})\s+(\w+)\s*:?\s*([012])")
_SENDERS = re.compile(r"(\d{1,10})\s*:?\s*([\w\s,]*)")
_COMMENT = re.compile(rf"(?:BO_\s+(\d{{1,10}})|SG_\s+(\d{{1,10}})\s+(\w+))\s*({STRING})", re.DOTALL)
_OTHER_COMMENT = re.compile(rf"(?:(?:BU_|EV_)\s+\w+\s*)?{STRING}", re.DOTALL)
_ATTRIBUTE = re.compile(rf'"\w+"\s+(?:BO_\s+(\d{{1,10}})|SG_\s+(\d{{1,10}})\s+(\w+))\s*({NUMBER}|{STRING})')
_DEFINITION = re.compile(r'(?:(?:BU_|BO_|SG_|EV_)\s*)?"(\w+)"\s+(\w+)(.*)', re.DOTALL)
_DEFAULT = re.compile(rf'"(\w+)"\s*({NUMBER}|{STRING})')
_GUESS = re.compile(r"\D*(\d{1,10})\s+(\w*)")


class MultiplexerRanges(Value, frozen=True):
    """The values of a multiplexer for which a signal is present."""

    multiplexer: str
    ranges: tuple[tuple[int, int], ...]


class _Note(Value, Generic[T], frozen=True):
    value: T
    line: int


class NoteTable(Generic[T]):
    """Notes of one kind, at most one for each place. A second, different note is reported as an error."""

    def __init__(self, what: str, notes: "DbcNotes") -> None:
        self._what = what
        self._notes = notes
        self._by_place: dict[Place, _Note[T]] = {}

    def get(self, number: int, signal: str = "") -> T | None:
        note = self._by_place.get((number, signal))
        return None if note is None else note.value

    def values(self) -> Iterator[T]:
        return (note.value for note in self._by_place.values())

    def add(self, line: int, place: Place, value: T) -> None:
        name = self._notes.name_place(line, place, self._what)
        known = self._by_place.setdefault(place, _Note(value, line))
        if name and known.value != value:
            text = f"has another {self._what} in line {known.line}; which of the two is meant cannot be known"
            self._notes.findings.add_error(line, name, text, f"two different {self._what}s")


class _Definitions(msgspec.Struct):
    """The definitions of attributes: their lines, the names of enumerated values, and the defaults."""

    lines: dict[str, int] = msgspec.field(default_factory=dict)
    choices: dict[str, list[str]] = msgspec.field(default_factory=dict)
    defaults: dict[str, str] = msgspec.field(default_factory=dict)


class DbcNotes:
    """All notes of a file."""

    def __init__(
        self, file_name: str, messages: Iterable[MessageText], statements: Iterable[Statement], findings: DbcFindings
    ) -> None:
        """Raises `ConfigError` if the last statement is cut short."""
        self.findings = findings
        self._places: dict[Place, str] = {}
        for message in messages:
            if (message.number, "") not in self._places:
                self._places[message.number, ""] = message.name
                self._places.update(((message.number, name), dotted) for name, dotted in message.places.items())
        self._definitions = _Definitions()
        self._tables: dict[str, tuple[tuple[int, str], ...]] = {}
        self.value_names: NoteTable[tuple[tuple[int, str], ...]] = NoteTable("VAL_ table", self)
        self.value_types: NoteTable[int] = NoteTable("SIG_VALTYPE_", self)
        self.multiplexing: NoteTable[MultiplexerRanges] = NoteTable("SG_MUL_VAL_", self)
        self.attributes: dict[str, NoteTable[str]] = {name: NoteTable(name, self) for name in _ATTRIBUTES}
        self.comments: dict[Place, str] = {}
        self.senders: dict[int, list[str]] = {}
        statements = list(statements)
        for statement in statements:
            if statement.keyword in _FIRST:
                _FIRST[statement.keyword](self, statement)
        for statement in statements:
            if statement.keyword in _THEN:
                if not _THEN[statement.keyword](self, statement):
                    if statement.may_be_cut:
                        raise cut_short(file_name, statement.line)
                    self._report_damage(statement)
                elif not statement.is_whole:
                    findings.add_warning(statement.line, "", f"{statement.keyword} without a semicolon", "no semicolon")

    def name_place(self, line: int, place: Place, what: str) -> str:
        """Return MESSAGE or MESSAGE.SIGNAL of a place; "" and a finding if it does not exist."""
        name = self._places.get(place, "")
        if not name:
            message = self._places.get((place[0], ""), "")
            text = f"{what} of {message or f'id {place[0]}'}{'.' if place[1] else ''}{place[1]}, which is not there"
            if place[0] <= 0x9FFFFFFF:  # above is the place for signals that are in no message
                self.findings.add_warning(line, "", text, f"{what} of something that is not there")
        return name

    def frame_format(self, number: int) -> str:
        """Return the name of a message's frame format; "" if the file does not state it."""
        value = self.attributes[FRAME_FORMAT].get(number)
        return self._definitions.defaults.get(FRAME_FORMAT, "") if value is None else value

    def default(self, attribute: str) -> str | None:
        return self._definitions.defaults.get(attribute)

    def _define(self, statement: Statement) -> None:
        found = _DEFINITION.fullmatch(statement.body)
        if found and found[1] in _ATTRIBUTES:
            self._definitions.lines[found[1]] = statement.line
            self._definitions.choices[found[1]] = [unquote(text) for text in re.findall(STRING, found[3])]

    def _define_table(self, statement: Statement) -> None:
        found = _NAMES_OF_VALUES.fullmatch(statement.body)
        if found and not found[1]:
            self._tables[found[2]] = tuple(_pairs(found[3]))

    def _set_default(self, statement: Statement) -> bool:
        found = _DEFAULT.fullmatch(statement.body)
        if found and found[1] in _ATTRIBUTES:
            value = self._convert(found[1], found[2])
            if value is None:
                return False
            self._definitions.defaults[found[1]] = value
        return found is not None or not any(name in statement.body for name in _ATTRIBUTES)

    def _add_attribute(self, statement: Statement) -> bool:
        name = next((name for name in _ATTRIBUTES if statement.body.startswith(f'"{name}"')), "")
        if not name:
            return True
        found = _ATTRIBUTE.fullmatch(statement.body)
        value = self._convert(name, found[4]) if found else None
        if found is None or value is None:
            return False
        if name not in self._definitions.lines:
            self._definitions.lines[name] = statement.line
            self.findings.add_warning(statement.line, "", f"{name} has no BA_DEF_; its values are taken as they are")
        self.attributes[name].add(statement.line, (int(found[1] or found[2]), found[3] or ""), value)
        return True

    def _convert(self, name: str, written: str) -> str | None:
        """Convert an attribute's value for cantools: a number or the name of a frame format; None if it is neither."""
        text = unquote(written) if written.startswith('"') else written
        if name == FRAME_FORMAT:
            names = self._definitions.choices.get(name) or FRAME_FORMATS
            if text in names or (text in FRAME_FORMATS and not text.isdigit()):
                return text
            return names[int(text)] if text.isdigit() and len(text) < 4 and int(text) < len(names) else None
        try:
            number = float(text)
        except ValueError:
            return None
        if not math.isfinite(number) or (name in _WHOLE and not number.is_integer()):
            return None
        return str(int(number)) if number.is_integer() else repr(number)

    def _add_value_names(self, statement: Statement) -> bool:
        found = _NAMES_OF_VALUES.fullmatch(statement.body)
        if found is None or (found[4] and (found[3] or found[4] not in self._tables)):
            return False
        if not found[1]:
            return True  # of an environment variable
        pairs = self._tables[found[4]] if found[4] else tuple(_pairs(found[3]))
        place, names = (int(found[1]), found[2]), dict(reversed(pairs))
        for number, name in pairs:
            if names[number] != name and (dotted := self._places.get(place)):
                text = f"its VAL_ table names {number} twice, {names[number]!r} and {name!r}"
                self.findings.add_error(statement.line, dotted, text, "a number with two names")
        if names:
            self.value_names.add(statement.line, place, tuple(sorted(names.items())))
        return True

    def _add_value_type(self, statement: Statement) -> bool:
        found = _VALUE_TYPE.fullmatch(statement.body)
        if found:
            self.value_types.add(statement.line, (int(found[1]), found[2]), int(found[3]))
        return found is not None

    def _add_multiplexing(self, statement: Statement) -> bool:
        found = _RANGES.fullmatch(statement.body)
        if found is None:
            return False
        ranges = tuple((int(low), int(high)) for low, high in _RANGE.findall(found[4]))
        self.multiplexing.add(statement.line, (int(found[1]), found[2]), MultiplexerRanges(found[3], ranges))
        return True

    def _add_senders(self, statement: Statement) -> bool:
        found = _SENDERS.fullmatch(statement.body)
        if found:
            self.senders.setdefault(int(found[1]), []).extend(re.findall(r"\w+", found[2]))
        return found is not None

    def _add_comment(self, statement: Statement) -> bool:
        found = _COMMENT.fullmatch(statement.body)
        if found:
            self.comments[int(found[1] or found[2]), found[3] or ""] = unquote(found[4])
        elif not _OTHER_COMMENT.fullmatch(statement.body):
            if not statement.is_whole:
                return False
            text = f"a comment that belongs to nothing known: {shorten(statement.body)}"
            self.findings.add_warning(statement.line, "", text, "comments that belong to nothing known")
        return True

    def _report_damage(self, statement: Statement) -> None:
        """Report a damaged statement, with the message or signal that it seems to name."""
        guess = _GUESS.match(re.sub(r'^"\w*"', "", statement.body))
        number = int(guess[1][:12]) if guess else -1
        about = (guess and self._places.get((number, guess[2]))) or self._places.get((number, ""), "")
        text = f"was not understood: {shorten(f'{statement.keyword} {statement.body}')}"
        add = self.findings.add_warning if statement.keyword == "CM_" else self.findings.add_error
        add(statement.line, about, text, "not understood")


def _pairs(text: str) -> Iterator[tuple[int, str]]:
    for number, name in _PAIR.findall(text):
        if re.fullmatch(r"[-+]?\d{1,20}", number):
            yield int(number), unquote(name)
        elif float(number).is_integer():
            yield int(float(number)), unquote(name)


_FIRST: dict[str, Callable[[DbcNotes, Statement], None]] = {
    "BA_DEF_": DbcNotes._define,
    "VAL_TABLE_": DbcNotes._define_table,
}
_THEN: dict[str, Callable[[DbcNotes, Statement], bool]] = {
    "BA_DEF_DEF_": DbcNotes._set_default,
    "BA_": DbcNotes._add_attribute,
    "VAL_": DbcNotes._add_value_names,
    "SIG_VALTYPE_": DbcNotes._add_value_type,
    "SG_MUL_VAL_": DbcNotes._add_multiplexing,
    "BO_TX_BU_": DbcNotes._add_senders,
    "CM_": DbcNotes._add_comment,
}
