"""Distance of a vehicle from a path, along it as well as beside it.

The path is the polyline through a trajectory's points. The distance to it is the distance to its nearest segment, which
ends at two points: before the first point of the path, and behind the last, it is the distance to that point.

Where several stretches of a path lie together, as at a crossing or beside the opposite lane, the nearest one need not
be the one that the vehicle drives on. On each stretch the segment counts that is no further away than its neighbours.
The vehicle is *on* such a segment when the distance is at most `lateral_stop_m`, and the vehicle's heading within
`heading_stop_rad` of the heading at one of the segment's ends. It is *near* when it is on the segment and the distance
is at most `lateral_warn_m`. A segment that the vehicle is on is preferred to a nearer one that it is not on.

The segment is found in up to three steps. The cost of none of them grows with the length of the trajectory:

1. From the controller's segment, and from the one found last, go on or back to the one that the vehicle is beside, over
   `WALK` segments at most. Is the vehicle near it? Plain floats; two products where it is there already.
2. Which of the `WINDOW` segments before and after the one found last is it?
3. Which of all segments is it? They are grouped in blocks of `BLOCK`. No segment is nearer than the bounding box of its
   block, so only the blocks with the nearest boxes are looked at. The boxes are computed once for a trajectory: of a
   long one before it comes into force, of another one when it is first searched.
"""

import math
from collections.abc import Generator, Sequence
from typing import NamedTuple

import numpy as np

from vehicle_iface.pieces import PIECE, finish, slices
from vehicle_iface.profile import Deviation
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import FloatArray, IntArray, Trajectory
from vehicle_iface.units import NS_PER_MS, wrapped_rad

SEARCH_PERIOD_NS = 100 * NS_PER_MS
"""Least time between two searches of the whole path, but for one that a stop depends on."""
WALK = 8
WINDOW = 256
BLOCK = 128
MOST_BLOCKS = 1024
"""Blocks that a search looks at, at most: those with the nearest boxes. A million points that all lie within a few
metres are more, and a vehicle may be found off them that is on one of the others."""
_BLOCKS_AT_ONCE = 64
_TIE_M2 = 1e-6
"""Squares of the distance to the point between two segments, from one and from the other, differ by less."""


class PathPlace(NamedTuple):
    """The place on a path that belongs to a position."""

    segment: int
    """Index of the segment's first point."""
    distance_m: float
    """From the position to the segment; infinite where the coordinates are too large to tell."""
    heading_error_rad: float
    """Between the vehicle's heading and the heading at one end of the segment, the end that fits better; at least 0."""
    is_on: bool
    """Whether distance and heading are within the limits of a stop."""


