"""What each browser has of its own: its camera, its plots and tables, and the time that it looks at."""

from __future__ import annotations

import viser

from vehicle_iface_viewer.cameras import Camera
from vehicle_iface_viewer.panels.big_map import BigMap
from vehicle_iface_viewer.panels.free_plot import FreePlot
from vehicle_iface_viewer.panels.left_panel import LeftPanel
from vehicle_iface_viewer.panels.map_panel import MapPanel
from vehicle_iface_viewer.panels.plot_time import PlotTime
from vehicle_iface_viewer.panels.plots import Plots
from vehicle_iface_viewer.past import Past
from vehicle_iface_viewer.playback import Playback
from vehicle_iface_viewer.playback_controls import PlaybackControls
from vehicle_iface_viewer.scene.companion import Companion
from vehicle_iface_viewer.scene.nodes import LIVE, PAST
from vehicle_iface_viewer.scene.scene import set_background
from vehicle_iface_viewer.settings import Settings
from vehicle_iface_viewer.showing import Picture, Showing
from vehicle_iface_viewer.watched import MAP_EVERY, PANELS_EVERY, Watched

_TURNS_PER_FREE_PLOT = 5


class _Browser:
    def __init__(self, client: viser.ClientHandle, watched: Watched) -> None:
        self._client = client
        self.watched = watched
        self.camera = Camera(client)
        self._present = client.scene.add_frame(LIVE, show_axes=False)
        self._showing = Showing(client, watched)
        self._big_map = BigMap(client)
        self._left_panel = LeftPanel(client, has_frames=watched.has_frames)
        self._map_panel = MapPanel(client, above=self._left_panel.panel)
        self._time = PlotTime(client, is_live=watched.is_live)
        self._plots = Plots(client.gui, watched.feed.recent)
        self._free_plot = FreePlot(client, watched.feed.recent, watched.bus_signals)
        self._settings = Settings(client, self.camera, self._big_map, self._left_panel, self._time, self._free_plot)

    def _show(self, picture: Picture, end_ns: int, tick: int) -> None:
        """Update the camera, and in turns plots, tables and map."""
        watched, turn = self.watched, tick // PANELS_EVERY
        assert watched.view is not None
        if picture.place is not None:
            self.camera.move(picture.place, picture.drive)
        if tick % PANELS_EVERY == 2:
            self._settings.keep()
            self._time.show(watched.feed.recent)
            self._plots.show(watched.view, turn, end_ns=end_ns, window_s=self._time.window_s)
            if turn % _TURNS_PER_FREE_PLOT == 0:
                self._free_plot.show(end_ns=end_ns, window_s=self._time.window_s)
        if tick % PANELS_EVERY == 1:  # not with the texts and plots, so that no update is long
            self._left_panel.show(watched.view, watched.report, watched.feed, turn)
        if tick % MAP_EVERY == MAP_EVERY - 2:
            self._map_panel.show(picture.map)
            self._big_map.show(picture.map)
            self.camera.show_buttons(are_useful=not self._big_map.is_shown)


class LiveBrowser(_Browser):
    """A browser that watches a running loop, and may look back."""

    def __init__(self, client: viser.ClientHandle, watched: Watched, beside: Watched | None = None) -> None:
        """`beside`: another loop, whose vehicle is drawn in the same picture and map if it is in the same frame."""
        super().__init__(client, watched)
        self.beside = beside
        self._companion = Companion(client.scene, beside.address) if beside is not None else None
        self._past_frame = client.scene.add_frame(PAST, show_axes=False, visible=False)
        self._past: Past | None = None

    def update(self, _now_ns: int, tick: int) -> None:
        """Show the present, or the time that this browser looks back to."""
        view, recent = self.watched.view, self.watched.feed.recent
        assert view is not None
        with self._client.atomic():
            draws_scene = self._big_map.draws_scene
            self._showing.update(view, tick, draws_scene=draws_scene)
            if draws_scene and self._companion is not None and self.beside is not None and self.beside.view is not None:
                self._companion.draw(view, self.beside.view, self._showing.scene.origin)
        end_ns = self._time.end_ns(recent.newest_ns)
        is_present = self._time.is_present
        is_seen = draws_scene
        frames = (is_present and is_seen, not is_present and is_seen)
        if frames != (self._present.visible, self._past_frame.visible):
            self._present.visible, self._past_frame.visible = frames
            set_background(self._client.scene, is_past=not is_present)
        if is_present:
            self._show(self._showing, end_ns, tick)
            if tick % MAP_EVERY == MAP_EVERY - 2 and self.beside is not None and self.beside.view is not None:
                self._map_panel.show_beside(self.watched.map.draw_beside(view, self.beside.view))
            return
        if self._past is None:
            self._past = Past(self._client, self.watched.journey)
        self._past.update(view, recent, end_ns, tick)
        self._show(self._past, end_ns, tick)


class ReplayBrowser(_Browser):
    """A browser that plays a recording, at a place of its own."""

    def __init__(self, client: viser.ClientHandle, watched: Watched, playback: Playback) -> None:
        super().__init__(client, watched)
        self.playback = playback
        self._controls = PlaybackControls(client, playback)

    def update(self, now_ns: int, tick: int) -> None:
        """Play on, and show the time that has been reached."""
        with self._client.atomic():
            self._controls.update(now_ns)
            is_seen = self._big_map.draws_scene
            if self._present.visible is not is_seen:
                self._present.visible = is_seen
            self._showing.update(self.watched.update(now_ns, tick), tick, draws_scene=is_seen)
        self._show(self._showing, self._time.end_ns(self.watched.feed.recent.newest_ns), tick)
        self._client.flush()
