"""What the vehicle's state means on the road: its distance from the reference, and how far it needs to stop."""

from __future__ import annotations

import math

import numpy as np
import viser

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_MS
from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.scene.nodes import assign_changed, is_near
from vehicle_iface_viewer.scene.vehicle import FRAME

ERROR_COLOR, BRAKING_COLOR = (255, 107, 107), (255, 212, 59)
_ERROR_Z_M, _BRAKING_Z_M = 2.3, 0.06
_PERIOD_NS = 100 * NS_PER_MS
_LONGEST_M = 300.0
_ARC_POINTS = 16
_SLOWEST_MPS = 0.3
_SEEN_M = 0.02
"""A line is sent again when a point has moved by more."""


class Guides:
    """The error line, at the height of the spatial reference, and the braking distance, on the ground.

    Both hang on the vehicle's frame, in which they change little.
    """

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._due_ns = 0
        blank = np.zeros((1, 2, 3), dtype=np.float32)
        self._error = scene.add_line_segments(f"{root}/{FRAME}/error", blank, ERROR_COLOR, thickness=0.1, visible=False)
        self._braking = scene.add_line_segments(
            f"{root}/{FRAME}/braking", blank, BRAKING_COLOR, thickness=0.12, visible=False
        )

    def show(self, view: View) -> None:
        """Draw both for the snapshot of `view`, ten times a second."""
        if self._due_ns - _PERIOD_NS <= view.now_ns < self._due_ns:
            return
        self._due_ns = view.now_ns + _PERIOD_NS
        assert view.snapshot is not None
        for line, points in ((self._error, _error_line(view.snapshot)), (self._braking, braking_arc(view))):
            drawn = shapes.segments(points).astype(np.float32)
            if len(points) and (drawn.shape != line.points.shape or np.abs(drawn - line.points).max() > _SEEN_M):
                line.points = drawn
            assign_changed(line, visible=len(points) > 0)

    def hide(self) -> None:
        """Draw neither."""
        assign_changed(self._error, visible=False)
        assign_changed(self._braking, visible=False)


def _error_line(s: Snapshot) -> FloatArray:
    x_m, y_m = s.spatial_reference_x_m - s.x_m, s.spatial_reference_y_m - s.y_m
    if not (s.has_reference and is_near(x_m, y_m) and math.isfinite(s.heading_rad)):
        return np.empty((0, 3))
    cos, sin = math.cos(s.heading_rad), math.sin(s.heading_rad)
    return np.array([(cos * x_m + sin * y_m, cos * y_m - sin * x_m, _ERROR_Z_M), (0.0, 0.0, _ERROR_Z_M)])


def braking_arc(view: View) -> FloatArray:
    """Return (n, 3) points of the arc to where the vehicle's front would stop, in the vehicle's frame, m.

    It brakes as hard as the profile permits and keeps its wheel angles. Nothing is returned for a vehicle at rest.
    """
    s, info = view.snapshot, view.info
    if s is None or info is None or not _SLOWEST_MPS < abs(s.speed_mps) < math.inf:
        return np.empty((0, 3))
    distance_m = min(s.speed_mps * s.speed_mps / (2.0 * -info.limits.accel_min_mps2), _LONGEST_M)
    shape = info.shape
    rear_m = -shape.rear_overhang_m
    begin_m = shape.length_m + rear_m if s.speed_mps > 0.0 else rear_m
    along = begin_m + np.linspace(0.0, math.copysign(distance_m, s.speed_mps), _ARC_POINTS)
    curvature = (_tan(s.front_wheel_angle_rad) - _tan(s.rear_wheel_angle_rad)) / shape.wheelbase_m
    angle = curvature * along
    # sin(kx)/k and (1 - cos(kx))/k, also for k = 0
    forward, left = along * np.sinc(angle / math.pi), along * np.sinc(angle / math.tau) * np.sin(angle / 2.0)
    arc = np.column_stack((forward, left, np.full(_ARC_POINTS, _BRAKING_Z_M)))
    across = np.array([(-math.sin(angle[-1]), math.cos(angle[-1]), 0.0)]) * shape.width_m / 2.0
    return np.concatenate((arc, arc[-1:] + across, arc[-1:] - across))


def _tan(angle_rad: float) -> float:
    return math.tan(angle_rad) if math.isfinite(angle_rad) and abs(angle_rad) < 1.5 else 0.0
