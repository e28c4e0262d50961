"""The instants at which checks failed, for the time line and the plots."""

import re
from collections.abc import Iterable

from hil_bench.result import Check, Event, EventKind, Verdict

_AT_BEGIN = re.compile(r"^(-?\d+\.\d+) s\b")
_INSIDE = re.compile(r"\b(?:at|after) (-?\d+\.\d+) s\b")
LONGEST = 120
"""Characters of an event's text."""


def find_violations(checks: Iterable[Check]) -> list[Event]:
    """The first dated finding of each failed check."""
    return [event for check in checks for event in _violations_of(check)[:1]]


def mark_overdue(check: Check, since_s: float) -> list[Event]:
    """The instant at which a reaction was due that came late or never: its limit (ms) after `since_s`."""
    if check.verdict is not Verdict.FAIL or check.limit is None or check.unit != "ms":
        return []
    is_late = check.measured is None or check.measured > check.limit
    return [_event(since_s + check.limit / 1e3, f"{check.text}: overdue")] if is_late else []


def _violations_of(check: Check) -> list[Event]:
    if check.verdict is not Verdict.FAIL:
        return []
    dated = ((found, _AT_BEGIN.search(found) or _INSIDE.search(found)) for found in check.found)
    return [_event(float(match[1]), f"{check.text}: {found}") for found, match in dated if match]


def _event(at_s: float, text: str) -> Event:
    short = text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
    return Event(at_s=round(at_s, 3), kind=EventKind.VIOLATION, text=short)
