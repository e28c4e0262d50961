"""Finds everything in a DBC or profile that is wrong for control use, with its line: `vehicle-iface check-dbc FILE`.

An error prevents driving, a warning should be looked at. A `.toml` profile is checked together with its DBC. Faults in
what the profile does not use are only warnings, and many warnings of one kind are summarised. A `.dbc` alone is checked
without knowing which signals are used.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from vehicle_iface.codec.binding import PERIODS, Binding, Role
from vehicle_iface.codec.bus_files import read_dbcs
from vehicle_iface.codec.consistency import find_faults
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.codec.dbc_findings import ERROR, WARNING, DbcFinding
from vehicle_iface.codec.dbc_lint import (
    find_cycle_doubts,
    find_doubts,
    find_range_doubts,
    message_finding,
)
from vehicle_iface.codec.enumerations import describe_unknown_names
from vehicle_iface.codec.protection_faults import describe_gap
from vehicle_iface.codec.usage import Usage
from vehicle_iface.errors import ConfigError
from vehicle_iface.motion_sources import describe_missing
from vehicle_iface.profile import FaultyPlaces, Profile, inspect_profile
from vehicle_iface.profile.forms import FieldForm, signals_of

_MOST_OF_A_KIND = 5
"""If an unused part has more warnings of one kind than this, they are summarised."""
_EXAMPLES = 3
_OF_EITHER_SIGN = ("accel_mps2", "yaw_rate_radps", "lateral_speed_mps", "front_wheel_angle_rad")


@dataclass(frozen=True, slots=True, order=True)
class LintFinding:
    """One fault or oddity."""

    file: str
    line: int
    """The line, from 1; 0 if the fault has no line of its own."""
    severity: str
    """`error` or `warning`."""
    text: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        return f"{place}: {self.severity}: {self.text}"


def check_file(path: Path) -> list[LintFinding]:
    """Return all findings, in the order of file and line.

    Raises `ConfigError` for a file that is neither `.dbc` nor `.toml`.
    """
    if path.suffix.lower() == ".dbc":
        found = _of_dbc(path)
    elif path.suffix.lower() == ".toml":
        found = _of_profile(path)
    else:
        raise ConfigError(f"{path}: must end in .dbc or .toml")
    return sorted(set(found))


def _of_dbc(path: Path) -> list[LintFinding]:
    try:
        file = read_dbc(path)
    except ConfigError as error:
        return [_located(line, {path.name: path}) for line in str(error).splitlines()]
    return list(_present(path, [*file.findings, *find_range_doubts(file), *find_doubts(file)], None))


def _of_profile(path: Path) -> list[LintFinding]:
    try:
        profile, faults, warnings, faulty = inspect_profile(path)
    except ConfigError as error:
        return [_located(str(error), {path.name: path})]
    lines = _TomlLines(path)
    found = [lines.finding(fault, ERROR) for fault in faults]
    found += (lines.finding(warning, WARNING) for warning in warnings)
    if profile is None:
        return [*found, *(finding for dbc in lines.dbcs() for finding in _of_dbc(dbc))]
    return [*found, *_of_pair(path, profile, lines, faulty)]


def _of_pair(path: Path, profile: Profile, lines: "_TomlLines", faulty: FaultyPlaces) -> list[LintFinding]:
    """Return the findings about a profile and its DBCs, without those that follow from the places in `faulty`."""
    dbcs = {name: _shorten(Path(bus.dbc), path.parent) for name, bus in profile.all_buses.items()}
    paths = {dbc.name: dbc for dbc in dbcs.values()}
    try:
        file = read_dbcs(profile)
    except ConfigError as error:
        return [_located(line, paths) for line in str(error).splitlines()]
    binding = Binding(profile, file)
    usage, control = Usage(binding), list(_control_doubts(binding))
    found: list[LintFinding] = []
    for name, dbc in dbcs.items():
        part = file.parts.get(name, file)
        doubts = [*part.findings, *find_range_doubts(part)]
        doubts += [doubt for doubt in control if file.part_of(doubt.message) is part]
        found += _present(dbc, doubts, usage)
    for text in map(str, find_faults(binding)):
        if text.startswith(f"{path.name}: "):
            fault = text.removeprefix(f"{path.name}: ")
            found += [lines.finding(fault, ERROR)] if not faulty.explain(fault) else []
        else:
            found.append(_located(text, paths))
    return [*found, *(lines.finding(text, WARNING) for text in describe_missing(binding.profile))]


def _shorten(dbc: Path, folder: Path) -> Path:
    """Write the path of a DBC relative to its profile, in the way the profile's path is written."""
    return folder / dbc.name if folder.resolve() == dbc.parent else dbc


