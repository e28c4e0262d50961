"""The trail: the vehicle's past positions."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import viser

from vehicle_iface.telemetry import Snapshot
from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.scene.nodes import ROOT

TRAIL_COLOR = (222, 226, 230)
_STEP_M = 0.4
_MAX_POINTS = 300
_JUMP_M = 20.0
_PERIOD_NS = 200_000_000
_Z_M = 0.1


class Trail:
    """The vehicle's past positions, over about the last hundred metres."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._points: deque[tuple[float, float]] = deque(maxlen=_MAX_POINTS)
        self._due_ns = 0
        self._line = scene.add_line_segments(
            f"{ROOT}/trail", np.zeros((1, 2, 3)), TRAIL_COLOR, thickness=0.09, visible=False
        )

    def clear(self) -> None:
        """Remove all points."""
        self._points.clear()
        self._line.visible = False
        self._due_ns = 0

    def extend(self, snapshot: Snapshot, origin: tuple[float, float], now_ns: int) -> None:
        """Add the vehicle's position, and redraw the line when that is due."""
        here = (snapshot.x_m - origin[0], snapshot.y_m - origin[1])
        step_m = math.dist(self._points[-1], here) if self._points else math.inf
        if step_m > _JUMP_M:
            self.clear()
        if step_m < _STEP_M:
            return
        self._points.append(here)
        if now_ns >= self._due_ns and len(self._points) >= 2:
            self._due_ns = now_ns + _PERIOD_NS
            points = np.column_stack((np.array(self._points), np.full(len(self._points), _Z_M)))
            self._line.points = shapes.segments(points).astype(np.float32)
            self._line.visible = True