class PathLocator:
    """Finds where the vehicle is on the path of one trajectory that has points. Does not raise.

    A trajectory of one point is a path of one segment without length.
    """

    __slots__ = (
        "_boxes",
        "_heading_rad",
        "_headings_rad",
        "_last",
        "_limits",
        "_near_square",
        "_searched_ns",
        "_x_m",
        "_xs_m",
        "_y_m",
        "_ys_m",
        "segment",
        "trajectory",
    )

    def __init__(self, trajectory: Trajectory, limits: Deviation, *, index: int, boxes: "Boxes | None" = None) -> None:
        """`index` is the trajectory point near which the vehicle is looked for first. Without `boxes` of the trajectory
        they are computed when they are needed."""
        self.trajectory = trajectory
        arrays = (trajectory.x_m, trajectory.y_m, trajectory.heading_rad)
        if len(trajectory) == 1:
            arrays = tuple(np.repeat(array, 2) for array in arrays)  # type: ignore[assignment]
        self._x_m, self._y_m, self._heading_rad = arrays  # (m + 1,)
        self._xs_m, self._ys_m, self._headings_rad = map(_as_floats, arrays)
        self._last = len(self._xs_m) - 2
        """Index of the last segment."""
        self._limits = limits
        self._near_square = limits.lateral_warn_m * limits.lateral_warn_m
        self._searched_ns: int | None = None
        self._boxes = boxes
        self.segment = min(index, self._last)
        """Where the vehicle was found last."""

    def is_near(self, index: int, x_m: float, y_m: float, heading_rad: float) -> bool:
        """Whether the vehicle is near the path, looked for at point `index` and where it was found last.

        `x_m`, `y_m` and `heading_rad` are in the trajectory's frame. False where it is further along the path from both
        than `WALK` segments.
        """
        return self._is_near_from(index if index < self._last else self._last, x_m, y_m, heading_rad) or (
            index != self.segment and self._is_near_from(self.segment, x_m, y_m, heading_rad)
        )

    def locate(self, state: VehicleState, *, may_begin_stop: bool) -> PathPlace:
        """The place of a vehicle that is not near: the nearest segment that it is on, else the nearest one.

        With `may_begin_stop` a vehicle is only found off its path after a search of the whole path. Otherwise such a
        search is done when none was done in the last `SEARCH_PERIOD_NS` of the state's stamps, and between two of them
        the answer comes from the segments around the last place.
        """
        place = self._nearest(np.array([self.segment - WINDOW]), 2 * WINDOW + 1, state)
        if not self._is_near_place(place) and (
            self._search_is_due(state.stamp_ns) or (may_begin_stop and not place.is_on)
        ):
            self._searched_ns = state.stamp_ns
            place = self._search(state)
        self.segment = place.segment
        return place

    def _is_near_from(self, i: int, x_m: float, y_m: float, heading_rad: float) -> bool:
        """Whether the vehicle is near, looked for from segment `i` on; where it is, that is where it was found last.

        Past a point means past the plane through it, as for the controller's index. What is no number, from coordinates
        beyond 1e150, is not near.
        """
        xs_m, ys_m, start = self._xs_m, self._ys_m, i
        while i < self._last and (
            (xs_m[i + 1] - xs_m[i]) * (x_m - xs_m[i + 1]) + (ys_m[i + 1] - ys_m[i]) * (y_m - ys_m[i + 1]) >= 0.0
        ):  # past the segment's second point
            i += 1
            if i - start > WALK:
                return False
        while 0 < i <= start and (
            (xs_m[i] - xs_m[i - 1]) * (x_m - xs_m[i]) + (ys_m[i] - ys_m[i - 1]) * (y_m - ys_m[i]) < 0.0
        ):  # not past its first point
            i -= 1
            if start - i > WALK:
                return False
        ex_m, ey_m = xs_m[i + 1] - xs_m[i], ys_m[i + 1] - ys_m[i]
        dx_m, dy_m = x_m - xs_m[i], y_m - ys_m[i]
        along = ex_m * dx_m + ey_m * dy_m
        if along > 0.0:
            square = ex_m * ex_m + ey_m * ey_m
            part = along / square if along < square else 1.0
            dx_m -= part * ex_m
            dy_m -= part * ey_m
        if not dx_m * dx_m + dy_m * dy_m <= self._near_square:
            return False
        limit_rad, headings_rad = self._limits.heading_stop_rad, self._headings_rad
        if (
            abs(wrapped_rad(heading_rad - headings_rad[i])) > limit_rad
            and abs(wrapped_rad(heading_rad - headings_rad[i + 1])) > limit_rad
        ):
            return False
        self.segment = i
        return True

    def _is_near_place(self, place: PathPlace) -> bool:
        return place.is_on and place.distance_m <= self._limits.lateral_warn_m

    def _search_is_due(self, stamp_ns: int) -> bool:
        """Stamps of a restarted vehicle may be earlier than those before."""
        return self._searched_ns is None or abs(stamp_ns - self._searched_ns) >= SEARCH_PERIOD_NS

    def _nearest(self, first: IntArray, length: int, state: VehicleState) -> PathPlace:
        """The nearest segment that the vehicle is on, else the nearest, of `length` from each of `first` (r,) on.

        Those of them that are before the path's first segment, or behind its last one, do not count.
        """
        limits = self._limits
        wanted = first[:, None] + np.arange(-1, length + 1)  # (r, 1 + length + 1), with a neighbour at either end
        i = np.clip(wanted, 0, self._last)
        with np.errstate(all="ignore"):
            x_m, y_m = self._x_m[i], self._y_m[i]
            ex_m, ey_m = self._x_m[i + 1] - x_m, self._y_m[i + 1] - y_m
            dx_m, dy_m = state.x_m - x_m, state.y_m - y_m
            part = (ex_m * dx_m + ey_m * dy_m) / (ex_m * ex_m + ey_m * ey_m)
            part = np.fmin(np.fmax(part, 0.0), 1.0)  # without length: no number, and then 0
            dx_m -= part * ex_m
            dy_m -= part * ey_m
            square = np.fmin(dx_m * dx_m + dy_m * dy_m, np.inf)  # no number, from an overflow: infinite
        square[i != wanted] = np.inf
        here = square[:, 1:-1]
        is_least = here <= np.minimum(square[:, :-2], square[:, 2:]) + _TIE_M2
        is_least &= here <= limits.lateral_stop_m * limits.lateral_stop_m
        i, here = i[:, 1:-1].ravel(), here.ravel()  # (r · length,)
        on = np.flatnonzero(is_least)
        on = on[self._heading_errors_rad(i[on], state.heading_rad) <= limits.heading_stop_rad]
        k = on[here[on].argmin()] if len(on) else here.argmin()
        return PathPlace(
            segment=int(i[k]),
            distance_m=math.sqrt(here[k]),
            heading_error_rad=float(self._heading_errors_rad(i[[k]], state.heading_rad)[0]),
            is_on=len(on) > 0,
        )

    def _heading_errors_rad(self, i: IntArray, heading_rad: float) -> FloatArray:
        """(m,) of the segments i, against the end that fits better: a path that is drawn coarsely turns in its
        points."""
        errors_rad = np.stack([self._heading_rad[i], self._heading_rad[i + 1]]) - heading_rad  # (2, m)
        errors_rad -= math.tau * np.rint(errors_rad / math.tau)
        least: FloatArray = np.abs(errors_rad).min(axis=0)
        return least

    def _search(self, state: VehicleState) -> PathPlace:
        """`_nearest` of the whole path."""
        if self._boxes is None:
            self._boxes = finish(compute_boxes(self._x_m, self._y_m))
        at_best = self._boxes.squares(state.x_m, state.y_m)  # (blocks,)
        best = self._nearest(np.array([BLOCK * at_best.argmin()]), BLOCK, state)
        # Beyond that there is neither a nearer segment nor one that the vehicle is on.
        reach_m = best.distance_m if best.is_on else max(best.distance_m, self._limits.lateral_stop_m)
        blocks = np.flatnonzero(at_best <= reach_m * reach_m)
        if len(blocks) > MOST_BLOCKS:
            blocks = blocks[np.argpartition(at_best[blocks], MOST_BLOCKS)[:MOST_BLOCKS]]
        for at in range(0, len(blocks), _BLOCKS_AT_ONCE):
            if self._is_near_place(best):
                break
            found = self._nearest(BLOCK * blocks[at : at + _BLOCKS_AT_ONCE], BLOCK, state)
            best = min(best, found, key=lambda place: (not place.is_on, place.distance_m))
        return best


