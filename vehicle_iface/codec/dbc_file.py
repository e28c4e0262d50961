"""One DBC file, read strictly: what cantools would load with a shrug is refused here, with its line."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from cantools.database import load_string
from cantools.database.can import Database
from cantools.database.errors import Error as CantoolsError

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
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_MESSAGE = re.compile(r"^[ \t]*BO_[ \t]+(\d{1,10})[ \t]+(\w+)[ \t]*:", re.MULTILINE)
_SIGNAL = re.compile(r"^[ \t]*SG_[ \t]+(\w+)", re.MULTILINE)
_MULTIPLEXED = re.compile(r"^[ \t]*SG_[ \t]+(\w+)[ \t]+m\d+M?[ \t]*:", re.MULTILINE)
_MULTIPLEXER = re.compile(r"^[ \t]*SG_[ \t]+\w+[ \t]+(?:m\d+)?M[ \t]*:", re.MULTILINE)
_UNBOUND = "VECTOR__INDEPENDENT_SIG_MSG"


@dataclass(frozen=True, slots=True, kw_only=True)
class DbcFile:
    """A DBC that was loaded, with the lines of what is in it."""

    name: str
    database: Database
    lines: Mapping[str, int]
    """Of each MESSAGE and MESSAGE.SIGNAL."""

    def fault(self, dotted: str, text: str) -> ConfigError:
        """An error about a message or signal, with its line."""
        return _fault(self.name, self.lines.get(dotted, 0), f"{dotted}: {text}")


Note = Callable[[ConfigError], None]
"""What is done about a fault: raise it, or keep it and look for more."""


def read_dbc(path: Path) -> DbcFile:
    """Load a DBC; `ConfigError` with file and line when anything in it is doubtful.

    Refused besides what cantools refuses: text that is not text, an end in mid-statement, two
    messages of one id or name, two signals of one name, a factor of 0, a range upside down."""
    text = _text(path)
    return _parsed(path.name, text, _examined(path.name, text, _refuse), _refuse, strict=True)


def inspect_dbc(path: Path, note: Note) -> DbcFile | None:
    """Load a DBC as far as it goes, with its faults told to `note`; overlaps and signals beyond their message are
    left to the caller. None when there is nothing to look at."""
    try:
        text = _text(path)
        return _parsed(path.name, text, _examined(path.name, text, note), note, strict=False)
    except ConfigError as error:
        note(error)
        return None


def _refuse(error: ConfigError) -> None:
    raise error


def _examined(name: str, text: str, note: Note) -> dict[str, int]:
    """Lines of all messages and signals."""
    bare = _STRING.sub(_blank, text)
    _check_ending(name, text, bare, note)
    return _lines(name, bare, note)


def _parsed(name: str, text: str, lines: Mapping[str, int], note: Note, *, strict: bool) -> DbcFile:
    try:
        database = load_string(text, database_format="dbc", strict=strict)
    except _FOREIGN as error:
        raise _translated(name, lines, error) from None
    if not isinstance(database, Database):
        raise ConfigError(f"{name}: describes diagnostics, not a bus")
    file = DbcFile(name=name, database=database, lines=lines)
    _check_parsed(file, note)
    return file


def _text(path: Path) -> str:
    """UTF-8 or, as DBC tools write it, Windows code page 1252."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    if 0 in data:
        raise _fault(path.name, data[: data.index(0)].count(b"\n") + 1, "a NUL byte: not a DBC, or in UTF-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    try:
        return data.decode("cp1252")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise _fault(path.name, line, f"byte {data[error.start]:#04x} is neither UTF-8 nor code page 1252") from None


def _blank(found: re.Match[str]) -> str:
    """A string literal without its text, but with its line ends."""
    return '"' + "\n" * found[0].count("\n") + '"'


def _check_ending(name: str, text: str, bare: str, note: Note) -> None:
    last = text.count("\n") + 1
    if not bare.strip():
        raise _fault(name, 1, "the file is empty")
    if bare.count('"') % 2:
        note(_fault(name, last, "the file ends inside a string; it is cut short"))
    elif not text.endswith(("\n", ";")):
        note(_fault(name, last, "the file ends in the middle of a line; it may be cut short"))


def _lines(name: str, bare: str, note: Note) -> dict[str, int]:
    """Lines of all messages and signals, the first ones of duplicates."""
    lines: dict[str, int] = {}
    ids: dict[int, int] = {}
    for message, can_id, line, body in _messages(bare):
        if message == _UNBOUND:
            continue
        if message in lines:
            note(_fault(name, line, f"message {message} is already in line {lines[message]}"))
            continue
        if can_id in ids:
            note(_fault(name, line, f"message {message}: id {can_id} is already in line {ids[can_id]}"))
        ids.setdefault(can_id, line)
        lines[message] = line
        for found in _SIGNAL.finditer(body):
            dotted = f"{message}.{found[1]}"
            signal_line = line + body[: found.start(1)].count("\n")
            if dotted in lines:
                note(_fault(name, signal_line, f"signal {dotted} is already in line {lines[dotted]}"))
            lines.setdefault(dotted, signal_line)
        orphan = _MULTIPLEXED.search(body)
        if orphan and not _MULTIPLEXER.search(body):
            dotted = f"{message}.{orphan[1]}"
            note(_fault(name, lines[dotted], f"{dotted} is multiplexed, but {message} has no multiplexer"))
    return lines


def _messages(bare: str) -> Iterator[tuple[str, int, int, str]]:
    """Name, id, line and text of each message."""
    found = list(_MESSAGE.finditer(bare))
    ends = [match.start() for match in found[1:]] + [len(bare)] * bool(found)
    for match, end in zip(found, ends, strict=True):
        line = bare[: match.start(1)].count("\n") + 1
        yield match[2], int(match[1]), line, bare[match.start(1) : end]


def _check_parsed(file: DbcFile, note: Note) -> None:
    parsed = {message.name for message in file.database.messages}
    written = {name for name in file.lines if "." not in name}
    for name in sorted(written ^ parsed):
        note(file.fault(name, "was not understood; the file is damaged"))
    if not parsed:
        raise ConfigError(f"{file.name}: no message in it")
    for message in file.database.messages:
        for signal in message.signals:
            dotted = f"{message.name}.{signal.name}"
            if signal.scale == 0:
                note(file.fault(dotted, "factor 0: every value would be the same"))
            low, high = signal.minimum, signal.maximum
            if low is not None and high is not None and not low <= high:
                note(file.fault(dotted, f"range [{low}|{high}] is upside down"))


def _translated(name: str, lines: Mapping[str, int], error: Exception) -> ConfigError:
    """cantools' words, with the line that they are about."""
    text = " ".join(str(error).split()).removeprefix('DBC: "').removesuffix('"')
    stated = re.search(r"line (\d+)", text)
    if stated:
        return _fault(name, int(stated[1]), text)
    words = re.findall(r"\w+", text)
    message = next((word for word in words if word in lines), "")
    dotted = next((f"{message}.{word}" for word in words if f"{message}.{word}" in lines), message)
    return _fault(name, lines.get(dotted, 0), text or type(error).__name__)


def _fault(name: str, line: int, text: str) -> ConfigError:
    return ConfigError(f"{name}:{line}: {text}" if line else f"{name}: {text}")
