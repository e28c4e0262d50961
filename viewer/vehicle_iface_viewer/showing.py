"""One drive at one time: of a running loop for all browsers, of a recording for one browser."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import viser

from vehicle_iface_viewer.box import Box
from vehicle_iface_viewer.bus_table.report import BusReport
from vehicle_iface_viewer.bus_table.source import BusTableSource, has_frames
from vehicle_iface_viewer.feed import LIVE_S, RECORDED_S, Feed, LiveTelemetry, View
from vehicle_iface_viewer.panels.live_strips import LiveStrips
from vehicle_iface_viewer.panels.map_drawing import MapDrawing
from vehicle_iface_viewer.panels.side_panel import SidePanel
from vehicle_iface_viewer.playback import Playback
from vehicle_iface_viewer.scene.nodes import Place
from vehicle_iface_viewer.scene.scene import Scene

PANELS_EVERY, MAP_EVERY = 3, 6
"""Updates of which one is for texts, for tables or for plots, and of which one is for the map."""
_NO_TABLE = BusReport(problem="nothing is received")


class Picture(Protocol):
    """What a camera and a map look at."""

    @property
    def place(self) -> Place | None: ...
    @property
    def drive(self) -> Box | None: ...
    @property
    def map(self) -> MapDrawing: ...


class Showing:
    """Picture, texts, map and table of messages, updated thirty times a second."""

    def __init__(
        self,
        host: viser.ViserServer | viser.ClientHandle,
        reader: LiveTelemetry | Playback,
        scene: Scene,
        bus_table: BusTableSource | None = None,
    ) -> None:
        """`host` is the server for all browsers, or one browser."""
        is_live = isinstance(reader, LiveTelemetry)
        self._reader = reader
        self.feed = Feed(reader, LIVE_S if is_live else RECORDED_S)
        self.scene = scene
        self.map = MapDrawing()
        self.place: Place | None = None
        """The vehicle's, relative to the local origin of the scene."""
        self.view: View | None = None
        self.report: BusReport | None = _NO_TABLE
        self._bus_table = bus_table
        self._side_panel = SidePanel(host.gui)
        self._strips = LiveStrips(host.gui) if is_live else None

    @property
    def drive(self) -> Box | None:
        """What holds the whole drive, relative to the local origin of the scene."""
        return self.scene.relative(self.map.visible)

    @property
    def has_frames(self) -> bool:
        """Whether the drive's buses have frames that can be listed."""
        return has_frames(self._reader.info)

    def update(self, now_ns: int, tick: int) -> View:
        """Update the picture each time, the rest in turns, so that no update is long; return what is shown."""
        view = self.view = self._read(now_ns)
        self.place = self.scene.draw(view, self.feed.recent)
        turn = tick // PANELS_EVERY
        if tick % PANELS_EVERY == 0:
            self._side_panel.show(view, turn)
        if tick % PANELS_EVERY == 1:
            if self._strips is not None:
                self._strips.show(view, self.feed, turn)
            if self._bus_table is not None:
                self.report = self._bus_table.read(view)
        if tick % MAP_EVERY == MAP_EVERY - 2:
            self.scene.mark(self.feed)
            self.map.update(view, self.scene.journey)
        return view

    def _read(self, now_ns: int) -> View:
        if isinstance(self._reader, LiveTelemetry):
            return self.feed.read(now_ns)
        view = self.feed.read(self._reader.advance(now_ns))
        return replace(view, recording=self._reader.description)
