"""The trail: the vehicle's past positions."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import viser

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.trajectory import FloatArray
from vehicle_iface_viewer import shapes

TRAIL_COLOR = (222, 226, 230)
_STEP_M = 0.4
_MAX_POINTS = 300
_JUMP_M = 20.0
_PERIOD_NS = 200_000_000
_Z_M = 0.1


class Trail:
    """The vehicle's past positions, over about the last hundred metres."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._points: deque[tuple[float, float]] = deque(maxlen=_MAX_POINTS)
        self._due_ns = 0
        self._is_drawn = True
        self._line = scene.add_line_segments(
            f"{root}/trail", np.zeros((1, 2, 3)), TRAIL_COLOR, thickness=0.09, visible=False
        )

    def clear(self) -> None:
        """Remove all points."""
        self._points.clear()
        self._line.visible = False
        self._due_ns = 0

    def restore(self, places_m: FloatArray, origin: tuple[float, float]) -> None:
        """Begin again with the (n, 2) past positions of the vehicle."""
        self.clear()
        for x_m, y_m in places_m - origin:
            self._add((float(x_m), float(y_m)))

    def extend(self, snapshot: Snapshot, origin: tuple[float, float], now_ns: int) -> None:
        """Add the vehicle's position, and redraw the line when that is due."""
        self._add((snapshot.x_m - origin[0], snapshot.y_m - origin[1]))
        if not self._is_drawn and now_ns >= self._due_ns and len(self._points) >= 2:
            self._due_ns, self._is_drawn = now_ns + _PERIOD_NS, True
            points = np.column_stack((np.array(self._points), np.full(len(self._points), _Z_M)))
            self._line.points = shapes.segments(points).astype(np.float32)
            self._line.visible = True

    def _add(self, here: tuple[float, float]) -> None:
        """Add a position, if it is far enough from the last one."""
        step_m = math.dist(self._points[-1], here) if self._points else math.inf
        if step_m > _JUMP_M:
            self.clear()
        if step_m >= _STEP_M:
            self._points.append(here)
            self._is_drawn = False
