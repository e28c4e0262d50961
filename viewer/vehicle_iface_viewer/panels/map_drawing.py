"""The map: the drive from above, as SVG in metres.

Trajectory, route, track and what moves are definitions that the visible picture refers to, so that each is sent only
when it has changed, however often the picture is shown.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from vehicle_iface.telemetry import DrawnTrajectory, Snapshot
from vehicle_iface.telemetry.events import EventKind
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.box import Box
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.journey import LAST_M, Journey, Mark
from vehicle_iface_viewer.panels.text import css, plain
from vehicle_iface_viewer.scene.companion import COMPANION_COLOR, find_hindrance
from vehicle_iface_viewer.scene.markers import SPATIAL_COLOR

ROUTE, TRACK, VEHICLE, STALE = "#748fc0", "#f08c00", "#4dabf7", "#868e96"
_MARK_COLORS = {EventKind.STOP: "#ff922b", EventKind.FAULT: "#ff6b6b", EventKind.MODE: "#4dabf7"}
_MOST_POINTS = 400
"""Of the trajectory; the places of the drive are bounded already."""
_LINES_NS = 2 * NS_PER_S
"""Route and track so far are drawn again this often."""
_FAR_M = 1e5
_ARROW = "M1 0L-.8 .62L-.45 0L-.8 -.62z"


class MapDrawing:
    """The map of one drive: strings of HTML, each of which changes only when its content does."""

    def __init__(self) -> None:
        self.ahead = self.route = self.track = self.moving = self.picture = ""
        self._journey: Journey | None = None
        self._trajectory: DrawnTrajectory | None = None
        self._due_ns = 0
        self._origin: FloatArray | None = None
        self._ahead_m = self._driven_m = np.empty((0, 2))
        self._box: Box | None = None

    @property
    def visible(self) -> Box | None:
        """What is visible, in the frame of the drive; None before anything is known."""
        if self._box is None or self._origin is None:
            return None
        return replace(self._box, west=self._box.west + self._origin[0], south=self._box.south + self._origin[1])

    def update(self, view: View, journey: Journey) -> None:
        """Draw `view`, and the drive so far."""
        here = _place(view.snapshot)
        ahead = _positions(view.trajectory) if view.trajectory is not self._trajectory else self._ahead_m
        if journey is not self._journey or not 0 <= self._due_ns - view.now_ns < _LINES_NS:
            self._due_ns = view.now_ns + _LINES_NS
            self._draw_drive(journey, (here, ahead))
        if self._origin is None:
            return
        if view.trajectory is not self._trajectory:
            self._trajectory, self._ahead_m = view.trajectory, ahead
            self.ahead = _definition("vi-ahead", _line(ahead - self._origin, np.ones(len(ahead), np.bool_), ROUTE, 2.5))
        points = np.concatenate((self._driven_m, self._ahead_m, here)) - self._origin
        if self._box is None or not self._box.holds(points):
            self._box = Box.around(points)
        self.moving = self._moving(view, self._box) if len(here) else _definition("vi-moving", "")
        self.picture = _picture(self._box, [_mark(mark, self._origin, self._box) for mark in journey.marks])

    def draw_beside(self, shown: View, other: View) -> str:
        """Return the vehicle of another loop and its trajectory on this map; nothing where it cannot be drawn."""
        here = _place(other.snapshot)
        if self._origin is None or self._box is None or not len(here) or find_hindrance(shown, other):
            return _definition("vi-beside", "")
        assert other.snapshot is not None
        color = STALE if other.is_stale else css(COMPANION_COLOR)
        path = other.trajectory if other.trajectory and other.trajectory.frame_id == other.snapshot.frame_id else None
        ahead = _positions(path) - self._origin
        x, y = (here - self._origin)[0].tolist()
        size, heading = _unit(self._box) * 1.6, other.snapshot.heading_rad
        turn = -math.degrees(heading) if math.isfinite(heading) else 0.0
        return _definition(
            "vi-beside",
            _line(ahead, np.ones(len(ahead), np.bool_), color, 1.2)
            + f'<path d="{_ARROW}" transform="translate({x:.2f} {-y:.2f}) rotate({turn:.1f}) scale({size:.2f})" '
            f'fill="{color}" stroke="#000" stroke-width=".1"/><text x="{x + size:.2f}" y="{-y - size:.2f}" '
            f'font-size="{size:.2f}" fill="{color}">{plain(other.address)}</text>',
        )

    def _draw_drive(self, journey: Journey, others: tuple[FloatArray, ...]) -> None:
        """Draw route and track so far, as seldom as their size demands."""
        route, track = journey.route.positions_m(), journey.track.positions_m()
        points = np.concatenate((*others, track, route))
        if not len(points):
            return
        if journey is not self._journey or self._origin is None or np.abs(points[0] - self._origin).max() > _FAR_M:
            self._journey, self._origin, self._box = journey, np.round(points[0]), None
            self._trajectory, self._ahead_m, self.ahead = None, np.empty((0, 2)), ""
        self._driven_m = np.concatenate((track, route))
        self.route = _definition("vi-route", _line(route - self._origin, journey.route.joints(), ROUTE, 2.5))
        self.track = _definition("vi-track", _line(track - self._origin, journey.track.joints(), TRACK, 1.6))

    def _moving(self, view: View, box: Box) -> str:
        assert view.snapshot is not None
        assert self._origin is not None
        s, size = view.snapshot, _unit(box) * 1.6
        east, north = s.spatial_reference_x_m - self._origin[0], s.spatial_reference_y_m - self._origin[1]
        shape = ""
        if s.has_reference and abs(east) < LAST_M and abs(north) < LAST_M:
            shape = (
                f'<circle cx="{east:.2f}" cy="{-north:.2f}" r="{size:.2f}" fill="none" '
                f'stroke="{css(SPATIAL_COLOR)}" stroke-width="2.5" vector-effect="non-scaling-stroke"/>'
            )
        x, y = s.x_m - self._origin[0], s.y_m - self._origin[1]
        turn = -math.degrees(s.heading_rad) if math.isfinite(s.heading_rad) else 0.0
        shape += (
            f'<path d="{_ARROW}" transform="translate({x:.2f} {-y:.2f}) rotate({turn:.1f}) scale({size:.2f})" '
            f'fill="{STALE if view.is_stale else VEHICLE}" stroke="#000" stroke-width=".1"/>'
        )
        return _definition("vi-moving", shape)


def _place(snapshot: Snapshot | None) -> FloatArray:
    """Return the vehicle's place, (1, 2), or (0, 2) where it is not known."""
    if snapshot is None or not snapshot.has_state:
        return np.empty((0, 2))
    is_near = abs(snapshot.x_m) < LAST_M and abs(snapshot.y_m) < LAST_M
    return np.array([(snapshot.x_m, snapshot.y_m)] if is_near else [], dtype=np.float64).reshape(-1, 2)


