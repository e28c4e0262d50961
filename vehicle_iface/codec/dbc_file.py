"""Loads a DBC file message by message, so that a fault in one message does not hide the others; each has its line."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from vehicle_iface.codec.cantools_classes import Error as CantoolsError
from vehicle_iface.codec.cantools_classes import Message
from vehicle_iface.codec.dbc_build import StatedE2E, build_message, find_e2e
from vehicle_iface.codec.dbc_findings import ERROR, DbcFinding, DbcFindings
from vehicle_iface.codec.dbc_notes import DbcNotes
from vehicle_iface.codec.dbc_overlap import find_overlaps
from vehicle_iface.codec.dbc_repair import SoundMessage, repair_messages
from vehicle_iface.codec.dbc_source import MessageText, collect_messages
from vehicle_iface.codec.dbc_text import read_text, split_statements
from vehicle_iface.errors import ConfigError
from vehicle_iface.value import Value

_FOREIGN = (
    CantoolsError,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    RecursionError,
)


class DbcFile(Value, frozen=True, kw_only=True):
    """A loaded DBC, with the lines of its messages and signals and all findings."""

    name: str
    messages: Mapping[str, Message]
    """The usable messages by name, with their usable signals; the others have been left out."""
    lines: Mapping[str, int]
    """The line of each MESSAGE and MESSAGE.SIGNAL, from 1."""
    findings: Sequence[DbcFinding] = ()
    """All findings in the order of their lines. An error matters only if the program uses what it concerns."""
    e2e: Mapping[str, StatedE2E] = msgspec.field(default_factory=dict)
    """Maps each message with attributes of end-to-end protection to what they state."""
    parts: Mapping[str, "DbcFile"] = msgspec.field(default_factory=dict)
    """Maps the name of each bus to its file, if several were joined into this one; empty otherwise."""

    def part_of(self, dotted: str) -> "DbcFile":
        """Return the file that contains a message or signal."""
        return next((part for part in self.parts.values() if dotted in part.lines), self)

    def fault(self, dotted: str, text: str) -> ConfigError:
        """Build an error about a message or signal, with its line."""
        return _fault(self.part_of(dotted).name, self.lines.get(dotted, 0), f"{dotted}: {text}")

    def error_of(self, finding: DbcFinding) -> ConfigError:
        """Convert a finding to an error."""
        file = next((part for part in self.parts.values() if finding in part.findings), self)
        return _fault(file.name, finding.line, finding.text)

    @property
    def errors(self) -> list[ConfigError]:
        """Return the errors about all unusable messages and signals."""
        return [self.error_of(finding) for finding in self.findings if finding.severity == ERROR]

    def select_messages(self, names: Sequence[str]) -> list[Message]:
        """Return the messages with these names, each once; without names, all messages except wholly unusable ones."""
        for name in names:
            if name not in self.messages:
                unknown = ConfigError(f"message {name}: must be one of: {', '.join(self.messages)}")
                raise self.find_error(name) or unknown
        unsound = {place for finding in self.findings if finding.severity == ERROR for place in finding.about}
        chosen = dict.fromkeys(names) or self.messages
        return [self.messages[name] for name in chosen if name in names or name not in unsound]

    def find_error(self, dotted: str) -> ConfigError | None:
        """Return why a message or signal of the file was left out; None if no finding concerns it."""
        about = (one for one in self.findings if one.severity == ERROR and dotted in one.about)
        return next((self.error_of(finding) for finding in about), None)


def read_dbc(path: Path) -> DbcFile:
    """Load a DBC.

    Raises `ConfigError` for a file that is not a DBC, is cut short, or has no usable message.
    """
    name, text = path.name, read_text(path)
    if not text.strip():
        raise _fault(name, 1, "the file is empty")
    findings = DbcFindings()
    statements = list(split_statements(name, text))
    messages = collect_messages(name, statements, findings)
    notes = DbcNotes(name, messages, statements, findings)
    sound = list(repair_messages(messages, notes, findings))
    usable = _build_messages(sound, notes, findings)
    lines = _lines(messages)
    for message in usable.values():
        for overlap in find_overlaps(message):
            about = tuple(f"{message.name}.{name}" for name in (overlap.signal, *overlap.others))
            more = f" and {len(overlap.others) - 3} more" if len(overlap.others) > 3 else ""
            text = f"overlapping: shares bits with {', '.join(overlap.others[:3])}{more}"
            findings.add_error(lines[about[0]], about, text, "overlapping signals")
    e2e = {one.text.name: found for one in sound if (found := find_e2e(notes, one.text.number)) is not None}
    file = DbcFile(name=name, messages=usable, lines=lines, findings=tuple(findings), e2e=e2e)
    if not usable:
        raise ConfigError("\n".join([*map(str, file.errors), f"{name}: no message in it"]))
    return file


def _build_messages(messages: Sequence[SoundMessage], notes: DbcNotes, findings: DbcFindings) -> dict[str, Message]:
    """Build the messages that cantools can represent, by name; the others are reported."""
    built: dict[str, Message] = {}
    for message in messages:
        try:
            built[message.text.name] = build_message(message, notes)
        except _FOREIGN as error:
            text = f"was not understood: {' '.join(str(error).split()) or type(error).__name__}"
            findings.add_error(message.text.line, message.text.name, text, "not understood")
    return built


def _lines(messages: Sequence[MessageText]) -> dict[str, int]:
    """Return the lines of all messages and signals; of duplicates, the first one's."""
    lines: dict[str, int] = {}
    for message in messages:
        if message.name not in lines:
            lines[message.name] = message.line
            for signal in message.signals:
                lines.setdefault(f"{message.name}.{signal.name}", signal.line)
    return lines


def _fault(name: str, line: int, text: str) -> ConfigError:
    return ConfigError(f"{name}:{line}: {text}" if line else f"{name}: {text}")
