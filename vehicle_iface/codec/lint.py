"""All that is wrong with a DBC or a profile for control use, each with its line: `vehicle-iface check-dbc FILE`.

An error keeps the program from driving, a warning asks for a look. A `.toml` profile is
checked together with its DBC. A `.dbc` alone is checked without knowledge of what its signals are for.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cantools.database import Message, Signal

from vehicle_iface.codec.binding import PERIODS, Binding, Role, bits_of
from vehicle_iface.codec.consistency import find_faults
from vehicle_iface.codec.dbc_file import DbcFile, inspect_dbc
from vehicle_iface.codec.enumerations import describe_unknown_names
from vehicle_iface.codec.layout import Layout
from vehicle_iface.codec.protection_faults import describe_gap
from vehicle_iface.codec.quantities import find_unit
from vehicle_iface.errors import ConfigError
from vehicle_iface.motion_sources import describe_missing
from vehicle_iface.profile import Profile, inspect_profile

ERROR, WARNING = "error", "warning"


@dataclass(frozen=True, slots=True, order=True)
class LintFinding:
    """One thing that is wrong."""

    file: str
    line: int
    """From 1; 0 where the fault has no line of its own."""
    severity: str
    """`error` or `warning`"""
    text: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        return f"{place}: {self.severity}: {self.text}"


def check_file(path: Path) -> list[LintFinding]:
    """All findings, in the order of file and line. `ConfigError` for a file that is neither `.dbc` nor `.toml`."""
    if path.suffix == ".dbc":
        found = _of_dbc(path)
    elif path.suffix == ".toml":
        found = _of_profile(path)
    else:
        raise ConfigError(f"{path}: must end in .dbc or .toml")
    return sorted(set(found))


MOST_BITS = 512
"""Of the longest FD frame."""


def _of_dbc(path: Path) -> list[LintFinding]:
    file, errors = inspect_dbc(path)
    found = [_located(str(error), {path.name: path}) for error in errors]
    if file is not None:
        found += _of_content(path, file)
        found += _for_nobody(path, file)
    return found


def _of_profile(path: Path) -> list[LintFinding]:
    try:
        profile, faults, warnings = inspect_profile(path)
    except ConfigError as error:
        return [_located(str(error), {path.name: path})]
    lines = _TomlLines(path)
    found = [lines.finding(fault, ERROR) for fault in faults]
    found += (lines.finding(warning, WARNING) for warning in warnings)
    if profile is None:
        dbc = lines.dbc()
        return found if dbc is None else [*found, *_of_dbc(dbc)]
    return [*found, *_of_pair(path, profile, lines)]


def _of_pair(path: Path, profile: Profile, lines: "_TomlLines") -> list[LintFinding]:
    """Of the DBC, and of the two together."""
    dbc = (
        path.parent / Path(profile.dbc).name if path.parent.resolve() == Path(profile.dbc).parent else Path(profile.dbc)
    )
    file, errors = inspect_dbc(dbc)
    if file is None:
        return [_located(str(error), {dbc.name: dbc}) for error in errors]
    found = list(_of_content(dbc, file))
    binding = Binding(profile, file)
    for error in [*errors, *find_faults(binding)]:
        text = str(error)
        if text.startswith(f"{path.name}: "):
            found.append(lines.finding(text.removeprefix(f"{path.name}: "), ERROR))
        else:
            found.append(_located(text, {dbc.name: dbc}))
    found += (lines.finding(text, WARNING) for text in describe_missing(profile))
    return [*found, *_for_control(dbc, binding)]


def _located(text: str, files: dict[str, Path]) -> LintFinding:
    """An error's text taken apart: `FILE:LINE: …`, `FILE: …` or `PATH: …`."""
    for name, path in files.items():
        for known in (name, str(path)):
            match = re.match(rf"{re.escape(known)}(?::(\d+))?: ", text)
            if match:
                rest = text[match.end() :]
                return LintFinding(str(path), int(match[1] or _line_in(rest, path)), ERROR, rest)
    return LintFinding(next(iter(map(str, files.values()))), 0, ERROR, text)


