"""The table of all messages on the buses, with their signals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from vehicle_iface_viewer.bus_table.report import BusReport, MessageRow, SignalValue
from vehicle_iface_viewer.panels.text import plain

_MAX_ROWS, _MAX_SIGNALS = 80, 400
"""More are not shown: a filter finds them."""
_LATE_PERIODS = 3.0
_OTHER_RATE = 0.1
"""Part of the expected rate by which a rate may differ."""


def signals_html(report: BusReport | None, search: str = "") -> str:
    """Return the table, faulty messages first; only messages and signals whose names contain `search`."""
    if report is None:
        return '<div class="vi-note">the listener is starting</div>'
    rows = [row for row in report.rows if _matches(row, search)]
    rows.sort(key=lambda row: not is_faulty(row))  # stable: otherwise in the listener's order
    parts = [_notes(report, len(rows), search)]
    left = _MAX_SIGNALS
    for row in rows[:_MAX_ROWS]:
        shown = [each for each in row.signals if _names(row, search) or search.lower() in each.name.lower()][:left]
        left -= len(shown)
        parts.append(_message(row, shown))
    if len(rows) > _MAX_ROWS or left <= 0:
        parts.append('<div class="vi-note">more, not shown: filter them</div>')
    return f'<div id="signals" class="vi-signals">{"".join(parts)}</div>'


def is_faulty(row: MessageRow) -> bool:
    """Whether frames are dropped, late, of another rate than expected, or carry a value out of range."""
    return bool(row.error_count) or _is_late(row) or _is_other_rate(row) or any(s.is_out_of_range for s in row.signals)


def _is_late(row: MessageRow) -> bool:
    return row.expected_hz is not None and row.age_s * row.expected_hz > _LATE_PERIODS


def _is_other_rate(row: MessageRow) -> bool:
    return row.expected_hz is not None and abs(row.rate_hz - row.expected_hz) > _OTHER_RATE * row.expected_hz


def _names(row: MessageRow, search: str) -> bool:
    """Whether the message itself is meant."""
    words = f"{row.bus} {row.can_id} {row.name or 'unknown'}".lower()
    return search.lower() in words


def _matches(row: MessageRow, search: str) -> bool:
    return _names(row, search) or any(search.lower() in each.name.lower() for each in row.signals)


def _notes(report: BusReport, shown: int, search: str) -> str:
    def notes() -> Iterator[str]:
        if report.note:
            yield f'<div class="vi-note" id="no-frames">{plain(report.note)}</div>'
            return
        if report.problem:
            yield f'<div class="vi-note vi-bad" id="listener-problem">{plain(report.problem)}</div>'
        if report.lost:
            yield f'<div class="vi-note vi-bad">{report.lost} frames were lost by this viewer, not by the bus</div>'
        if report.error_frames:
            yield f'<div class="vi-note vi-bad">{report.error_frames} error frames</div>'
        if report.unlisted:
            yield f'<div class="vi-note">{report.unlisted} frames of further identifiers</div>'
        of = f"{shown} of {len(report.rows)} messages" if search else f"{len(report.rows)} messages"
        yield f'<div class="vi-note">{of} · {report.frames} frames · ▲ sent by the loop</div>'

    return "".join(notes())


def _message(row: MessageRow, signals: Iterable[SignalValue]) -> str:
    faulty = " vi-faulty" if is_faulty(row) else ""
    bus = f"{plain(row.bus)} " if row.bus else ""
    name = plain(row.name) if row.name else "in no DBC"
    expected = "" if row.expected_hz is None else f"<i>/{row.expected_hz:.4g}</i>"
    rate = f'<b{_bad(is_bad=_is_other_rate(row))} data-rate="{row.rate_hz:.2f}">{row.rate_hz:.1f}{expected} Hz</b>'
    age = f"<span{_bad(is_bad=_is_late(row))}>age {_duration(row.age_s)}</span>"
    facts = [age]
    if row.jitter_s is not None:
        facts.append(f"jitter {_duration(row.jitter_s)}")
    if row.counter is not None:
        facts.append(f"counter {row.counter}")
    facts += [f"<span{_bad(is_bad=True)}>{count} × {plain(cause)}</span>" for cause, count in row.errors.items()]
    body = "".join(map(_signal, signals)) or f'<div class="vi-data">{plain(row.data or "no data")}</div>'
    can_id = plain(row.can_id)
    return (
        f'<div class="vi-message{faulty}" data-id="{can_id}" data-frames="{row.frames}"><div class="vi-head">'
        f"<span>{'▲' if row.is_sent else '▼'} {bus}{can_id} <b>{name}</b></span>{rate}</div>"
        f'<div class="vi-facts">{" · ".join(facts)}</div>{body}</div>'
    )


def _signal(signal: SignalValue) -> str:
    kinds = [name for name, applies in (("vi-bad", signal.is_out_of_range), ("vi-old", signal.is_absent)) if applies]
    marks = f' class="{" ".join(kinds)}"' if kinds else ""
    changed = ' class="vi-new"' if signal.has_changed else ""
    unit = f" <i>{plain(signal.unit)}</i>" if signal.unit and not signal.is_named else ""
    return f"<div{marks}><span>{plain(signal.name)}</span><span{changed}>{plain(signal.value)}{unit}</span></div>"


def _bad(*, is_bad: bool) -> str:
    return ' class="vi-bad"' if is_bad else ""


def _duration(seconds: float) -> str:
    return f"{seconds * 1e3:.1f} ms" if seconds < 1.0 else f"{seconds:.1f} s"
