"""Geometry and colours of the scene, independent of viser."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle_iface.telemetry import VehicleShape
from vehicle_iface.trajectory import FloatArray

Colors = npt.NDArray[np.uint8]
Faces = npt.NDArray[np.uint32]
Mesh = tuple[FloatArray, Faces]
"""Vertices (v, 3) and triangles (f, 3)."""

SPEED_COLORS = ((66, 99, 235), (34, 184, 207), (81, 207, 102), (252, 196, 25), (250, 82, 82))
"""Slow to fast, evenly spaced; distinct on a dark background, by brightness as well as by hue."""
WHEEL_WIDTH_M = 0.24

# Side view of a car, rear to front and ground to roof, as fractions of its length and height: a convex outline.
_BODY = ((0.0, 0.20), (0.0, 0.55), (0.05, 0.63), (0.68, 0.62), (0.96, 0.48), (1.0, 0.40), (1.0, 0.20))
_CABIN_BASE = (0.08, 0.72)
_CABIN_ROOF = (0.20, 0.52)
_BOX_FACES = ((0, 1, 2, 3), (7, 6, 5, 4), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))


def speed_color(share: npt.NDArray[Any]) -> Colors:
    """Return colours (…, 3) of speeds (…,), given as fractions 0 … 1 of the fastest."""
    table = np.asarray(SPEED_COLORS, dtype=np.float64)
    steps = np.linspace(0.0, 1.0, len(table))
    channels = [np.interp(share, steps, table[:, k]) for k in range(3)]
    return np.stack(channels, axis=-1).astype(np.uint8)


def to_linear(colors: Colors) -> Colors:
    """sRGB colours as linear light: viser expects the colours of line ends in it."""
    amount: Colors = np.round((colors / 255.0) ** 2.2 * 255.0).astype(np.uint8)
    return amount


def segments(points: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return lines (n − 1, 2, 3) between neighbours of (n, 3) points or colours."""
    return np.stack((points[:-1], points[1:]), axis=1)


def chevrons(x_m: FloatArray, y_m: FloatArray, course_rad: FloatArray, *, size_m: float, z_m: float) -> Mesh:
    """Flat arrow heads at n places, pointing along `course_rad`."""
    outline = np.array([(0.6, 0.0), (-0.5, 0.55), (-0.15, 0.0), (-0.5, -0.55)]) * size_m  # tip, left, notch, right
    cos, sin = np.cos(course_rad)[:, None], np.sin(course_rad)[:, None]
    vertices = np.empty((len(x_m), 4, 3))
    vertices[:, :, 0] = x_m[:, None] + cos * outline[:, 0] - sin * outline[:, 1]
    vertices[:, :, 1] = y_m[:, None] + sin * outline[:, 0] + cos * outline[:, 1]
    vertices[:, :, 2] = z_m
    faces = np.array([(0, 1, 2), (0, 2, 3)]) + 4 * np.arange(len(x_m))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.uint32)


def body(shape: VehicleShape) -> Mesh:
    """Return the painted lower part of a car."""
    side = _side_outline(shape, _BODY)
    return _extrude(side, shape.width_m)


def cabin(shape: VehicleShape) -> Mesh:
    """Return the glass part of a car, narrower towards the roof."""
    return _taper(shape, _CABIN_BASE, 0.60, 0.90, _CABIN_ROOF, 0.97, 0.72)


def roof(shape: VehicleShape) -> Mesh:
    """Return the painted plate on top of the cabin."""
    low, high = (_CABIN_ROOF[0] - 0.01, _CABIN_ROOF[1] + 0.015), _CABIN_ROOF
    return _taper(shape, low, 0.96, 0.75, high, 1.0, 0.70)


def lamps(shape: VehicleShape, *, front: bool) -> Mesh:
    """Two lamps, at the nose or at the tail."""
    rear_m, front_m = -shape.rear_overhang_m, shape.length_m - shape.rear_overhang_m
    x_m, height = (front_m - 0.03, 0.40) if front else (rear_m + 0.03, 0.50)
    y_m, z_m = 0.36 * shape.width_m, height * shape.height_m
    return join([_box((x_m, sign * y_m, z_m), (0.14, 0.36, 0.14)) for sign in (1, -1)])


