"""The panel to the left of the scene: the signals on the buses, the loop's events, latency and counters.

Each browser has its own.
"""

from __future__ import annotations

import viser

from vehicle_iface_viewer.access import handle_text
from vehicle_iface_viewer.bus_table.report import BusReport
from vehicle_iface_viewer.feed import Feed, View
from vehicle_iface_viewer.panels.counters import counters_html
from vehicle_iface_viewer.panels.events import events_html
from vehicle_iface_viewer.panels.latency import latency_html
from vehicle_iface_viewer.panels.signals import signals_html

WIDTH_PX = 350
_MAX_SEARCH = 40


class LeftPanel:
    """Four tabs, one of which is updated in each turn."""

    def __init__(self, client: viser.ClientHandle) -> None:
        panel = self.panel = client.gui.add_panel(order=5.0)
        with panel.add_tab("Signals"):
            box = client.gui.add_text("Filter", "", hint="a part of a message's or signal's name, or an identifier")
            self._signals = client.gui.add_html("")
        with panel.add_tab("Events"):
            self._events = client.gui.add_html("")
        with panel.add_tab("Latency"):
            self._latency = client.gui.add_html("")
        with panel.add_tab("Counters"):
            self._counters = client.gui.add_html("")
        panel.dock_left()
        panel.set_width(WIDTH_PX)
        self._search = ""
        self._shown: tuple[BusReport | None, str] | None = None
        handle_text(client, box._impl.uuid, _MAX_SEARCH, self._set_search)

    def show(self, view: View, report: BusReport | None, feed: Feed, turn: int) -> None:
        """Update the signals when there are newer ones, and in turns events, latency and counters."""
        wanted = (report, self._search)
        if turn % 2 == 0 and (self._shown is None or report is not self._shown[0] or self._search != self._shown[1]):
            self._shown = wanted
            self._signals.content = signals_html(*wanted)
        elif turn % 10 in (1, 5):
            _update(self._events, events_html(feed.events, feed.wall_offset_ns))
        elif turn % 10 == 3:
            _update(self._latency, latency_html(feed.recent))
        elif turn % 10 == 7:
            _update(self._counters, counters_html(view))

    def _set_search(self, search: str) -> None:
        self._search = search.strip()


def _update(handle: viser.GuiHtmlHandle, content: str) -> None:
    if handle.content != content:
        handle.content = content