def _positions(trajectory: DrawnTrajectory | None) -> FloatArray:
    if trajectory is None:
        return np.empty((0, 2))
    points = np.column_stack((trajectory.x_m, trajectory.y_m))
    points = points[(np.abs(points) < LAST_M).all(axis=1)]  # NaN is not below
    chosen = np.linspace(0, len(points) - 1, min(len(points), _MOST_POINTS)).astype(np.intp)
    return points[chosen]


def _definition(name: str, content: str) -> str:
    return f'<svg width="0" height="0" style="position:absolute"><defs><g id="{name}">{content}</g></defs></svg>'


def _line(points: FloatArray, is_joined: npt.NDArray[np.bool_], color: str, width: float) -> str:
    """Return a path of (n, 2) points, in steps of centimetres."""
    if len(points) < 2:
        return ""
    steps = np.diff(np.rint(points * (100.0, -100.0)).astype(np.int64), axis=0, prepend=0).tolist()
    path = "".join(f"{'l' if joined else 'm'}{x} {y}" for (x, y), joined in zip(steps, is_joined, strict=True))
    return (
        f'<path d="m{path[1:]}" transform="scale(.01)" fill="none" stroke="{color}" stroke-width="{width}" '
        'stroke-linejoin="round" vector-effect="non-scaling-stroke"/>'
    )


def _unit(box: Box) -> float:
    """Return a length that looks the same on each map, m."""
    return max(box.width, box.height) / 40.0


def _mark(mark: Mark, origin: FloatArray, box: Box) -> str:
    x, y, size = mark.x_m - origin[0], mark.y_m - origin[1], _unit(box) * 0.8
    color = _MARK_COLORS.get(mark.event.kind, STALE)
    words = plain(f"{mark.event.kind} {mark.event.name} {mark.event.text}")
    return (
        f'<path class="vi-mark" d="M0 -1L1 0L0 1L-1 0z" transform="translate({x:.1f} {-y:.1f}) scale({size:.2f})" '
        f'fill="{color}" stroke="#000" stroke-width=".15"><title>{words}</title></path>'
    )


def _picture(box: Box, marks: list[str]) -> str:
    length_m = _round_length(box.width / 3.0)
    unit = _unit(box)
    x, y = box.west + unit, -box.south - unit
    bar = (
        f'<path d="M{x:.1f} {y - unit / 2:.1f}v{unit / 2:.1f}h{length_m:g}v{-unit / 2:.1f}" fill="none" '
        'stroke="currentColor" stroke-width="1" vector-effect="non-scaling-stroke"/>'
        f'<text x="{x + unit / 2:.1f}" y="{y - unit / 2:.1f}" font-size="{unit * 1.6:.2f}" fill="currentColor">'
        f"{length_m:g} m</text>"
    )
    lines = "".join(f'<use href="#vi-{name}"/>' for name in ("ahead", "route", "track"))
    moving = "".join(f'<use href="#vi-{name}"/>' for name in ("beside", "moving"))
    top = -(box.south + box.height)
    return (
        f'<svg class="vi-map" viewBox="{box.west:.1f} {top:.1f} {box.width:.1f} {box.height:.1f}" '
        f'role="img" aria-label="map">{bar}{lines}{"".join(marks)}{moving}</svg>'
    )


def _round_length(most_m: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above `most_m`."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= most_m)
