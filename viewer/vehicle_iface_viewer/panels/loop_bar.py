"""The top of the page: which loop is shown, and those that can be chosen.

Each choice is a link to this page with another query, so that a choice can be kept, opened in a second window and sent
on. No message of a browser is handled for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from urllib.parse import urlencode

from vehicle_iface.telemetry import SessionInfo
from vehicle_iface_viewer.loops import KnownLoop
from vehicle_iface_viewer.panels.colors import GREY, state_color
from vehicle_iface_viewer.panels.text import plain
from vehicle_iface_viewer.panels.words import find_headline

LOOP = "loop"
"""Name in the query: the address of the loop to show."""
_SILENT_AFTER_S = 1.0


def shown_html(address: str, info: SessionInfo | None, known: Iterable[KnownLoop] = ()) -> str:
    """Return the name of the loop that is shown, and the others if there are any."""
    facts = "" if info is None else f" <span>{_facts(info)}</span>"
    others = [one for one in known if one.loop.address != address]
    rows = f"<div>other loops on this machine:</div>{''.join(map(_row, others))}" if others else ""
    return f'<div id="loop" class="vi-loops"><b>{plain(address)}</b>{facts}{rows}</div>'


def choice_html(known: Iterable[KnownLoop], wanted: str | None = None) -> str:
    """Return the list of all loops, of which none is shown."""
    rows = "".join(map(_row, known)) or "<div>No loop is running: the page waits for one.</div>"
    missing = f"<div>The loop {plain(wanted)} is not running.</div>" if wanted is not None else ""
    return f'<div id="loop" class="vi-loops"><b>CHOOSE A LOOP</b>{missing}{rows}</div>'


def _row(one: KnownLoop) -> str:
    loop = one.loop
    color, words = _state(one)
    return (
        f'<div class="vi-loop"><i style="background:{color}">{words}</i> '
        f'<a href="?{urlencode({LOOP: loop.address})}">{plain(loop.address)}</a> {_facts(loop.info)}</div>'
    )


def _state(one: KnownLoop) -> tuple[str, str]:
    newest = one.loop.newest
    if one.has_ended:
        return GREY, "ENDED"
    if newest is None or one.loop.age_s > _SILENT_AFTER_S:
        return GREY, "NO DATA"
    return state_color(newest.controller_state, newest.reason), find_headline(newest)


def _facts(info: SessionInfo) -> str:
    return " · ".join(_list_facts(info))


def _list_facts(info: SessionInfo) -> Iterator[str]:
    if info.profile:
        yield plain(info.profile)
    yield plain(info.channel)
    if info.pid:
        yield f"pid {info.pid}"
