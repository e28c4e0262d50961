"""The viewer's loop: updates the page from the telemetry thirty times a second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import viser

from vehicle_iface import clock
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.access import Access, open_server
from vehicle_iface_viewer.bus_table.report import BusReport
from vehicle_iface_viewer.bus_table.source import BusTableSource
from vehicle_iface_viewer.cameras import Camera, look_first
from vehicle_iface_viewer.feed import LIVE_S, RECORDED_S, Feed, LiveTelemetry, View
from vehicle_iface_viewer.panels.free_plot import FreePlot
from vehicle_iface_viewer.panels.left_panel import LeftPanel
from vehicle_iface_viewer.panels.live_strips import LiveStrips
from vehicle_iface_viewer.panels.map_drawing import MapDrawing
from vehicle_iface_viewer.panels.map_panel import MapPanel
from vehicle_iface_viewer.panels.plot_time import PlotTime
from vehicle_iface_viewer.panels.plots import Plots
from vehicle_iface_viewer.panels.side_panel import SidePanel
from vehicle_iface_viewer.playback import Playback
from vehicle_iface_viewer.playback_controls import PlaybackControls
from vehicle_iface_viewer.recent import RecentSnapshots
from vehicle_iface_viewer.scene.scene import Scene

_PERIOD_NS = NS_PER_S // 30
_PANELS_EVERY = 3
_MAP_EVERY = 6
_PANEL_WIDTH_PX = 430
_TURNS_PER_FREE_PLOT = 5
_NO_TABLE = BusReport(problem="nothing is received")


class App:
    """A server with its page, fed from one telemetry address, or from a recording."""

    def __init__(self, access: Access, source: str | Playback, bus_table: BusTableSource | None = None) -> None:
        """`bus_table`: where the table of messages comes from; without it there is none."""
        self._playback = source if isinstance(source, Playback) else None
        self._reader = source if isinstance(source, Playback) else LiveTelemetry(source)
        self._feed = Feed(self._reader, LIVE_S if self._playback is None else RECORDED_S)
        self.server = open_server(access)
        self.server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self.server.gui.set_panel_label("vehicle-iface" if self._playback is None else "vehicle-iface: RECORDING")
        self.server.gui.main_panel.dock_right()
        self.server.gui.main_panel.set_width(_PANEL_WIDTH_PX)
        self._scene = Scene(self.server, is_recording=self._playback is not None)
        look_first(self.server)
        self._map = MapDrawing()
        self._side_panel = SidePanel(self.server.gui)
        self._controls = PlaybackControls(self.server.gui, self._playback) if self._playback is not None else None
        self._strips = LiveStrips(self.server.gui) if self._playback is None else None
        self._bus_table = bus_table
        self._clients: dict[int, _Client] = {}

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
        """Update the page: the scene each time, texts and plots every third time."""
        now_ns = clock.monotonic_ns()
        view = self._view(now_ns)
        with self.server.atomic():
            if self._controls is not None:
                self._controls.update(now_ns)
            position = self._scene.draw(view)
            if tick % _PANELS_EVERY == 0:
                self._side_panel.show(view, tick // _PANELS_EVERY)
        present = self._update_clients()
        if position is not None:
            drive = self._scene.relative(self._map.visible)
            for client in present:
                client.camera.move(position, drive)
        if tick % _PANELS_EVERY == 2:
            for client in present:
                client.show_plots(view, tick // _PANELS_EVERY)
        if tick % _PANELS_EVERY == 1:  # not with the texts and plots, so that no update is long
            if self._strips is not None:
                self._strips.show(view, self._feed, tick // _PANELS_EVERY)
            report = self._bus_table.read(view) if self._bus_table is not None else _NO_TABLE
            for client in present:
                client.left_panel.show(view, report, self._feed, tick // _PANELS_EVERY)
        if tick % _MAP_EVERY == _MAP_EVERY - 2:
            self._scene.journey.mark(self._feed.events, self._feed.recent)
            self._map.update(view, self._scene.journey)
            for client in present:
                client.map_panel.show(self._map)
        # Both at once: the vehicle's position and the world's shift belong in the same frame.
        self.server.flush()

    def close(self) -> None:
        """Stop serving."""
        self._reader.close()
        if self._bus_table is not None:
            self._bus_table.close()
        self.server.stop()

    def _view(self, now_ns: int) -> View:
        if self._playback is None:
            return self._feed.read(now_ns)
        view = self._feed.read(self._playback.advance(now_ns, is_watched=bool(self._clients)))
        return replace(view, recording=self._playback.description)

    def _update_clients(self) -> list[_Client]:
        """Keep one client per connected browser. Polled: viser's callbacks for connect and disconnect may arrive in
        the wrong order, and a browser that stayed in the list would stay for ever."""
        clients = self.server.get_clients()
        self._clients = {
            number: self._clients.get(number) or self._on_connect(client) for number, client in clients.items()
        }
        return list(self._clients.values())

    def _on_connect(self, client: viser.ClientHandle) -> _Client:
        if self._controls is not None:
            self._controls.connect(client)
        return _Client(client, self._feed.recent, is_live=self._playback is None)


class _Client:
    """One browser, with a camera and plots of its own."""

    def __init__(self, client: viser.ClientHandle, recent: RecentSnapshots, *, is_live: bool) -> None:
        self.camera = Camera(client)
        self.left_panel = LeftPanel(client)
        self.map_panel = MapPanel(client, above=self.left_panel.panel)
        self._recent = recent
        self._time = PlotTime(client, is_live=is_live)
        self._plots = Plots(client.gui, recent)
        self._free_plot = FreePlot(client, recent)

    def show_plots(self, view: View, turn: int) -> None:
        """Update the plots."""
        self._time.show(self._recent)
        end_ns, window_s = self._time.end_ns(self._recent.newest_ns), self._time.window_s
        self._plots.show(view, turn, end_ns=end_ns, window_s=window_s)
        if turn % _TURNS_PER_FREE_PLOT == 0:
            self._free_plot.show(end_ns=end_ns, window_s=window_s)
