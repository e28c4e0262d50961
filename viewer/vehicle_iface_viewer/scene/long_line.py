"""A line through the places of a whole drive, of a bounded number of points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import viser

from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.scene.nodes import FAR_M, ROOT

_MAX_POINTS = 600
_FIRST_STEP_M = 0.5
_JUMP_M = 20.0
_PERIOD_NS = 1_000_000_000


class _Point(NamedTuple):
    x_m: float
    y_m: float
    is_joined: bool
    """With the point before."""


class LongLine:
    """Places in the frame of the drive. When there are too many, every second one is dropped."""

    def __init__(
        self, scene: viser.SceneApi, name: str, color: tuple[int, int, int], *, thickness_m: float, z_m: float
    ) -> None:
        self._points: list[_Point] = []
        self._step_m = _FIRST_STEP_M
        self._due_ns = 0
        self._z_m = z_m
        self._line = scene.add_line_segments(
            f"{ROOT}/{name}", np.zeros((1, 2, 3)), color, thickness=thickness_m, visible=False
        )

    def clear(self) -> None:
        """Remove all points."""
        self._points.clear()
        self._line.visible = False
        self._step_m, self._due_ns = _FIRST_STEP_M, 0

    def invalidate(self) -> None:
        """Draw the line again at the next `extend`."""
        self._due_ns = 0

    def extend(self, x_m: float, y_m: float, origin: tuple[float, float], now_ns: int) -> None:
        """Add a place, and redraw the line relative to `origin` when that is due."""
        distance_m = math.dist(self._points[-1][:2], (x_m, y_m)) if self._points else math.inf
        if distance_m >= self._step_m:
            self._points.append(_Point(x_m, y_m, distance_m <= max(_JUMP_M, 2 * self._step_m)))
            if len(self._points) > _MAX_POINTS:
                self._thin_out()
        if now_ns >= self._due_ns and len(self._points) >= 2:
            self._due_ns = now_ns + _PERIOD_NS
            self._draw(origin)

    def _thin_out(self) -> None:
        pairs = zip(self._points[::2], [_Point(0.0, 0.0, True), *self._points[1::2]], strict=False)
        self._points = [point._replace(is_joined=point.is_joined and dropped.is_joined) for point, dropped in pairs]
        self._step_m *= 2

    def _draw(self, origin: tuple[float, float]) -> None:
        flat = np.array([point[:2] for point in self._points]) - origin
        points = np.column_stack((flat, np.full(len(flat), self._z_m)))
        is_joined = np.array([point.is_joined for point in self._points[1:]])
        is_near = np.abs(flat).max(axis=1) < FAR_M
        segments = shapes.segments(points)[is_joined & is_near[1:] & is_near[:-1]]
        self._line.visible = len(segments) > 0
        if len(segments):
            self._line.points = segments.astype(np.float32)