def _line_in(text: str, path: Path) -> int:
    """The line that tomllib's words name."""
    if "(at end of document)" in text:
        return max(1, len(path.read_text(encoding="utf-8").splitlines()))
    stated = re.search(r"\(at line (\d+)", text)
    return int(stated[1]) if stated else 0


# --- what needs no profile


def _of_content(path: Path, file: DbcFile) -> Iterator[LintFinding]:
    """Bits and ranges of every message."""
    for message in file.database.messages:
        yield from _bit_findings(path, file, message)
        for signal in message.signals:
            text = _range_beyond_bits(signal)
            if text:
                yield _finding(path, file, message, signal, WARNING, text)


def _bit_findings(path: Path, file: DbcFile, message: Message) -> Iterator[LintFinding]:
    """Signals beyond their message, and signals on the bits of another one."""
    taken: list[tuple[Signal, frozenset[int]]] = []
    for signal in message.signals:
        bits = frozenset(bits_of(signal))
        if max(bits, default=0) >= 8 * message.length or min(bits, default=0) < 0:
            text = f"bits {signal.start}|{signal.length} do not fit into {message.length} bytes"
            yield _finding(path, file, message, signal, ERROR, text)
        for other, others in taken:
            if bits & others and not _apart(message, signal, other):
                yield _finding(path, file, message, signal, ERROR, f"overlapping: shares bits with {other.name}")
        taken.append((signal, bits))


def _apart(message: Message, one: Signal, other: Signal) -> bool:
    """Whether some multiplexer never shows both."""
    ids = dict(_multiplexers(message, one))
    return any(name in ids and not ids[name] & shown for name, shown in _multiplexers(message, other))


def _multiplexers(message: Message, signal: Signal) -> Iterator[tuple[str, frozenset[int]]]:
    """Each multiplexer that the signal depends on, with the ids that show it."""
    by_name = {one.name: one for one in message.signals}
    seen: set[str] = set()
    while signal.multiplexer_signal in by_name and signal.multiplexer_signal not in seen:
        seen.add(signal.multiplexer_signal)
        yield signal.multiplexer_signal, frozenset(signal.multiplexer_ids or ())
        signal = by_name[signal.multiplexer_signal]


def _range_beyond_bits(signal: Signal) -> str:
    """A range whose ends the bits cannot express; empty where they can."""
    if signal.is_float or signal.minimum is None or signal.maximum is None or not signal.scale:
        return ""
    if signal.length > MOST_BITS:
        return f"{signal.length} bits: a frame has {MOST_BITS} at most"
    least = -(1 << signal.length - 1) if signal.is_signed else 0
    most = (1 << signal.length - bool(signal.is_signed)) - 1
    low, high = sorted(raw * signal.scale + signal.offset for raw in (least, most))
    step = abs(signal.scale) * 1e-6
    if low - step <= signal.minimum and signal.maximum <= high + step:
        return ""
    return f"range [{signal.minimum}|{signal.maximum}]: {signal.length} bits express [{low:.10g}|{high:.10g}]"


def _for_nobody(path: Path, file: DbcFile) -> Iterator[LintFinding]:
    """Findings that matter if the signal is used, which only a profile can tell."""
    for message in file.database.messages:
        yield from _cycle_findings(path, file, message)
        yield from _impossible(path, file, message)
        for signal in message.signals:
            if signal.length > 1 and not signal.choices and (signal.minimum is None or signal.maximum is None):
                yield _finding(path, file, message, signal, WARNING, "no range")
            yield from _unit_findings(path, file, message, signal)


def _cycle_findings(path: Path, file: DbcFile, message: Message) -> Iterator[LintFinding]:
    if not message.cycle_time:
        yield LintFinding(str(path), file.lines.get(message.name, 0), WARNING, f"{message.name}: no cycle time")


