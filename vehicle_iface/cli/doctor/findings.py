"""The diagnostics of `vehicle-iface doctor`, and their output as text and JSON."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path


class Verdict(StrEnum):
    """The result of one check."""

    OK = "ok"
    WARN = "warn"
    """It works, but not as well as it could, or not in the tested version."""
    MISSING = "missing"
    """It is required, but absent or unusable."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """The result of one check, with a text and a command."""

    subject: str
    verdict: Verdict
    text: str
    fix: str = ""
    """A command that fixes the problem or shows more; empty if there is none."""

    def __str__(self) -> str:
        fix = f"; try `{self.fix}`" if self.fix else ""
        return f"{self.verdict:<8} {self.subject:<14} {self.text}{fix}"


def as_text(diagnostics: Iterable[Diagnostic]) -> str:
    """Return one line for each diagnostic, and the number of errors and warnings."""
    lines = [str(diagnostic) for diagnostic in diagnostics]
    missing = sum(line.startswith(Verdict.MISSING) for line in lines)
    warned = sum(line.startswith(Verdict.WARN) for line in lines)
    return "\n".join([*lines, f"{_count(missing, 'error')}, {_count(warned, 'warning')}"])


def _count(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def as_json(diagnostics: Iterable[Diagnostic]) -> str:
    """Return the diagnostics as JSON."""
    kept = tuple(diagnostics)
    return json.dumps({"is_ready": is_ready(kept), "findings": [asdict(diagnostic) for diagnostic in kept]}, indent=2)


def is_ready(diagnostics: Iterable[Diagnostic]) -> bool:
    """Whether nothing required is missing."""
    return all(diagnostic.verdict is not Verdict.MISSING for diagnostic in diagnostics)


def ok(subject: str, text: str) -> Diagnostic:
    """Build a diagnostic without a problem."""
    return Diagnostic(subject=subject, verdict=Verdict.OK, text=text)


def warn(subject: str, text: str, fix: str) -> Diagnostic:
    """Build a diagnostic about something that works but could be better."""
    return Diagnostic(subject=subject, verdict=Verdict.WARN, text=text, fix=fix)


def missing(subject: str, text: str, fix: str) -> Diagnostic:
    """Build a diagnostic about something that must be fixed."""
    return Diagnostic(subject=subject, verdict=Verdict.MISSING, text=text, fix=fix)


def read_text(path: str | Path) -> str:
    """Return the text of a file; empty if it cannot be read."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError:
        return ""