def _as_floats(array: FloatArray) -> Sequence[float]:
    """`array` (n,) as a sequence of plain floats, without a copy."""
    return memoryview(array)  # type: ignore[arg-type]  # arrays are buffers at run time


def compute_boxes(x_m: FloatArray, y_m: FloatArray) -> Generator[None, None, "Boxes"]:
    """The bounding boxes of the blocks of a path through these points (m + 1,), in pieces."""
    last = len(x_m) - 1
    blocks = -(-last // BLOCK)
    low_m, high_m = np.empty((2, blocks)), np.empty((2, blocks))
    for part in slices(blocks, PIECE // BLOCK):
        begin = part.start * BLOCK
        first = np.arange(begin, part.stop * BLOCK, BLOCK)
        behind = np.minimum(first + BLOCK, last)  # the last segment's second end
        for row, values in enumerate((x_m, y_m)):
            of_part = values[begin : part.stop * BLOCK]
            low_m[row, part] = np.minimum(np.minimum.reduceat(of_part, first - begin), values[behind])
            high_m[row, part] = np.maximum(np.maximum.reduceat(of_part, first - begin), values[behind])
        yield
    return Boxes(low_m, high_m)


class Boxes:
    """The bounding boxes of a path's blocks."""

    def __init__(self, low_m: FloatArray, high_m: FloatArray) -> None:
        """Least and greatest coordinates (2, blocks): x, y."""
        self._low_m, self._high_m = low_m, high_m

    def squares(self, x_m: float, y_m: float) -> FloatArray:
        """(blocks,) the squares of the distances from a position to the boxes in m², 0 inside."""
        position_m = np.array([[x_m], [y_m]])
        with np.errstate(over="ignore"):
            beside_m = np.maximum(np.maximum(self._low_m - position_m, position_m - self._high_m), 0.0)
            squares: FloatArray = (beside_m * beside_m).sum(axis=0)
        return squares
