"""The picture: ground, trajectory, references, vehicle and its trail.

Every node is made once and updated through its handle. All is drawn relative to a local origin near the vehicle,
because viser drops an update that differs by less than a hundred-thousandth of the value.

The frame `ROOT` above all of it belongs to each browser: whoever follows the vehicle has the world moved under a
camera that stays the user's own, so following cannot fight turning and zooming.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import numpy.typing as npt
import viser

from vehicle_iface.runtime.telemetry import DrawnTrajectory, Snapshot, VehicleShape
from vehicle_iface.trajectory import FloatArray
from viewer import shapes
from viewer.feed import View

ROOT = "/world"

BACKGROUND = (23, 27, 33)
RECORDED_BACKGROUND = (44, 26, 58)
SPATIAL_COLOR = (255, 169, 77)
TEMPORAL_COLOR = (230, 110, 255)
LOOKAHEAD_COLOR = (102, 217, 232)
TRAIL_COLOR = (222, 226, 230)
PAINT_COLOR = (236, 240, 245)
RECORDED_COLOR = (190, 150, 235)
STALE_COLOR = (108, 117, 125)

_CELL_M, _SECTION_M = 1.0, 10.0
GRID_TEXT = f"grid {_CELL_M:.0f} m, bold {_SECTION_M:.0f} m"
_GRID_LABELS_M = (-40, -20, 20, 40)
_REANCHOR_M = 400.0
_FAR_M = 1e5
"""Farther from the vehicle than this nothing is drawn."""
_TRAIL_STEP_M = 0.4
_TRAIL_POINTS = 300
_TRAIL_JUMP_M = 20.0
_TRAIL_PERIOD_NS = 200_000_000
_CHEVRON_STEP_M = 5.0
_MAX_CHEVRONS = 60
# Heights above the ground, so that what overlaps does not flicker.
_Z_CHEVRON_M, _Z_TRAJECTORY_M, _Z_TRAIL_M = 0.16, 0.03, 0.1
_SPATIAL_POST_M, _TEMPORAL_POST_M = 2.3, 3.7
_NO_SNAPSHOT = Snapshot(0, 0, 0)
_NOTHING = np.zeros((1, 2, 3))


class Scene:
    """All nodes of the picture."""

    def __init__(self, server: viser.ViserServer, *, is_recording: bool = False) -> None:
        self._origin: tuple[float, float] | None = None
        self._session = 0
        self._ground = _Ground(server.scene)
        self._path = _Path(server.scene)
        self._trail = _Trail(server.scene)
        self._markers = _Markers(server.scene)
        self._vehicle = _Vehicle(server.scene)
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(True, cast_shadow=False)
        background = RECORDED_BACKGROUND if is_recording else BACKGROUND
        server.scene.set_background_image(np.full((2, 2, 3), background, dtype=np.uint8), format="png")
        server.initial_camera.position = (-11.0, -11.0, 12.0)
        server.initial_camera.look_at = (0.0, 0.0, 0.0)

    def draw(self, view: View) -> tuple[float, float] | None:
        """Bring the picture to `view`; where the vehicle is in it, or None."""
        snapshot = view.snapshot
        if view.session != self._session:
            self._session = view.session
            self._trail.clear()
            if view.info is not None:
                self._vehicle.reshape(view.info.shape)
        if snapshot is None or not snapshot.has_state or not _is_near(snapshot.x_m, snapshot.y_m, 1e9):
            self._vehicle.show(None)
            self._markers.show(None, (0.0, 0.0))
            return None
        origin = self._anchored(snapshot)
        self._path.show(view.trajectory, origin, snapshot.frame_id)
        self._markers.show(snapshot, origin)
        paint = STALE_COLOR if view.is_stale else RECORDED_COLOR if view.recording else PAINT_COLOR
        self._vehicle.show(snapshot, paint=paint, origin=origin)
        self._trail.extend(snapshot, origin, view.now_ns)
        return snapshot.x_m - origin[0], snapshot.y_m - origin[1]

    def _anchored(self, snapshot: Snapshot) -> tuple[float, float]:
        """The local origin, moved when the vehicle is far from it; on a grid corner, so that lines are round."""
        old = self._origin
        if old is None or math.dist(old, (snapshot.x_m, snapshot.y_m)) > _REANCHOR_M:
            step = 2 * _SECTION_M
            self._origin = (round(snapshot.x_m / step) * step, round(snapshot.y_m / step) * step)
            self._ground.label(self._origin)
            self._trail.clear()
            self._path.forget()
        assert self._origin is not None
        return self._origin


class _Ground:
    """The grid, with its scale in metres."""

    def __init__(self, scene: viser.SceneApi) -> None:
        scene.add_grid(
            f"{ROOT}/grid",
            infinite_grid=True,
            cell_size=_CELL_M,
            section_size=_SECTION_M,
            cell_color=(50, 57, 66),
            section_color=(82, 92, 105),
            section_thickness=1.4,
            fade_distance=130.0,
            fade_strength=1.4,
            shadow_opacity=0.0,
        )
        self._labels = {
            (along, at): scene.add_label(
                f"{ROOT}/scale/{along}{at}",
                "",
                position=(at, 0.0, 0.02) if along == "x" else (0.0, at, 0.02),
                visible=False,
                font_size_mode="scene",
                font_scene_height=0.6,
                anchor="center-center",
            )
            for along in "xy"
            for at in _GRID_LABELS_M
        }

    def label(self, origin: tuple[float, float]) -> None:
        for (along, at), handle in self._labels.items():
            handle.text = f"{along} = {origin['xy'.index(along)] + at:.0f} m"
            handle.visible = True


class _Path:
    """The trajectory, coloured by speed, with chevrons in the direction of travel."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._shown: DrawnTrajectory | None = None
        self._line = scene.add_line_segments(
            f"{ROOT}/trajectory", _NOTHING, np.zeros((1, 2, 3), dtype=np.uint8), thickness=0.22, visible=False
        )
        vertices, faces = shapes.ring(1.0, 0.1, 0.0)
        self._chevrons = scene.add_mesh_simple(
            f"{ROOT}/direction", vertices, faces, color=(248, 249, 250), side="double", visible=False
        )

    def forget(self) -> None:
        self._shown = None

    def show(self, path: DrawnTrajectory | None, origin: tuple[float, float], frame_id: str) -> None:
        if path is not None and path.frame_id != frame_id:
            path = None  # in another frame its numbers mean other places
        if path is self._shown:
            return
        self._shown = path
        points, speed = drawable_points(path, origin) if path is not None else (np.empty((0, 3)), np.empty(0))
        self._line.visible = self._chevrons.visible = len(points) >= 2
        if len(points) < 2:
            return
        share = np.abs(speed) / max(float(np.abs(speed).max()), 1e-3)
        self._line.points = shapes.segments(points).astype(np.float32)
        self._line.colors = shapes.segments(shapes.linear(shapes.speed_color(share)))
        self._chevrons.vertices, self._chevrons.faces = _chevrons_along(points)


