"""The list of the loop's events, the newest first."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.panels.text import plain

_MAX_ROWS = 100
_COLORS = {
    EventKind.MODE: "#4dabf7",
    EventKind.STOP: "#ff922b",
    EventKind.LIMIT: "#f06595",
    EventKind.LINK: "#ff922b",
    EventKind.DEADLINE: "#ff922b",
    EventKind.FAULT: "#ff6b6b",
}


def events_html(events: Sequence[LoopEvent], wall_offset_ns: int) -> str:
    """Return the table; `wall_offset_ns` is added to an event's time to get that of the wall clock."""
    if not events:
        return '<div class="vi-note" id="events">no event yet</div>'
    rows = "".join(_row(event, wall_offset_ns) for event in list(events)[: -_MAX_ROWS - 1 : -1])
    more = f" of {len(events)}, the newest first" if len(events) > _MAX_ROWS else ", the newest first"
    note = f'<div class="vi-note">{min(len(events), _MAX_ROWS)} events{more}; times are UTC</div>'
    return f'<div id="events">{note}{rows}</div>'


def _row(event: LoopEvent, wall_offset_ns: int) -> str:
    at = datetime.fromtimestamp((event.at_ns + wall_offset_ns) / NS_PER_S, UTC)
    color = _COLORS.get(event.kind, "#868e96")
    phase = f" {event.phase}" if event.phase is not Phase.ONCE else ""
    text = f'<div style="opacity:.8">{plain(event.text)}</div>' if event.text else ""
    return (
        f'<div class="vi-event" style="border-left:3px solid {color}"><span>{at:%H:%M:%S}.{at.microsecond // 1000:03d}'
        f"</span><div><b>{event.kind}</b> {plain(event.name)}{phase}{text}</div></div>"
    )