def _impossible(path: Path, file: DbcFile, message: Message) -> Iterator[LintFinding]:
    """Ranges without a value, and messages that cannot be compiled."""
    try:
        fields = Layout.of(message).fields
    except ConfigError as error:
        yield LintFinding(str(path), file.lines.get(message.name, 0), ERROR, str(error))
        return
    for field, signal in zip(fields, message.signals, strict=True):
        upside_down = field.minimum is not None and field.maximum is not None and field.minimum > field.maximum
        if not field.is_float and field.scale and not upside_down and field.allowed_raw()[0] > field.allowed_raw()[1]:
            text = f"no value lies in its range [{field.minimum}|{field.maximum}]"
            yield _finding(path, file, message, signal, ERROR, text)


def _unit_findings(path: Path, file: DbcFile, message: Message, signal: Signal) -> Iterator[LintFinding]:
    """Units that are not known, and scaled numbers without one."""
    if signal.unit and find_unit(signal.unit) is None:
        yield _finding(path, file, message, signal, WARNING, f"unit {signal.unit!r} is not known")
    elif not signal.unit and (signal.scale != 1 or signal.is_float):
        yield _finding(path, file, message, signal, WARNING, "a scaled number without a unit")


# --- what needs one


def _for_control(path: Path, binding: Binding) -> Iterator[LintFinding]:
    """Warnings: the program drives with these."""
    file = binding.file
    for name, role in binding.roles.items():
        if role in PERIODS:
            yield from _cycle_findings(path, file, binding.messages[name])
        if role in (Role.SAMPLE, Role.COMMAND) and (gap := describe_gap(binding, name)):
            yield LintFinding(str(path), file.lines.get(name, 0), WARNING, f"{name}: {gap}")
    for dotted, text in describe_unknown_names(binding):
        yield LintFinding(str(path), file.lines.get(dotted, 0), WARNING, f"{dotted}: {text}")


def _finding(path: Path, file: DbcFile, message: Message, signal: Signal, severity: str, text: str) -> LintFinding:
    dotted = f"{message.name}.{signal.name}"
    return LintFinding(str(path), file.lines.get(dotted, 0), severity, f"{dotted}: {text}")


class _TomlLines:
    """The lines of a profile's keys: enough of TOML for files that people write, key by key below table headers."""

    _HEADER = re.compile(r"\s*(\[?)\[([^\[\]]+)\]")
    _KEY = re.compile(r'\s*("[^"]*"|[\w.-]+)\s*=')

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lines: dict[str, int] = {"$": 0}
        self._dbc = ""
        table, rows = "$", dict[str, int]()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if header := self._HEADER.match(line):
                table = f"$.{header[2].strip()}"
                first = table.split(".")[1]
                if header[1]:
                    rows[first] = rows.get(first, -1) + 1
                if first in rows:
                    table = table.replace(first, f"{first}[{rows[first]}]", 1)
                self._lines.setdefault(table, number)
            elif key := self._KEY.match(line):
                self._lines.setdefault(f"{table}.{key[1].strip(chr(34))}", number)
                if table == "$" and key[1] == "dbc" and (value := re.search(r"=\s*[\"']([^\"']+)[\"']", line)):
                    self._dbc = value[1]

    def finding(self, fault: str, severity: str) -> LintFinding:
        """`$.place: text` with the line of the place, or of the nearest table around it."""
        place = fault.partition(": ")[0]
        known = place
        while known not in self._lines and ("." in known or known.endswith("]")):
            known = known[: max(known.rfind("."), known.rfind("["))]
        return LintFinding(str(self._path), self._lines.get(known, 0), severity, fault)

    def dbc(self) -> Path | None:
        """The DBC that the profile names, where it can be read from a profile that is not whole."""
        return self._path.parent / self._dbc if self._dbc.endswith(".dbc") else None