def wheel(radius_m: float, segments_count: int = 20) -> Mesh:
    """Return a wheel that rolls along x."""
    angles = np.arange(segments_count) * math.tau / segments_count
    side = np.column_stack((np.cos(angles), np.sin(angles))) * radius_m
    return _extrude(side, WHEEL_WIDTH_M)


def join(meshes: list[Mesh]) -> Mesh:
    """Join meshes into one."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in meshes[:-1]])
    faces = [mesh[1] + offset for mesh, offset in zip(meshes, offsets, strict=True)]
    return np.concatenate([mesh[0] for mesh in meshes]), np.concatenate(faces).astype(np.uint32)


def ring(radius_m: float, width_m: float, z_m: float, count: int = 40) -> Mesh:
    """Return a flat ring on the ground."""
    angles = np.arange(count) * math.tau / count
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    flat = np.concatenate((circle * radius_m, circle * (radius_m - width_m)))
    i, j = np.arange(count), (np.arange(count) + 1) % count
    faces = np.concatenate((np.column_stack((i, j, i + count)), np.column_stack((j, j + count, i + count))))
    return np.column_stack((flat, np.full(2 * count, z_m))), faces.astype(np.uint32)


def pin(size_m: float) -> Mesh:
    """Return a pyramid that stands on its tip."""
    half = size_m / 2
    top = [(half, 0, size_m * 1.4), (0, half, size_m * 1.4), (-half, 0, size_m * 1.4), (0, -half, size_m * 1.4)]
    faces = [(4, k, (k + 1) % 4) for k in range(4)] + [(0, 2, 1), (0, 3, 2)]
    return np.array([*top, (0.0, 0.0, 0.0)], dtype=np.float64), np.array(faces, dtype=np.uint32)


def quaternion_z(angle_rad: float) -> tuple[float, float, float, float]:
    """Return a rotation about the vertical axis, as (w, x, y, z)."""
    return math.cos(angle_rad / 2), 0.0, 0.0, math.sin(angle_rad / 2)


def _side_outline(shape: VehicleShape, outline: tuple[tuple[float, float], ...]) -> FloatArray:
    """Fractions of length and height as (n, 2) metres from the rear axle's centre on the ground."""
    return np.array([(u * shape.length_m - shape.rear_overhang_m, v * shape.height_m) for u, v in outline])


def _extrude(side: FloatArray, width_m: float) -> Mesh:
    """Extrude a convex (n, 2) outline in x and z to `width_m` along y."""
    n = len(side)
    left = np.column_stack((side[:, 0], np.full(n, width_m / 2), side[:, 1]))
    right = left * (1.0, -1.0, 1.0)
    fan = [(0, k, k + 1) for k in range(1, n - 1)]
    faces = fan + [(n, n + b, n + a) for _, a, b in fan]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, n + i, j), (j, n + i, n + j)]
    return np.concatenate((left, right)), np.array(faces, dtype=np.uint32)


def _taper(
    shape: VehicleShape,
    base: tuple[float, float],
    base_height: float,
    base_width: float,
    top: tuple[float, float],
    top_height: float,
    top_width: float,
) -> Mesh:
    """Return a block whose top may be shorter and narrower; all in fractions of the vehicle's size."""
    corners = [
        (u * shape.length_m - shape.rear_overhang_m, sign * width * shape.width_m / 2, height * shape.height_m)
        for (rear, front), height, width in ((base, base_height, base_width), (top, top_height, top_width))
        for u, sign in ((rear, -1), (front, -1), (front, 1), (rear, 1))
    ]
    return np.array(corners), _quads(_BOX_FACES)


def _box(center: tuple[float, float, float], size: tuple[float, float, float]) -> Mesh:
    signs = [(x, y, z) for z in (-0.5, 0.5) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    return np.array(signs) * size + center, _quads(_BOX_FACES)


def _quads(quads: tuple[tuple[int, int, int, int], ...]) -> Faces:
    return np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.uint32)
