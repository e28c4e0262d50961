"""The panel to the left of the scene: the signals on the buses, the loop's events, latency and counters.

Each browser has its own.
"""

from __future__ import annotations

import viser

from vehicle_iface_viewer.bus_table.report import BusReport
from vehicle_iface_viewer.controls import handle_text
from vehicle_iface_viewer.feed import Feed, View
from vehicle_iface_viewer.panels.counters import counters_html
from vehicle_iface_viewer.panels.events import events_html
from vehicle_iface_viewer.panels.latency import latency_html
from vehicle_iface_viewer.panels.signals import signals_html

WIDTH_PX = 350
_SIGNALS, _EVENTS, _LATENCY, _COUNTERS = "Signals", "Events", "Latency", "Counters"
_MAX_SEARCH = 40


class LeftPanel:
    """Four tabs, one of which is updated in each turn."""

    tabs = (_SIGNALS, _EVENTS, _LATENCY, _COUNTERS)

    def __init__(self, client: viser.ClientHandle, *, has_frames: bool) -> None:
        """The first tab is open: the signals, or the events where the bus has no frames to list."""
        self._client = client
        panel = self.panel = client.gui.add_panel(order=5.0)
        self.search = ""
        """What the table of signals is filtered by."""
        self._shown: tuple[BusReport | None, str] | None = None
        if has_frames:
            self._signals = self._add_signals(panel)
        self._events = self._add_tab(panel, _EVENTS)
        if not has_frames:
            self._signals = self._add_signals(panel)
        self._latency = self._add_tab(panel, _LATENCY)
        self._counters = self._add_tab(panel, _COUNTERS)
        panel.dock_left()
        panel.set_width(WIDTH_PX)

    def show(self, view: View, report: BusReport | None, feed: Feed, turn: int) -> None:
        """Update the signals when there are newer ones, and in turns events, latency and counters."""
        wanted = (report, self.search)
        if turn % 2 == 0 and (self._shown is None or report is not self._shown[0] or self.search != self._shown[1]):
            self._shown = wanted
            self._signals.content = signals_html(*wanted)
        elif turn % 10 in (1, 5):
            _update(self._events, events_html(feed.events, feed.wall_offset_ns))
        elif turn % 10 == 3:
            _update(self._latency, latency_html(feed.recent))
        elif turn % 10 == 7:
            _update(self._counters, counters_html(view))

    def choose_search(self, search: str) -> None:
        """Filter the table of signals."""
        self._set_search(search)
        self._box.value = self.search  # type: ignore[misc]  # viser declares no setter

    def _add_signals(self, panel: viser.PanelHandle) -> viser.GuiHtmlHandle:
        with panel.add_tab(_SIGNALS):
            self._box = self._client.gui.add_text(
                "Filter", "", hint="a part of a message's or signal's name, or an identifier"
            )
            handle_text(self._client, self._box._impl.uuid, _MAX_SEARCH, self._set_search)
            return self._client.gui.add_html("")

    def _add_tab(self, panel: viser.PanelHandle, name: str) -> viser.GuiHtmlHandle:
        with panel.add_tab(name):
            return self._client.gui.add_html("")

    def _set_search(self, search: str) -> None:
        self.search = search.strip()[:_MAX_SEARCH]


def _update(handle: viser.GuiHtmlHandle, content: str) -> None:
    if handle.content != content:
        handle.content = content
