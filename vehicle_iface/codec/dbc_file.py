"""One DBC file, read strictly: what cantools would load with a shrug is refused here, with its line."""

import re
from collections.abc import Iterable, Iterator, Mapping
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


def read_dbc(path: Path) -> DbcFile:
    """Load a DBC; `ConfigError` with file and line of everything in it that is doubtful.

    Refused besides what cantools refuses: text that is not text, an end in mid-statement, two
    messages of one id or name, two signals of one name, a factor of 0, a range upside down."""
    file, faults = _load(path, strict=True)
    if file is None or faults:
        raise ConfigError("\n".join(map(str, faults)))
    return file


def inspect_dbc(path: Path) -> tuple[DbcFile | None, list[ConfigError]]:
    """Load a DBC as far as it goes, with its faults; overlaps and signals beyond their message are left to the caller.
    None when there is nothing to look at."""
    return _load(path, strict=False)


def _load(path: Path, *, strict: bool) -> tuple[DbcFile | None, list[ConfigError]]:
    name, faults = path.name, list[ConfigError]()
    try:
        text = _text(path)
        bare = _STRING.sub(_blank, text)
        if not bare.strip():
            raise _fault(name, 1, "the file is empty")
        messages = list(_messages(bare))
        faults += _ending_faults(name, text, bare)
        faults += _duplicate_faults(name, messages)
        lines = _lines(messages)
        file = DbcFile(name=name, database=_parse(name, text, lines, strict), lines=lines)
    except ConfigError as error:
        return None, [*faults, error]
    faults += _content_faults(file)
    if not file.database.messages:
        return None, [*faults, ConfigError(f"{name}: no message in it")]
    return file, faults


def _parse(name: str, text: str, lines: Mapping[str, int], strict: bool) -> Database:
    try:
        database = load_string(text, database_format="dbc", strict=strict)
    except _FOREIGN as error:
        raise _explain(name, lines, error) from None
    if not isinstance(database, Database):
        raise ConfigError(f"{name}: describes diagnostics, not a bus")
    return database


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


def _ending_faults(name: str, text: str, bare: str) -> Iterator[ConfigError]:
    last = text.count("\n") + 1
    if bare.count('"') % 2:
        yield _fault(name, last, "the file ends inside a string; it is cut short")
    elif not text.endswith(("\n", ";")):
        yield _fault(name, last, "the file ends in the middle of a line; it may be cut short")


@dataclass(frozen=True, slots=True)
class _MessageText:
    """A message as it stands in the file."""

    name: str
    can_id: int
    line: int
    signals: tuple[tuple[str, int], ...]
    """MESSAGE.SIGNAL and line of each."""
    orphan: tuple[str, int] | None
    """MESSAGE.SIGNAL and line of the first multiplexed signal, where there is no multiplexer."""


def _messages(bare: str) -> Iterator[_MessageText]:
    found = list(_MESSAGE.finditer(bare))
    ends = [match.start() for match in found[1:]] + [len(bare)] * bool(found)
    for match, end in zip(found, ends, strict=True):
        name, body = match[2], bare[match.start(1) : end]
        if name == _UNBOUND:
            continue
        line = bare[: match.start(1)].count("\n") + 1
        signals = tuple(_place(name, body, line, signal) for signal in _SIGNAL.finditer(body))
        orphan = _MULTIPLEXED.search(body) if not _MULTIPLEXER.search(body) else None
        orphan_place = _place(name, body, line, orphan) if orphan else None
        yield _MessageText(name, int(match[1]), line, signals, orphan_place)


def _place(name: str, body: str, line: int, signal: re.Match[str]) -> tuple[str, int]:
    """MESSAGE.SIGNAL and line of a signal in a message's text, which begins in `line`."""
    return f"{name}.{signal[1]}", line + body[: signal.start(1)].count("\n")


def _lines(messages: Iterable[_MessageText]) -> dict[str, int]:
    """Lines of all messages and signals, the first ones of duplicates."""
    lines: dict[str, int] = {}
    for message in messages:
        if message.name not in lines:
            lines[message.name] = message.line
            for dotted, line in message.signals:
                lines.setdefault(dotted, line)
    return lines


def _duplicate_faults(name: str, messages: Iterable[_MessageText]) -> Iterator[ConfigError]:
    """Names and identifiers that are there twice, and multiplexed signals without a multiplexer."""
    lines: dict[str, int] = {}
    ids: dict[int, int] = {}
    for message in messages:
        if message.name in lines:
            yield _fault(name, message.line, f"message {message.name} is already in line {lines[message.name]}")
            continue
        lines[message.name] = message.line
        if message.can_id in ids:
            text = f"message {message.name}: id {message.can_id} is already in line {ids[message.can_id]}"
            yield _fault(name, message.line, text)
        ids.setdefault(message.can_id, message.line)
        for dotted, line in message.signals:
            if dotted in lines:
                yield _fault(name, line, f"signal {dotted} is already in line {lines[dotted]}")
            lines.setdefault(dotted, line)
        if message.orphan is not None:
            dotted, line = message.orphan
            yield _fault(name, line, f"{dotted} is multiplexed, but {message.name} has no multiplexer")


def _content_faults(file: DbcFile) -> Iterator[ConfigError]:
    parsed = {message.name for message in file.database.messages}
    written = {name for name in file.lines if "." not in name}
    for name in sorted(written ^ parsed):
        yield file.fault(name, "was not understood; the file is damaged")
    for message in file.database.messages:
        for signal in message.signals:
            dotted = f"{message.name}.{signal.name}"
            if signal.scale == 0:
                yield file.fault(dotted, "factor 0: every value would be the same")
            low, high = signal.minimum, signal.maximum
            if low is not None and high is not None and not low <= high:
                yield file.fault(dotted, f"range [{low}|{high}] is upside down")


def _explain(name: str, lines: Mapping[str, int], error: Exception) -> ConfigError:
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
