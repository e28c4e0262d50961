"""Stops and faults, as pins on the trail."""

from __future__ import annotations

import numpy as np
import viser

from vehicle_iface.telemetry.events import EventKind
from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.journey import Mark
from vehicle_iface_viewer.scene.nodes import is_near

MARK_COLOR = (255, 146, 43)
_SIZE_M = 0.9
_KINDS = (EventKind.STOP, EventKind.FAULT)


class EventMarks:
    """One mesh of all pins, sent when there is a new one."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._shown: tuple[list[Mark], tuple[float, float]] = ([], (0.0, 0.0))
        vertices, faces = shapes.pin(_SIZE_M)
        self._mesh = scene.add_mesh_simple(
            f"{root}/events", vertices, faces, color=MARK_COLOR, flat_shading=True, side="double", visible=False
        )

    def show(self, marks: list[Mark], origin: tuple[float, float]) -> None:
        """Draw those of `marks` that are near `origin`."""
        if (marks, origin) == self._shown:
            return
        self._shown = (list(marks), origin)
        places = [(mark.x_m - origin[0], mark.y_m - origin[1]) for mark in marks if mark.event.kind in _KINDS]
        vertices, faces = shapes.pin(_SIZE_M)
        pins = [(vertices + np.array((x_m, y_m, 0.0)), faces) for x_m, y_m in places if is_near(x_m, y_m)]
        if pins:
            joined = shapes.join(pins)
            self._mesh.vertices, self._mesh.faces = joined[0].astype(np.float32), joined[1]
        self._mesh.visible = bool(pins)
