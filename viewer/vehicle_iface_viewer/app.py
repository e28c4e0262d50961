"""The viewer's loop: updates the page from the telemetry thirty times a second."""

from __future__ import annotations

from collections.abc import Callable

import viser

from vehicle_iface import clock
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.browser import LiveBrowser, ReplayBrowser
from vehicle_iface_viewer.bus_table.source import BusTableSource
from vehicle_iface_viewer.cameras import look_first
from vehicle_iface_viewer.feed import LiveTelemetry
from vehicle_iface_viewer.journey import Journey
from vehicle_iface_viewer.playback import Playback
from vehicle_iface_viewer.scene.scene import set_stage
from vehicle_iface_viewer.serving import open_server
from vehicle_iface_viewer.settings import configure_theme
from vehicle_iface_viewer.watched import Watched

_PERIOD_NS = NS_PER_S // 30
_PANEL_WIDTH_PX = 430


class App:
    """A server with its page, fed from one telemetry address, or from a recording."""

    def __init__(self, access: Access, source: str | Playback, bus_table: BusTableSource | None = None) -> None:
        """`bus_table`: where the table of messages comes from; without it there is none."""
        reader = LiveTelemetry(source) if isinstance(source, str) else source
        self._bus_table = bus_table
        self._clients: dict[int, LiveBrowser | ReplayBrowser] = {}
        is_recording = isinstance(reader, Playback)
        self.server = open_server(access)
        configure_theme(self.server.gui, is_dark=True)
        self.server.gui.set_panel_label("vehicle-iface: RECORDING" if is_recording else "vehicle-iface")
        self.server.gui.main_panel.dock_right()
        self.server.gui.main_panel.set_width(_PANEL_WIDTH_PX)
        set_stage(self.server, is_recording=is_recording)
        look_first(self.server)
        self._live: Watched | None = None
        if isinstance(reader, Playback):
            self._playback, self._whole = reader, Journey.of(reader)
        else:
            self._live = Watched(reader, bus_table)

    @property
    def port(self) -> int:
        """TCP port of the page."""
        return self.server.get_port()

    def run(self, keep_running: Callable[[], bool]) -> None:
        """Update the page while `keep_running` returns True."""
        tick = 0
        due_ns = clock.monotonic_ns()
        while keep_running():
            self.update(tick)
            tick += 1
            # A late update is not caught up: that would only delay the next ones.
            due_ns = max(due_ns + _PERIOD_NS, clock.monotonic_ns())
            clock.sleep_until(due_ns)

    def update(self, tick: int) -> None:
        """Update the page in all browsers."""
        now_ns = clock.monotonic_ns()
        if self._live is not None:
            self._live.update(now_ns, tick)
        for client in self._update_clients():
            client.update(now_ns, tick)
        self.server.flush()

    def close(self) -> None:
        """Stop serving."""
        if self._live is not None:
            self._live.close()
        else:
            self._playback.close()
            if self._bus_table is not None:
                self._bus_table.close()
        self.server.stop()

    def _update_clients(self) -> list[LiveBrowser | ReplayBrowser]:
        """Keep one client per connected browser. Polled: viser's callbacks for connect and disconnect may arrive in
        the wrong order, and a browser that stayed in the list would stay for ever."""
        clients = self.server.get_clients()
        for number in self._clients.keys() - clients.keys():
            self._note_place(self._clients[number])
        self._clients = {
            number: self._clients.get(number) or self._on_connect(client) for number, client in clients.items()
        }
        return list(self._clients.values())

    def _on_connect(self, client: viser.ClientHandle) -> LiveBrowser | ReplayBrowser:
        if self._live is not None:
            return LiveBrowser(client, self._live)
        playback = self._playback.fork()
        table = self._bus_table.fork() if self._bus_table is not None else None
        return ReplayBrowser(client, Watched(playback, table, self._whole), playback)

    def _note_place(self, gone: LiveBrowser | ReplayBrowser) -> None:
        """Let the next browser begin where this one has left: a page that is loaded again continues."""
        if isinstance(gone, ReplayBrowser):
            self._playback = gone.playback
