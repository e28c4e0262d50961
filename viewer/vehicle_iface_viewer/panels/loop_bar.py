"""The top of the page: which loop is shown, and those that can be chosen.

Each choice is a link to this page with another query, so that a choice can be kept, opened in a second window and sent
on. No message of a browser is handled for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from urllib.parse import urlencode

from vehicle_iface.telemetry import SessionInfo
from vehicle_iface_viewer.loops import KnownLoop
from vehicle_iface_viewer.panels.colors import GREY, state_color
from vehicle_iface_viewer.panels.text import css, plain
from vehicle_iface_viewer.panels.words import find_headline
from vehicle_iface_viewer.scene.companion import COMPANION_COLOR

LOOP, BESIDE = "loop", "beside"
"""Names in the query: the address of the loop to show, and that of a second one whose vehicle is drawn, too."""
_SILENT_AFTER_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Beside:
    """The second loop."""

    address: str
    hindrance: str
    """Why its vehicle is not drawn; empty if it is."""


def shown_html(
    address: str, info: SessionInfo | None, known: Iterable[KnownLoop] = (), beside: Beside | None = None
) -> str:
    """Return the name of the loop that is shown, and the others if there are any; `beside` is shown as well."""
    facts = "" if info is None else f" <span>{_facts(info)}</span>"
    others = [one for one in known if one.loop.address != address]
    rows = "".join(_row(one) + _beside_link(address, one.loop.address, beside) for one in others)
    head = "<div>other loops on this machine:</div>" if others else ""
    return f'<div id="loop" class="vi-loops"><b>{plain(address)}</b>{facts}{_describe(beside)}{head}{rows}</div>'


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


def _describe(beside: Beside | None) -> str:
    if beside is None:
        return ""
    words = f"not drawn: {plain(beside.hindrance)}" if beside.hindrance else "drawn beside it, display only"
    color = css(COMPANION_COLOR)
    return f'<div id="beside"><i style="background:{color}"></i><b>{plain(beside.address)}</b> {words}</div>'


def _beside_link(shown: str, address: str, beside: Beside | None) -> str:
    if beside is not None and beside.address == address:
        return f'<div class="vi-beside"><a href="?{urlencode({LOOP: shown})}">take it out of the picture</a></div>'
    query = plain(urlencode({LOOP: shown, BESIDE: address}))
    return f'<div class="vi-beside"><a href="?{query}">draw its vehicle beside this one</a></div>'


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