class _Trail:
    """Where the vehicle was, the last hundred metres or so."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._points: deque[tuple[float, float]] = deque(maxlen=_TRAIL_POINTS)
        self._due_ns = 0
        self._line = scene.add_line_segments(f"{ROOT}/trail", _NOTHING, TRAIL_COLOR, thickness=0.09, visible=False)

    def clear(self) -> None:
        self._points.clear()
        self._line.visible = False
        self._due_ns = 0

    def extend(self, snapshot: Snapshot, origin: tuple[float, float], now_ns: int) -> None:
        here = (snapshot.x_m - origin[0], snapshot.y_m - origin[1])
        step_m = math.dist(self._points[-1], here) if self._points else math.inf
        if step_m > _TRAIL_JUMP_M:
            self.clear()
        if step_m < _TRAIL_STEP_M:
            return
        self._points.append(here)
        if now_ns >= self._due_ns and len(self._points) >= 2:
            self._due_ns = now_ns + _TRAIL_PERIOD_NS
            points = np.column_stack((np.array(self._points), np.full(len(self._points), _Z_TRAIL_M)))
            self._line.points = shapes.segments(points).astype(np.float32)
            self._line.visible = True


class _Markers:
    """The two references and the look-ahead point: told apart by shape, colour, height and word.

    The references are mostly under the vehicle, so they stand on posts above it.
    """

    def __init__(self, scene: viser.SceneApi) -> None:
        ball = scene.add_icosphere(f"{ROOT}/spatial/ball", radius=0.38, color=SPATIAL_COLOR, subdivisions=2)
        ball.position = (0.0, 0.0, _SPATIAL_POST_M)
        cube = scene.add_box(f"{ROOT}/temporal/cube", color=TEMPORAL_COLOR, dimensions=(0.6, 0.6, 0.6))
        cube.position = (0.0, 0.0, _TEMPORAL_POST_M)
        vertices, faces = shapes.pin(0.8)
        scene.add_mesh_simple(
            f"{ROOT}/lookahead/pin", vertices, faces, color=LOOKAHEAD_COLOR, flat_shading=True, side="double"
        )
        self._spatial = _stand(scene, "spatial", "in space", _SPATIAL_POST_M, SPATIAL_COLOR)
        self._temporal = _stand(scene, "temporal", "in time", _TEMPORAL_POST_M, TEMPORAL_COLOR)
        self._lookahead = _stand(scene, "lookahead", "look-ahead", 0.9, LOOKAHEAD_COLOR)

    def show(self, snapshot: Snapshot | None, origin: tuple[float, float]) -> None:
        s = snapshot or _NO_SNAPSHOT
        _place(self._spatial, s.has_reference, s.spatial_reference_x_m, s.spatial_reference_y_m, origin)
        _place(self._temporal, s.has_reference, s.temporal_reference_x_m, s.temporal_reference_y_m, origin)
        _place(self._lookahead, s.has_lookahead, s.lookahead_x_m, s.lookahead_y_m, origin)


class _Vehicle:
    """A car with a cabin, lamps and steered wheels. Its frame is the rear axle's centre on the ground."""

    def __init__(self, scene: viser.SceneApi) -> None:
        name = f"{ROOT}/vehicle"
        shape = self._shape = VehicleShape()
        self._frame = scene.add_frame(name, show_axes=False, visible=False)
        self._body = _part(scene, f"{name}/body", shapes.body(shape), PAINT_COLOR)
        self._roof = _part(scene, f"{name}/roof", shapes.roof(shape), PAINT_COLOR)
        self._cabin = _part(scene, f"{name}/cabin", shapes.cabin(shape), (44, 58, 74))
        self._nose = _part(scene, f"{name}/headlamps", shapes.lamps(shape, front=True), (255, 243, 191))
        self._tail = _part(scene, f"{name}/taillamps", shapes.lamps(shape, front=False), (224, 49, 49))
        self._wheels = [
            _part(scene, f"{name}/wheel_{corner}", shapes.wheel(shape.wheel_radius_m), (18, 20, 23))
            for corner in ("fl", "fr", "rl", "rr")
        ]
        self._place_wheels()

    def reshape(self, shape: VehicleShape) -> None:
        """Take on another vehicle's size."""
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
            _assign(self._frame, visible=False)
            return
        _assign(self._body, color=paint)
        _assign(self._roof, color=paint)
        self._frame.wxyz = shapes.quaternion_z(snapshot.heading_rad)
        self._frame.position = (snapshot.x_m - origin[0], snapshot.y_m - origin[1], 0.0)
        angles = (snapshot.front_wheel_angle_rad, snapshot.rear_wheel_angle_rad)
        for wheel, angle_rad in zip(self._wheels, (angles[0], angles[0], angles[1], angles[1]), strict=True):
            if math.isfinite(angle_rad):
                wheel.wxyz = shapes.quaternion_z(angle_rad)
        _assign(self._frame, visible=True)

    def _place_wheels(self) -> None:
        corners = [(x, side) for x in (self._shape.wheelbase_m, 0.0) for side in (1, -1)]
        for wheel, (x_m, side) in zip(self._wheels, corners, strict=True):
            wheel.position = (x_m, side * self._shape.track_m / 2, self._shape.wheel_radius_m)