def _present(path: Path, findings: Iterable[DbcFinding], usage: Usage | None) -> Iterator[LintFinding]:
    """Yield the findings about a DBC. With a profile, those about unused parts are warnings, and many of one kind are
    summarised."""
    unused: dict[str, list[DbcFinding]] = {}
    for finding in sorted(findings, key=lambda finding: finding.line):
        is_used = usage is not None and usage.concerns(finding)
        if is_used or (usage is None and finding.severity == ERROR):
            yield LintFinding(str(path), finding.line, finding.severity, finding.text)
        else:
            unused.setdefault(finding.kind, []).append(finding)
    for kind, group in unused.items():
        if len(group) > _MOST_OF_A_KIND:
            examples = (f"{one.about[0] if one.about else one.text} (line {one.line})" for one in group[:_EXAMPLES])
            text = f"{kind}: {len(group)} times; first: {', '.join(examples)}"
            yield LintFinding(str(path), group[0].line, WARNING, text)
        else:
            yield from (LintFinding(str(path), one.line, WARNING, one.text) for one in group)


def _located(text: str, files: dict[str, Path]) -> LintFinding:
    """Split an error's text into file, line and message: `FILE:LINE: …`, `FILE: …` or `PATH: …`."""
    for name, path in files.items():
        for known in (name, str(path)):
            match = re.match(rf"{re.escape(known)}(?::(\d+))?: ", text)
            if match:
                rest = text[match.end() :]
                return LintFinding(str(path), int(match[1] or _line_in(rest, path)), ERROR, rest)
    return LintFinding(next(iter(map(str, files.values()))), 0, ERROR, text)


def _line_in(text: str, path: Path) -> int:
    """Return the line that tomllib's message names."""
    if "(at end of document)" in text:
        return max(1, len(path.read_text(encoding="utf-8").splitlines()))
    stated = re.search(r"\(at line (\d+)", text)
    return int(stated[1]) if stated else 0


def _control_doubts(binding: Binding) -> Iterator[DbcFinding]:
    """Yield warnings that do not prevent driving."""
    file = binding.file
    for name, role in binding.roles.items():
        if role in PERIODS:
            yield from find_cycle_doubts(file, binding.messages[name], binding.cycle_ms(name))
        if role in (Role.SAMPLE, Role.COMMAND) and (gap := describe_gap(binding, name)):
            yield message_finding(file, name, WARNING, gap, "no protection")
    for dotted, text in describe_unknown_names(binding):
        yield message_finding(file, dotted, WARNING, text, "names without a meaning")
    for dotted, text in _describe_one_sided(binding):
        yield message_finding(file, dotted, WARNING, text, "one sign only")


def _describe_one_sided(binding: Binding) -> Iterator[tuple[str, str]]:
    """Yield MESSAGE.SIGNAL and a warning for a signed field whose signal has only one sign: another signal may carry
    the sign."""
    for field in _OF_EITHER_SIGN:
        form = getattr(binding.profile.state.signals, field)
        if isinstance(form, FieldForm) and form.negative_if is not None:
            continue
        names = [dotted for dotted in signals_of(form) if binding.find_signal(dotted) is not None]
        ranges = [binding.view(dotted).field_range for dotted in names]
        if ranges and (all(low >= 0.0 for low, _ in ranges) or all(high <= 0.0 for _, high in ranges)):
            sign = "negative" if ranges[0][0] >= 0.0 else "positive"
            yield names[0], f"{field} is never {sign}; where another signal carries the sign, give negative_if"


class _TomlLines:
    """Finds the lines of a profile's keys. It reads as much TOML as people write: keys below table headers."""

    _HEADER = re.compile(r"\s*(\[?)\[([^\[\]]+)\]")
    _KEY = re.compile(r'\s*("[^"]*"|[\w.-]+)\s*=')

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lines: dict[str, int] = {"$": 1}
        self._dbcs: list[str] = []
        table, rows = "$", dict[str, int]()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if header := self._HEADER.match(line):
                table = f"$.{header[2].strip().replace(chr(34), '')}"
                first = table.split(".")[1]
                if header[1]:
                    self._add(f"$.{first}", number)
                    rows[first] = rows.get(first, -1) + 1
                if first in rows:
                    table = table.replace(first, f"{first}[{rows[first]}]", 1)
                self._add(table, number)
            elif key := self._KEY.match(line):
                self._add(f"{table}.{key[1].strip(chr(34))}", number)
                is_bus = table == "$" or table.startswith("$.buses.")
                if is_bus and key[1] == "dbc" and (value := re.search(r"=\s*[\"']([^\"']+)[\"']", line)):
                    self._dbcs.append(value[1])

    def _add(self, place: str, number: int) -> None:
        """Record the line of a place, also under its name without buses where that is unambiguous."""
        for known in (place, re.sub(r"\b\w+:(?=\w)", "", place)):
            self._lines.setdefault(known, number)

    def finding(self, fault: str, severity: str) -> LintFinding:
        """Convert `$.place: text` to a finding with the line of the place, or of the nearest table around it."""
        place = fault.partition(": ")[0]
        known = place
        while known not in self._lines and ("." in known or known.endswith("]")):
            known = known[: max(known.rfind("."), known.rfind("["))]
        return LintFinding(str(self._path), self._lines.get(known, 0), severity, fault)

    def dbcs(self) -> list[Path]:
        """Return the DBCs that the profile names, if they can be read from an invalid profile."""
        return [self._path.parent / name for name in self._dbcs if name.lower().endswith(".dbc")]
