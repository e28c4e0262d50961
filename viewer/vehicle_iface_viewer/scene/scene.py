"""The scene as a whole, drawn around a local origin near the vehicle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import viser

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.box import Box
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.journey import LAST_M, Journey
from vehicle_iface_viewer.recent import RecentSnapshots
from vehicle_iface_viewer.scene.event_marks import EventMarks
from vehicle_iface_viewer.scene.ground import SECTION_M, Ground
from vehicle_iface_viewer.scene.guides import Guides
from vehicle_iface_viewer.scene.long_line import LongLine
from vehicle_iface_viewer.scene.markers import Markers
from vehicle_iface_viewer.scene.nodes import Place, is_near
from vehicle_iface_viewer.scene.trail import Trail
from vehicle_iface_viewer.scene.trajectory_path import TrajectoryPath
from vehicle_iface_viewer.scene.vehicle import PAINT_COLOR, RECORDED_COLOR, STALE_COLOR, Vehicle

_BACKGROUND = (23, 27, 33)
_RECORDED_BACKGROUND = (44, 26, 58)
_REANCHOR_M = 400.0
_TRAIL_NS, _TRAIL_EVERY = 60 * NS_PER_S, 5
ROUTE_COLOR = (116, 143, 192)
TRACK_COLOR = (150, 156, 163)


class Scene:
    """All nodes of the scene."""

    def __init__(self, scene: viser.SceneApi, root: str, journey: Journey) -> None:
        """All nodes hang on the frame `root`. `journey` is the drive so far, or the whole one; it is only read."""
        self._journey = journey
        self.origin: tuple[float, float] | None = None
        """The local origin in the frame of the drive, m; None before the first place."""
        self._session = 0
        self._trail_of: tuple[int, tuple[float, float]] | None = None
        self._ground = Ground(scene, root)
        self._path = TrajectoryPath(scene, root)
        self._trail = Trail(scene, root)
        self._route = LongLine(scene, root, "route", self._journey.route, ROUTE_COLOR, thickness_m=0.14, z_m=0.02)
        self._track = LongLine(scene, root, "track", self._journey.track, TRACK_COLOR, thickness_m=0.07, z_m=0.04)
        self._markers = Markers(scene, root)
        self._vehicle = Vehicle(scene, root)
        self._guides = Guides(scene, root)
        self._marks = EventMarks(scene, root)

    def draw(self, view: View, recent: RecentSnapshots | None = None) -> Place | None:
        """Update all nodes to `view`; the vehicle's place relative to the local origin, or None.

        After a jump in time the trail begins with the places of `recent`.
        """
        snapshot = view.snapshot
        if view.session != self._session:
            self._session = view.session
            self._trail.clear()
            if view.info is not None:
                self._vehicle.reshape(view.info.shape)
        if snapshot is None or not snapshot.has_state or not is_near(snapshot.x_m, snapshot.y_m, LAST_M):
            self._vehicle.show(None)
            self._markers.show(None, (0.0, 0.0))
            self._guides.hide()
            return None
        origin = self._update_origin(snapshot)
        self._path.show(view.trajectory, origin, snapshot.frame_id)
        self._markers.show(snapshot, origin)
        paint = STALE_COLOR if view.is_stale else RECORDED_COLOR if view.recording else PAINT_COLOR
        self._vehicle.show(snapshot, paint=paint, origin=origin)
        if recent is not None and self._trail_of != (view.session, origin):
            self._trail_of = (view.session, origin)
            self._trail.restore(_places(recent, snapshot.published_ns), origin)
        self._trail.extend(snapshot, origin, view.now_ns)
        self._track.draw(origin, view.now_ns)
        self._route.draw(origin, view.now_ns)
        self._guides.show(view)
        self._marks.show(self._journey.marks, origin)
        return Place(snapshot.x_m - origin[0], snapshot.y_m - origin[1], snapshot.heading_rad)

    def relative(self, box: Box | None) -> Box | None:
        """Return a box of the drive's frame, relative to the local origin."""
        if box is None or self.origin is None:
            return None
        return replace(box, west=box.west - self.origin[0], south=box.south - self.origin[1])

    def _update_origin(self, snapshot: Snapshot) -> tuple[float, float]:
        """Return the local origin, moved when the vehicle is far from it; always on a corner of the grid."""
        old = self.origin
        if old is None or math.dist(old, (snapshot.x_m, snapshot.y_m)) > _REANCHOR_M:
            step = 2 * SECTION_M
            self.origin = (round(snapshot.x_m / step) * step, round(snapshot.y_m / step) * step)
            self._ground.label(self.origin)
            self._trail.clear()
            for line in (self._route, self._track):
                line.invalidate()
            self._path.invalidate()
        assert self.origin is not None
        return self.origin


def set_stage(server: viser.ViserServer, *, is_recording: bool) -> None:
    """Set light and background for all browsers."""
    server.scene.set_up_direction("+z")
    server.scene.configure_default_lights(True, cast_shadow=False)
    set_background(server.scene, is_past=is_recording)


def set_background(scene: viser.SceneApi, *, is_past: bool) -> None:
    """Set the colour behind all: that of a recording is another than that of the present."""
    color = _RECORDED_BACKGROUND if is_past else _BACKGROUND
    scene.set_background_image(np.full((2, 2, 3), color, dtype=np.uint8), format="png")


def _places(recent: RecentSnapshots, until_ns: int) -> FloatArray:
    """Return the (n, 2) places of the vehicle in the last minute before `until_ns`."""
    rows = recent.between(until_ns - _TRAIL_NS, until_ns)[::_TRAIL_EVERY]
    rows = rows[rows["has_state"] & (np.abs(rows["x_m"]) < LAST_M) & (np.abs(rows["y_m"]) < LAST_M)]
    return np.column_stack((rows["x_m"], rows["y_m"]))
