"""The strips of a running loop: the last 30 s below the banner, the last ten minutes above the plots.

Each browser has a slider over each of them (`plot_time`), which the style sheet makes as large as the strip.
"""

from __future__ import annotations

import viser

from vehicle_iface.units import ns_from_s
from vehicle_iface_viewer.feed import Feed, View
from vehicle_iface_viewer.panels.plot_time import BACK_S, ORDER, RECENT_ORDER, RECENT_S
from vehicle_iface_viewer.panels.strip import Span, strip_html

_RECENT_EVERY, _LONG_EVERY = 3, 20
"""Turns of a tenth of a second."""


class LiveStrips:
    """Shared by all browsers."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._recent = gui.add_html("", order=RECENT_ORDER - 0.01)
        self._long = gui.add_html("", order=ORDER - 0.01)

    def show(self, view: View, feed: Feed, turn: int) -> None:
        """Update the strips, in turns."""
        if turn % _RECENT_EVERY == 0:
            self._recent.content = _draw("recent", RECENT_S, "-30 s", view, feed)
        if turn % _LONG_EVERY == 1:
            self._long.content = _draw("long", BACK_S, "-10 min", view, feed)


def _draw(name: str, length_s: float, begin: str, view: View, feed: Feed) -> str:
    span = Span.until(feed.recent.newest_ns, ns_from_s(length_s))
    end = f"data end {view.data_age_s:.0f} s ago" if view.snapshot and view.is_stale else "now"
    return strip_html(name, span, feed.recent.between(span.begin_ns - 1, span.end_ns), feed.events, (begin, end))
