"""The diagnostics of `vehicle-iface doctor`, and how they are shown."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path


class Verdict(StrEnum):
    """How the machine stands in one respect."""

    OK = "ok"
    WARN = "warn"
    """Works, but not as well as it could, or not as it was tested."""
    MISSING = "missing"
    """Needed, and not there or not usable."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """The state of one thing."""

    subject: str
    verdict: Verdict
    text: str
    fix: str = ""
    """A command line that fixes it or shows more; empty where all is well."""

    def __str__(self) -> str:
        fix = f"; try `{self.fix}`" if self.fix else ""
        return f"{self.verdict:<8} {self.subject:<14} {self.text}{fix}"


def as_text(diagnostics: Iterable[Diagnostic]) -> str:
    """One line for each, and the number of errors and warnings."""
    lines = [str(diagnostic) for diagnostic in diagnostics]
    missing = sum(line.startswith(Verdict.MISSING) for line in lines)
    warned = sum(line.startswith(Verdict.WARN) for line in lines)
    return "\n".join([*lines, f"{_count(missing, 'error')}, {_count(warned, 'warning')}"])


def _count(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def as_json(diagnostics: Iterable[Diagnostic]) -> str:
    """The same as JSON, for programs."""
    kept = tuple(diagnostics)
    return json.dumps({"is_ready": is_ready(kept), "findings": [asdict(diagnostic) for diagnostic in kept]}, indent=2)


def is_ready(diagnostics: Iterable[Diagnostic]) -> bool:
    """Whether nothing needed is missing."""
    return all(diagnostic.verdict is not Verdict.MISSING for diagnostic in diagnostics)


def ok(subject: str, text: str) -> Diagnostic:
    """All is well."""
    return Diagnostic(subject=subject, verdict=Verdict.OK, text=text)


def warn(subject: str, text: str, fix: str) -> Diagnostic:
    """Works, but could be better."""
    return Diagnostic(subject=subject, verdict=Verdict.WARN, text=text, fix=fix)


def missing(subject: str, text: str, fix: str) -> Diagnostic:
    """Must be fixed."""
    return Diagnostic(subject=subject, verdict=Verdict.MISSING, text=text, fix=fix)


def read_text(path: str | Path) -> str:
    """The text there; empty where there is none."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError:
        return ""
