"""The picture and the map of a time that one browser looks back to, while the loop runs on."""

from __future__ import annotations

from dataclasses import replace

import viser

from vehicle_iface.telemetry import Snapshot, WriterState
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.box import Box
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.journey import Journey
from vehicle_iface_viewer.panels.map_drawing import MapDrawing
from vehicle_iface_viewer.recent import RecentSnapshots
from vehicle_iface_viewer.scene.nodes import PAST, Place
from vehicle_iface_viewer.scene.scene import Scene
from vehicle_iface_viewer.watched import MAP_EVERY

_JUMP_NS = NS_PER_S


class Past:
    """A scene of one browser; the one of the present is hidden meanwhile."""

    def __init__(self, client: viser.ClientHandle, journey: Journey) -> None:
        """`journey`: the whole drive, which is shown in the past as well."""
        self.map = MapDrawing()
        self.place: Place | None = None
        self._journey = journey
        self._scene = Scene(client.scene, PAST, journey)
        self._shown_ns = 0
        self._jumps = 0
        self._view: View | None = None

    @property
    def drive(self) -> Box | None:
        """What holds the whole drive, relative to the local origin of the scene."""
        return self._scene.relative(self.map.visible)

    def update(self, present: View, recent: RecentSnapshots, at_ns: int, tick: int) -> None:
        """Show the time `at_ns` of the drive that `present` is of: the picture each time, the map in turns."""
        if at_ns != self._shown_ns:
            if not 0 <= at_ns - self._shown_ns < _JUMP_NS:
                self._jumps += 1
            self._shown_ns = at_ns
            self._view = replace(view_at(present, recent, at_ns), session=self._jumps)
            self.place = self._scene.draw(self._view, recent)
        if tick % MAP_EVERY == MAP_EVERY - 2 and self._view is not None:
            self.map.update(self._view, self._journey)


def view_at(present: View, recent: RecentSnapshots, at_ns: int) -> View:
    """Return what the page knows of the time `at_ns`: the last snapshot before it, if it is kept."""
    rows = recent.between(at_ns - NS_PER_S, at_ns)
    if not len(rows) or present.snapshot is None:
        return replace(present, snapshot=None, now_ns=at_ns)
    values = {name: rows[name][-1].item() for name in rows.dtype.names or ()}
    snapshot = Snapshot(**values, frame_id=present.snapshot.frame_id)
    path = present.trajectory
    is_same = path is not None and path.version == snapshot.trajectory_version
    return replace(
        present,
        now_ns=at_ns,
        snapshot=snapshot,
        trajectory=path if is_same else None,
        writer_state=WriterState.LIVE,
        recording="the past",
    )
