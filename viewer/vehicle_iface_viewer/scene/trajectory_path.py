"""The trajectory: a line coloured by speed, with chevrons in the direction of travel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import viser

from vehicle_iface.telemetry import DrawnTrajectory
from vehicle_iface.trajectory import FloatArray
from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.scene.nodes import FAR_M

_CHEVRON_STEP_M = 5.0
_MAX_CHEVRONS = 60
_Z_LINE_M, _Z_CHEVRON_M = 0.03, 0.16
"""Above the ground, so that what overlaps does not flicker."""
_NO_LINE = np.zeros((1, 2, 3))


class TrajectoryPath:
    """The trajectory, coloured by speed, with chevrons in the direction of travel."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._shown: DrawnTrajectory | None = None
        self._line = scene.add_line_segments(
            f"{root}/trajectory", _NO_LINE, np.zeros((1, 2, 3), dtype=np.uint8), thickness=0.22, visible=False
        )
        vertices, faces = shapes.ring(1.0, 0.1, 0.0)
        self._chevrons = scene.add_mesh_simple(
            f"{root}/direction", vertices, faces, color=(248, 249, 250), side="double", visible=False
        )

    def invalidate(self) -> None:
        """Draw the trajectory again at the next `show`."""
        self._shown = None

    def show(self, path: DrawnTrajectory | None, origin: tuple[float, float], frame_id: str) -> None:
        """Draw `path`, unless it is drawn already; nothing where it is not in the vehicle's frame `frame_id`."""
        if path is not None and path.frame_id != frame_id:
            path = None
        if path is self._shown:
            return
        self._shown = path
        points, speed = select_drawable(path, origin) if path is not None else (np.empty((0, 3)), np.empty(0))
        self._line.visible = self._chevrons.visible = len(points) >= 2
        if len(points) < 2:
            return
        share = np.abs(speed) / max(float(np.abs(speed).max()), 1e-3)
        self._line.points = shapes.segments(points).astype(np.float32)
        self._line.colors = shapes.segments(shapes.to_linear(shapes.speed_color(share)))
        self._chevrons.vertices, self._chevrons.faces = _build_chevrons(points)


def select_drawable(path: DrawnTrajectory, origin: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return the (n, 3) points relative to `origin` that can be drawn, and their (n,) speeds."""
    x_m, y_m = path.x_m - origin[0], path.y_m - origin[1]
    with np.errstate(invalid="ignore"):
        good = (np.abs(x_m) < FAR_M) & (np.abs(y_m) < FAR_M) & np.isfinite(path.speed_mps)
    points = np.column_stack((x_m, y_m, np.full(len(x_m), _Z_LINE_M)))[good]
    return points, path.speed_mps[good]


def _build_chevrons(points: FloatArray) -> tuple[npt.NDArray[np.float32], shapes.Faces]:
    """Arrow heads at even distances. They point to the next point: the direction of travel, in reverse too."""
    steps = np.diff(points[:, :2], axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    distance = np.concatenate(([0.0], np.cumsum(lengths)))
    count = int(min(_MAX_CHEVRONS, max(1, distance[-1] // _CHEVRON_STEP_M)))
    at = (np.arange(count) + 0.5) * distance[-1] / count
    i = np.clip(np.searchsorted(distance, at, side="right") - 1, 0, len(steps) - 1)
    share = (at - distance[i]) / np.maximum(lengths[i], 1e-9)
    spot = points[i, :2] + share[:, None] * steps[i]
    course = np.arctan2(steps[i, 1], steps[i, 0])
    vertices, faces = shapes.chevrons(spot[:, 0], spot[:, 1], course, size_m=0.9, z_m=_Z_CHEVRON_M)
    return vertices.astype(np.float32), faces
