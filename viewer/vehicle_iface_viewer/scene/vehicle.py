"""The vehicle: body, cabin, lamps and steered wheels."""

from __future__ import annotations

import math

import numpy as np
import viser

from vehicle_iface.telemetry import Snapshot, VehicleShape
from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.scene.nodes import assign_changed

FRAME = "vehicle"
"""Name of its frame."""
PAINT_COLOR = (236, 240, 245)
RECORDED_COLOR = (190, 150, 235)
STALE_COLOR = (108, 117, 125)


class Vehicle:
    """A car with a cabin, lamps and steered wheels. The origin of its frame is the rear axle's centre on the ground."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        name = f"{root}/{FRAME}"
        shape = self._shape = VehicleShape()
        self._frame = scene.add_frame(name, show_axes=False, visible=False)
        self._body = _add_part(scene, f"{name}/body", shapes.body(shape), PAINT_COLOR)
        self._roof = _add_part(scene, f"{name}/roof", shapes.roof(shape), PAINT_COLOR)
        self._cabin = _add_part(scene, f"{name}/cabin", shapes.cabin(shape), (44, 58, 74))
        self._nose = _add_part(scene, f"{name}/headlamps", shapes.lamps(shape, front=True), (255, 243, 191))
        self._tail = _add_part(scene, f"{name}/taillamps", shapes.lamps(shape, front=False), (224, 49, 49))
        self._wheels = [
            _add_part(scene, f"{name}/wheel_{corner}", shapes.wheel(shape.wheel_radius_m), (18, 20, 23))
            for corner in ("fl", "fr", "rl", "rr")
        ]
        self._place_wheels()

    def reshape(self, shape: VehicleShape) -> None:
        """Resize the parts to another vehicle's shape."""
        if shape == self._shape:
            return
        self._shape = shape
        for handle, mesh in (
            (self._body, shapes.body(shape)),
            (self._roof, shapes.roof(shape)),
            (self._cabin, shapes.cabin(shape)),
            (self._nose, shapes.lamps(shape, front=True)),
            (self._tail, shapes.lamps(shape, front=False)),
            *((wheel, shapes.wheel(shape.wheel_radius_m)) for wheel in self._wheels),
        ):
            handle.vertices = mesh[0].astype(np.float32)
        self._place_wheels()

    def show(
        self,
        snapshot: Snapshot | None,
        *,
        paint: tuple[int, int, int] = STALE_COLOR,
        origin: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        if snapshot is None or not math.isfinite(snapshot.heading_rad):
            assign_changed(self._frame, visible=False)
            return
        assign_changed(self._body, color=paint)
        assign_changed(self._roof, color=paint)
        self._frame.wxyz = shapes.quaternion_z(snapshot.heading_rad)
        self._frame.position = (snapshot.x_m - origin[0], snapshot.y_m - origin[1], 0.0)
        angles = (snapshot.front_wheel_angle_rad, snapshot.rear_wheel_angle_rad)
        for wheel, angle_rad in zip(self._wheels, (angles[0], angles[0], angles[1], angles[1]), strict=True):
            if math.isfinite(angle_rad):
                wheel.wxyz = shapes.quaternion_z(angle_rad)
        assign_changed(self._frame, visible=True)

    def _place_wheels(self) -> None:
        corners = [(x, side) for x in (self._shape.wheelbase_m, 0.0) for side in (1, -1)]
        for wheel, (x_m, side) in zip(self._wheels, corners, strict=True):
            wheel.position = (x_m, side * self._shape.track_m / 2, self._shape.wheel_radius_m)


def _add_part(scene: viser.SceneApi, name: str, mesh: shapes.Mesh, color: tuple[int, int, int]) -> viser.MeshHandle:
    vertices, faces = mesh
    return scene.add_mesh_simple(
        name, vertices.astype(np.float32), faces, color=color, flat_shading=True, side="double"
    )
