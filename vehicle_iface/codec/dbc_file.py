"""One DBC file, read message by message: a fault in one hides no other, and each fault has its line."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cantools.database import Message, load_string
from cantools.database.can import Database
from cantools.database.errors import Error as CantoolsError

from vehicle_iface.codec.dbc_canonical import CanonicalWriter
from vehicle_iface.codec.dbc_findings import ERROR, DbcFinding, DbcFindings
from vehicle_iface.codec.dbc_notes import DbcNotes
from vehicle_iface.codec.dbc_overlap import find_overlaps
from vehicle_iface.codec.dbc_repair import SoundMessage, repair_messages
from vehicle_iface.codec.dbc_source import MessageText, collect_messages
from vehicle_iface.codec.dbc_text import read_text, split_statements
from vehicle_iface.errors import ConfigError

_FOREIGN = (
    CantoolsError,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    RecursionError,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class DbcFile:
    """A DBC that was loaded, with the lines of what is in it and all that is odd or wrong."""

    name: str
    database: Database
    """What can be used. Messages and signals that cannot are not in it."""
    lines: Mapping[str, int]
    """Of each MESSAGE and MESSAGE.SIGNAL."""
    findings: Sequence[DbcFinding] = ()
    """In the order of lines. Their errors only matter for what is used."""
    parts: Mapping[str, "DbcFile"] = field(default_factory=dict)
    """By the name of the bus, the files that this one is made of; none where it is one file."""

    def part_of(self, dotted: str) -> "DbcFile":
        """The file that a message or signal is in."""
        return next((part for part in self.parts.values() if dotted in part.lines), self)

    def fault(self, dotted: str, text: str) -> ConfigError:
        """An error about a message or signal, with its line."""
        return _fault(self.part_of(dotted).name, self.lines.get(dotted, 0), f"{dotted}: {text}")

    def error_of(self, finding: DbcFinding) -> ConfigError:
        """The error that a finding is where the program uses what it is about."""
        file = next((part for part in self.parts.values() if finding in part.findings), self)
        return _fault(file.name, finding.line, finding.text)

    @property
    def errors(self) -> list[ConfigError]:
        """What makes messages or signals unusable."""
        return [self.error_of(finding) for finding in self.findings if finding.severity == ERROR]

    def select_messages(self, names: Sequence[str]) -> list[Message]:
        """The messages of these names, each once; without names all but those that are unsound as a whole."""
        messages = {message.name: message for message in self.database.messages}
        for name in names:
            if name not in messages:
                unknown = ConfigError(f"message {name}: must be one of: {', '.join(messages)}")
                raise self.find_error(name) or unknown
        unsound = {place for finding in self.findings if finding.severity == ERROR for place in finding.about}
        return [messages[name] for name in dict.fromkeys(names) or messages if name in names or name not in unsound]

    def find_error(self, dotted: str) -> ConfigError | None:
        """Why a message or signal is not in the database, although the file has it."""
        about = (one for one in self.findings if one.severity == ERROR and dotted in one.about)
        return next((self.error_of(finding) for finding in about), None)


def read_dbc(path: Path) -> DbcFile:
    """Load a DBC. `ConfigError` for a file that is none, is cut short, or has no message that can be used."""
    name, text = path.name, read_text(path)
    if not text.strip():
        raise _fault(name, 1, "the file is empty")
    findings = DbcFindings()
    statements = list(split_statements(name, text))
    messages = collect_messages(name, statements, findings)
    notes = DbcNotes(name, messages, statements, findings)
    database = _parse(list(repair_messages(messages, notes, findings)), notes, findings)
    lines = _lines(messages)
    for message in database.messages:
        for overlap in find_overlaps(message):
            about = tuple(f"{message.name}.{name}" for name in (overlap.signal, *overlap.others))
            more = f" and {len(overlap.others) - 3} more" if len(overlap.others) > 3 else ""
            text = f"overlapping: shares bits with {', '.join(overlap.others[:3])}{more}"
            findings.add_error(lines[about[0]], about, text, "overlapping signals")
    file = DbcFile(name=name, database=database, lines=lines, findings=tuple(findings))
    if not database.messages:
        raise ConfigError("\n".join([*map(str, file.errors), f"{name}: no message in it"]))
    return file


def _parse(messages: Sequence[SoundMessage], notes: DbcNotes, findings: DbcFindings) -> Database:
    """Parse all of them at once; where cantools rejects that, one by one."""
    writer = CanonicalWriter(notes)
    text, head = writer.write_messages(messages), writer.write_head()
    logging.getLogger(Database.__module__).setLevel(logging.ERROR)  # what it warns of is among the findings
    try:
        database = _load(head + text)
    except _FOREIGN:
        database = Database(strict=False)
        for message in messages:
            try:
                database.messages.extend(_load(head + writer.write_messages([message])).messages)
            except _FOREIGN as error:
                text = f"was not understood: {' '.join(str(error).split()) or type(error).__name__}"
                findings.add_error(message.text.line, message.text.name, text, "not understood")
        database.refresh()
    writer.restore_names(database)
    return database


def _load(text: str) -> Database:
    database = load_string(text, database_format="dbc", strict=False)
    assert isinstance(database, Database)  # of diagnostics are other formats
    return database


def _lines(messages: Sequence[MessageText]) -> dict[str, int]:
    """Lines of all messages and signals, the first ones of duplicates."""
    lines: dict[str, int] = {}
    for message in messages:
        if message.name not in lines:
            lines[message.name] = message.line
            for signal in message.signals:
                lines.setdefault(f"{message.name}.{signal.name}", signal.line)
    return lines


def _fault(name: str, line: int, text: str) -> ConfigError:
    return ConfigError(f"{name}:{line}: {text}" if line else f"{name}: {text}")
