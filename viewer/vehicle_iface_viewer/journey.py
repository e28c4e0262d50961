"""The whole drive in its own frame: where the vehicle was, where its reference was, and where events were."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.playback import Playback
from vehicle_iface_viewer.recent import RecentSnapshots

MAX_POINTS = 600
_MAX_MARKS = 60
_FIRST_STEP_M = 0.5
_JUMP_M = 20.0
LAST_M = 1e9
"""No place farther from the origin of the drive's frame is kept."""
_MARKED = (EventKind.STOP, EventKind.FAULT, EventKind.MODE)


class _Point(NamedTuple):
    x_m: float
    y_m: float
    is_joined: bool
    """With the point before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """An event, at the place where the vehicle was."""

    x_m: float
    y_m: float
    event: LoopEvent


class Places:
    """A line of a bounded number of points. When there are too many, every second one is dropped."""

    def __init__(self) -> None:
        self._points: list[_Point] = []
        self._step_m = _FIRST_STEP_M
        self.changes = 0
        """Increases with each change."""

    def __len__(self) -> int:
        return len(self._points)

    def clear(self) -> None:
        """Remove all points."""
        self._points.clear()
        self._step_m = _FIRST_STEP_M
        self.changes += 1

    def add(self, x_m: float, y_m: float) -> None:
        """Add a place, if it is far enough from the one before; one that is very far away is not joined to it."""
        if not (abs(x_m) < LAST_M and abs(y_m) < LAST_M):  # true for NaN
            return
        distance_m = math.dist(self._points[-1][:2], (x_m, y_m)) if self._points else math.inf
        if distance_m < self._step_m:
            return
        self._points.append(_Point(x_m, y_m, distance_m <= max(_JUMP_M, 2 * self._step_m)))
        self.changes += 1
        if len(self._points) > MAX_POINTS:
            self._thin_out()

    def positions_m(self) -> FloatArray:
        """Return the points, (n, 2)."""
        return np.array([point[:2] for point in self._points], dtype=np.float64).reshape(-1, 2)

    def joints(self) -> npt.NDArray[np.bool_]:
        """Return (n,) whether each point is joined to the one before."""
        return np.array([point.is_joined for point in self._points], dtype=np.bool_)

    def _thin_out(self) -> None:
        pairs = zip(self._points[::2], [_Point(0.0, 0.0, True), *self._points[1::2]], strict=False)
        self._points = [point._replace(is_joined=point.is_joined and dropped.is_joined) for point, dropped in pairs]
        self._step_m *= 2


class Journey:
    """The drive from its beginning, or from when the viewer was started."""

    def __init__(self) -> None:
        self.track, self.route = Places(), Places()
        self.marks: list[Mark] = []
        """The newest ones."""
        self._marked = 0

    def clear(self) -> None:
        """Forget the drive."""
        self.track.clear()
        self.route.clear()
        self.marks.clear()
        self._marked = 0

    def add(self, snapshot: Snapshot) -> None:
        """Add the places of the vehicle and of its reference, where they are known."""
        if snapshot.has_state:
            self.track.add(snapshot.x_m, snapshot.y_m)
            if snapshot.has_reference:
                self.route.add(snapshot.spatial_reference_x_m, snapshot.spatial_reference_y_m)

    @classmethod
    def of(cls, playback: Playback) -> Journey:
        """Return the whole drive of a recording."""
        whole = cls()
        for snapshot in playback.sample(2 * MAX_POINTS):
            whole.add(snapshot)
        for event in filter(_is_marked, playback.all_events()):
            place = playback.at(event.at_ns)
            if place is not None and place.has_state:
                whole._mark(event, place.x_m, place.y_m)
        return whole

    def mark(self, events: deque[LoopEvent], recent: RecentSnapshots) -> None:
        """Mark the stops, faults and changes of state that are new, at the vehicle's place at that time."""
        if not events or events[-1].number == self._marked:
            return
        for event in events:
            if event.number <= self._marked or not _is_marked(event):
                continue
            rows = recent.between(event.at_ns - NS_PER_S // 2, event.at_ns + NS_PER_S // 20)
            if len(rows) and rows[-1]["has_state"]:
                self._mark(event, float(rows[-1]["x_m"]), float(rows[-1]["y_m"]))
        self._marked = events[-1].number

    def _mark(self, event: LoopEvent, x_m: float, y_m: float) -> None:
        if abs(x_m) < LAST_M and abs(y_m) < LAST_M:
            self.marks.append(Mark(x_m=x_m, y_m=y_m, event=event))
            del self.marks[:-_MAX_MARKS]


def _is_marked(event: LoopEvent) -> bool:
    return event.kind in _MARKED and event.phase is not Phase.ENDED
