"""A second vehicle in the scene, in colours of its own: its pose, its trajectory and its reference. Display only."""

from __future__ import annotations

import numpy as np
import viser

from vehicle_iface.telemetry import DrawnTrajectory
from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.journey import LAST_M
from vehicle_iface_viewer.scene.nodes import LIVE, assign_changed, is_near
from vehicle_iface_viewer.scene.trajectory_path import select_drawable
from vehicle_iface_viewer.scene.vehicle import STALE_COLOR, Vehicle

COMPANION_COLOR = (255, 121, 198)
_ROOT = f"{LIVE}/beside"
_LABEL_Z_M, _BALL_Z_M = 3.2, 2.0


def find_hindrance(shown: View, other: View) -> str:
    """Return why the other vehicle cannot be drawn beside the one that is shown; empty if it can."""
    if shown.snapshot is None or not shown.snapshot.has_state:
        return "the place of the vehicle that is shown is not known"
    if other.snapshot is None or not other.snapshot.has_state:
        return "its place is not known"
    if other.snapshot.frame_id != shown.snapshot.frame_id:
        return f"its positions are in the frame {other.snapshot.frame_id}, not in {shown.snapshot.frame_id}"
    return ""


class Companion:
    """The nodes of the second vehicle."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._name = name
        self._session = 0
        self._drawn: tuple[DrawnTrajectory | None, tuple[float, float]] | None = None
        self._vehicle = Vehicle(scene, _ROOT)
        self._label = scene.add_label(f"{_ROOT}/label", name, visible=False, anchor="bottom-center")
        self._ball = scene.add_icosphere(
            f"{_ROOT}/reference", radius=0.38, color=COMPANION_COLOR, subdivisions=2, visible=False
        )
        self._path = scene.add_line_segments(
            f"{_ROOT}/trajectory", np.zeros((1, 2, 3)), COMPANION_COLOR, thickness=0.16, visible=False
        )

    def draw(self, shown: View, other: View, origin: tuple[float, float] | None) -> None:
        """Draw the vehicle of `other` relative to `origin`, if it is in the frame of `shown`; else nothing."""
        s = other.snapshot
        hindered = bool(find_hindrance(shown, other)) or origin is None
        if hindered or s is None or origin is None or not is_near(s.x_m, s.y_m, LAST_M):
            self._hide()
            return
        if other.info is not None and other.session != self._session:
            self._session = other.session
            self._vehicle.reshape(other.info.shape)
        self._vehicle.show(s, paint=STALE_COLOR if other.is_stale else COMPANION_COLOR, origin=origin)
        x_m, y_m = s.x_m - origin[0], s.y_m - origin[1]
        self._label.position = (x_m, y_m, _LABEL_Z_M)
        assign_changed(self._label, visible=True, text=f"{self._name}: NO DATA" if other.is_stale else self._name)
        reference_m = (s.spatial_reference_x_m - origin[0], s.spatial_reference_y_m - origin[1])
        has_reference = s.has_reference and is_near(*reference_m)
        if has_reference:
            self._ball.position = (*reference_m, _BALL_Z_M)
        assign_changed(self._ball, visible=has_reference)
        self._draw_path(other.trajectory, origin, s.frame_id)

    def _draw_path(self, path: DrawnTrajectory | None, origin: tuple[float, float], frame_id: str) -> None:
        if path is not None and path.frame_id != frame_id:
            path = None
        if self._drawn is not None and self._drawn[0] is path and self._drawn[1] == origin:
            return
        self._drawn = (path, origin)
        points = select_drawable(path, origin)[0] if path is not None else np.empty((0, 3))
        assign_changed(self._path, visible=len(points) >= 2)
        if len(points) >= 2:
            self._path.points = shapes.segments(points).astype(np.float32)

    def _hide(self) -> None:
        self._vehicle.show(None)
        self._drawn = None
        for node in (self._label, self._ball, self._path):
            assign_changed(node, visible=False)
