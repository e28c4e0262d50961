"""A line through the places of a whole drive."""

from __future__ import annotations

import numpy as np
import viser

from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.journey import Places
from vehicle_iface_viewer.scene.nodes import FAR_M

_PERIOD_NS = 1_000_000_000


class LongLine:
    """Draws places in the frame of the drive."""

    def __init__(
        self,
        scene: viser.SceneApi,
        root: str,
        name: str,
        places: Places,
        color: tuple[int, int, int],
        *,
        thickness_m: float,
        z_m: float,
    ) -> None:
        self._places = places
        self._drawn = 0
        self._due_ns = 0
        self._z_m = z_m
        self._line = scene.add_line_segments(
            f"{root}/{name}", np.zeros((1, 2, 3)), color, thickness=thickness_m, visible=False
        )

    def invalidate(self) -> None:
        """Draw the line again at the next `draw`."""
        self._due_ns, self._drawn = 0, -1

    def draw(self, origin: tuple[float, float], now_ns: int) -> None:
        """Redraw the line relative to `origin` when it has changed and that is due."""
        if self._drawn == self._places.changes or (now_ns < self._due_ns and len(self._places) > 1):
            return
        self._due_ns, self._drawn = now_ns + _PERIOD_NS, self._places.changes
        flat = self._places.positions_m() - origin
        is_near = np.abs(flat).max(axis=1, initial=0.0) < FAR_M
        points = np.column_stack((flat, np.full(len(flat), self._z_m)))
        segments = shapes.segments(points)[self._places.joints()[1:] & is_near[1:] & is_near[:-1]]
        self._line.visible = len(segments) > 0
        if len(segments):
            self._line.points = segments.astype(np.float32)
