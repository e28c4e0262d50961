"""One drive in one browser: picture, texts and strips."""

from __future__ import annotations

from typing import Protocol

import viser

from vehicle_iface_viewer.box import Box
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.live_strips import LiveStrips
from vehicle_iface_viewer.panels.map_drawing import MapDrawing
from vehicle_iface_viewer.panels.side_panel import SidePanel
from vehicle_iface_viewer.scene.nodes import LIVE, Place
from vehicle_iface_viewer.scene.scene import Scene
from vehicle_iface_viewer.watched import PANELS_EVERY, Watched


class Picture(Protocol):
    """What a camera and a map look at."""

    @property
    def place(self) -> Place | None: ...
    @property
    def drive(self) -> Box | None: ...
    @property
    def map(self) -> MapDrawing: ...


class Showing:
    """Picture, texts and strips, updated thirty times a second."""

    def __init__(self, client: viser.ClientHandle, watched: Watched) -> None:
        self.watched = watched
        self.place: Place | None = None
        """The vehicle's, relative to the local origin of the scene."""
        self.scene = Scene(client.scene, LIVE, watched.journey)
        self._side_panel = SidePanel(client.gui)
        self._strips = LiveStrips(client.gui) if watched.is_live else None

    @property
    def drive(self) -> Box | None:
        """What holds the whole drive, relative to the local origin of the scene."""
        return self.scene.relative(self.map.visible)

    @property
    def map(self) -> MapDrawing:
        """The map of the drive."""
        return self.watched.map

    def update(self, view: View, tick: int, *, draws_scene: bool = True) -> None:
        """Show `view`: the picture each time, the rest in turns, so that no update is long."""
        feed, turn = self.watched.feed, tick // PANELS_EVERY
        self.place = self.scene.draw(view, feed.recent) if draws_scene else None
        if tick % PANELS_EVERY == 0:
            self._side_panel.show(view, turn)
        if tick % PANELS_EVERY == 1 and self._strips is not None:
            self._strips.show(view, feed, turn)
