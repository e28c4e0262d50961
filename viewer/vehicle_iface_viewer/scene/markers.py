"""The markers: spatial reference, temporal reference and look-ahead point."""

from __future__ import annotations

import numpy as np
import viser

from vehicle_iface.telemetry import Snapshot
from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.scene.nodes import assign_changed, is_near

SPATIAL_COLOR = (255, 169, 77)
TEMPORAL_COLOR = (230, 110, 255)
LOOKAHEAD_COLOR = (102, 217, 232)
_SPATIAL_POST_M, _TEMPORAL_POST_M = 2.3, 3.7
_NO_SNAPSHOT = Snapshot(0, 0, 0)


class Markers:
    """The two references and the look-ahead point; each has its own shape, colour, height and label.

    The references are mostly under the vehicle, so they are drawn on posts above it.
    """

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        ball = scene.add_icosphere(f"{root}/spatial/ball", radius=0.38, color=SPATIAL_COLOR, subdivisions=2)
        ball.position = (0.0, 0.0, _SPATIAL_POST_M)
        cube = scene.add_box(f"{root}/temporal/cube", color=TEMPORAL_COLOR, dimensions=(0.6, 0.6, 0.6))
        cube.position = (0.0, 0.0, _TEMPORAL_POST_M)
        vertices, faces = shapes.pin(0.8)
        scene.add_mesh_simple(
            f"{root}/lookahead/pin", vertices, faces, color=LOOKAHEAD_COLOR, flat_shading=True, side="double"
        )
        self._spatial = _add_marker(scene, root, "spatial", "spatial ref", _SPATIAL_POST_M, SPATIAL_COLOR)
        self._temporal = _add_marker(scene, root, "temporal", "temporal ref", _TEMPORAL_POST_M, TEMPORAL_COLOR)
        self._lookahead = _add_marker(scene, root, "lookahead", "look-ahead", 0.9, LOOKAHEAD_COLOR)

    def show(self, snapshot: Snapshot | None, origin: tuple[float, float]) -> None:
        """Move the markers to `snapshot`; those without a valid position are hidden."""
        s = snapshot or _NO_SNAPSHOT
        _move(self._spatial, s.has_reference, s.spatial_reference_x_m, s.spatial_reference_y_m, origin)
        _move(self._temporal, s.has_reference, s.temporal_reference_x_m, s.temporal_reference_y_m, origin)
        _move(self._lookahead, s.has_lookahead, s.lookahead_x_m, s.lookahead_y_m, origin)


def _add_marker(
    scene: viser.SceneApi, root: str, name: str, label: str, height_m: float, color: tuple[int, int, int]
) -> viser.FrameHandle:
    """Return the frame of a marker, with a post from the ground and a label on top."""
    frame = scene.add_frame(f"{root}/{name}", show_axes=False, visible=False)
    post = np.array([[(0.0, 0.0, 0.0), (0.0, 0.0, height_m)]], dtype=np.float32)
    scene.add_line_segments(f"{root}/{name}/post", post, color, thickness=0.07)
    scene.add_label(
        f"{root}/{name}/label",
        label,
        position=(0.0, 0.0, height_m + 0.55),
        font_screen_scale=0.75,
        anchor="bottom-center",
    )
    return frame


def _move(node: viser.SceneNodeHandle, is_valid: bool, x_m: float, y_m: float, origin: tuple[float, float]) -> None:
    x_m, y_m = x_m - origin[0], y_m - origin[1]
    is_shown = is_valid and is_near(x_m, y_m)
    if is_shown:
        node.position = (x_m, y_m, 0.0)
    assign_changed(node, visible=is_shown)
