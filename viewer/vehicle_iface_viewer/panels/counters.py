"""The table of counters."""

from __future__ import annotations

from typing import Any

import msgspec

from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.text import plain


def counters_html(view: View) -> str:
    """Return the table of counters with the loop's names, nested names joined."""
    rows = "".join(
        f'<tr><td style="opacity:.75">{plain(name)}</td><td style="text-align:right">{plain(value)}</td></tr>'
        for name, value in _flat("", msgspec.to_builtins(view.details) or {}, depth=0)
    )
    if not rows:
        return '<div style="margin:4px 8px;font-size:12px;opacity:.75">no counters yet</div>'
    return (
        '<table id="details" style="width:calc(100% - 22px);margin:2px 14px 2px 8px;font-size:12px;'
        f'font-variant-numeric:tabular-nums">{rows}</table>'
    )


def _flat(prefix: str, value: Any, *, depth: int, limit: int = 100) -> list[tuple[str, object]]:
    """Yield at most `limit` leaves of nested counters."""
    if not isinstance(value, dict) or depth > 4:
        return [(prefix, f"{value:.6g}" if isinstance(value, float) else value)]
    found: list[tuple[str, object]] = []
    for name, inner in value.items():
        if len(found) >= limit:
            return [*found[: limit - 1], ("…", "more, not shown")]
        found += _flat(f"{prefix} · {name}" if prefix else str(name), inner, depth=depth + 1, limit=limit)
    return found