def drawable_points(path: DrawnTrajectory, origin: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """The (n, 3) points relative to `origin` that can be drawn, and their (n,) speeds."""
    x_m, y_m = path.x_m - origin[0], path.y_m - origin[1]
    with np.errstate(invalid="ignore"):
        good = (np.abs(x_m) < _FAR_M) & (np.abs(y_m) < _FAR_M) & np.isfinite(path.speed_mps)
    points = np.column_stack((x_m, y_m, np.full(len(x_m), _Z_TRAJECTORY_M)))[good]
    return points, path.speed_mps[good]


def _chevrons_along(points: FloatArray) -> tuple[npt.NDArray[np.float32], shapes.Faces]:
    """Arrow heads at even distances, pointing to the next point, which is the way of travel also in reverse."""
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


def _is_near(x_m: float, y_m: float, limit_m: float = _FAR_M) -> bool:
    return abs(x_m) < limit_m and abs(y_m) < limit_m  # false for NaN as well


def _stand(
    scene: viser.SceneApi, name: str, word: str, height_m: float, color: tuple[int, int, int]
) -> viser.FrameHandle:
    """The frame of a marker, with a post from the ground and a word on top."""
    frame = scene.add_frame(f"{ROOT}/{name}", show_axes=False, visible=False)
    post = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, height_m)]], dtype=np.float32)
    scene.add_line_segments(f"{ROOT}/{name}/post", post, color, thickness=0.07)
    scene.add_label(
        f"{ROOT}/{name}/word",
        word,
        position=(0.0, 0.0, height_m + 0.55),
        font_screen_scale=0.75,
        anchor="bottom-center",
    )
    return frame


def _place(node: viser.SceneNodeHandle, wanted: bool, x_m: float, y_m: float, origin: tuple[float, float]) -> None:
    x_m, y_m = x_m - origin[0], y_m - origin[1]
    shown = wanted and _is_near(x_m, y_m)
    if shown:
        node.position = (x_m, y_m, 0.0)
    _assign(node, visible=shown)


def _assign(node: viser.SceneNodeHandle, **values: object) -> None:
    """Assign what differs: viser sends a message for each assignment of some properties, changed or not."""
    for name, value in values.items():
        if getattr(node, name) != value:
            setattr(node, name, value)


def _part(scene: viser.SceneApi, name: str, mesh: shapes.Mesh, color: tuple[int, int, int]) -> viser.MeshHandle:
    vertices, faces = mesh
    return scene.add_mesh_simple(
        name, vertices.astype(np.float32), faces, color=color, flat_shading=True, side="double"
    )
