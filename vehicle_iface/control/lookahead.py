"""Search for the look-ahead point, without examining every point before it.

Between two points of a trajectory the distance to the vehicle changes by no more than the way between them.
So a point that lacks 3 m to the look-ahead is followed by 3 m of way on which no point can be far enough, and
the search goes on behind them: on a straight line it arrives in two or three such steps, however dense the
points are. (Sphere tracing: J. C. Hart, "Sphere tracing", The Visual Computer 12, 1996.) The way is measured
once for each point, as the look-ahead reaches it.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from vehicle_iface.control.tracking import as_numbers

_STEPS = 32
_FIRST_BLOCK, _GREATEST_BLOCK = 256, 16384
_MOST_MEASURED = 2**15
"""Maximum number of points measured by one search; beyond them it samples, until later searches have measured more."""
_ROUNDING = 1e-9
"""Error bound of the measured distance: relative, and in metres."""
_REACH = 4.0
"""Maximum search distance in look-aheads: longer than the circumference of a circle within reach."""
_LEAST_POINTS = 1024
"""Minimum number of points before `_REACH` ends a search."""
_SAMPLES = 1024
"""Maximum number of points examined: of more, this many at equal steps, and then those around the best."""


class ArcLength:
    """Path length up to each point, measured from a point behind the vehicle as far as needed."""

    __slots__ = ("_along", "_along_m", "measured", "xs_m", "ys_m")

    def __init__(self, xs_m: Sequence[float], ys_m: Sequence[float]) -> None:
        self.xs_m, self.ys_m = xs_m, ys_m
        self._along = np.empty(len(xs_m))  # (n,) filled as far as measured
        self._along_m: Sequence[float] = as_numbers(self._along)
        self.measured = 0
        """Index of the first point that is not measured yet."""

    def begin(self, index: int) -> None:
        """Measure up to point `index`, which never decreases between calls."""
        if index >= self.measured:
            self._along[index] = 0.0
            self.measured = index + 1

    def next(self, index: int, distance_m: float, end: int) -> int:
        """Return the first point after a measured one that is `distance_m` further along the path, but at most `end`
        or the first point not measured yet."""
        along_m = self._along_m
        wanted_m = (along_m[index] + distance_m) * (1.0 - _ROUNDING) - _ROUNDING
        if not wanted_m < math.inf:
            wanted_m = 0.0  # lengths that overflow cannot be compared: the next point
        index += 1
        measured = self.measured
        if measured < end and (index >= measured or along_m[measured - 1] < wanted_m):
            self._measure(index, wanted_m, end)
            measured = self.measured
        return bisect_left(along_m, wanted_m, index, min(measured, end)) if index < end else end

    def first_of_end(self, start: int, last: int, x_m: float, y_m: float) -> int:
        """Return the first point from `start` on at the place of `last`, if the path length alone shows that no point
        between is farther from (x_m, y_m): the path leads straight away, or stays. Otherwise −1."""
        if last >= self.measured:
            return -1
        along_m = self._along_m
        start_m = math.hypot(self.xs_m[start] - x_m, self.ys_m[start] - y_m)
        last_m = math.hypot(self.xs_m[last] - x_m, self.ys_m[last] - y_m)
        rounding_m = _ROUNDING * (1.0 + along_m[last])
        if not start_m + (along_m[last] - along_m[start]) <= last_m + rounding_m < math.inf:
            return -1
        return bisect_left(along_m, along_m[last], start, last)

    def _measure(self, index: int, wanted_m: float, end: int) -> None:
        at, size, along, along_m = self.measured, _FIRST_BLOCK, self._along, self._along_m
        end = min(end, at + _MOST_MEASURED)
        with np.errstate(over="ignore"):
            while at < end and (index >= at or along_m[at - 1] < wanted_m):
                stop = min(at + size, end)
                x, y = np.asarray(self.xs_m[at - 1 : stop]), np.asarray(self.ys_m[at - 1 : stop])  # (m + 1,)
                length, dy = x[1:] - x[:-1], y[1:] - y[:-1]  # (m,)
                length *= length
                dy *= dy
                length += dy
                np.sqrt(length, out=length)
                length[0] += along_m[at - 1]
                np.cumsum(length, out=along[at:stop])
                at, size = stop, min(2 * size, _GREATEST_BLOCK)
        self.measured = at


def search_target(
    arc: ArcLength,
    start: int,
    end: int,
    x_m: float,
    y_m: float,
    ahead_x: float,
    ahead_y: float,
    lookahead_m: float,
) -> int:
    """Return the first of the points start..end−1 that is ahead of (x_m, y_m) and at least the look-ahead away.

    Ahead is where (p − s) · (ahead_x, ahead_y) > 0. Without such a point: the farthest that is ahead, or −1.
    `start` never decreases from one search on an `ArcLength` to the next. A search ends four look-aheads (and 1024
    points) further along the path, and it samples beyond 32768 points that are not measured yet, so
    that its cost does not depend on how long the trajectory is.
    """
    xs_m, ys_m, reach, index = arc.xs_m, arc.ys_m, lookahead_m * lookahead_m, start
    arc.begin(start)
    enough = arc.measured + _MOST_MEASURED
    for _ in range(_STEPS):
        dx_m, dy_m = xs_m[index] - x_m, ys_m[index] - y_m
        square, ahead_m = dx_m * dx_m + dy_m * dy_m, dx_m * ahead_x + dy_m * ahead_y
        if square >= reach and ahead_m > 0.0:
            return index
        lacking_m = lookahead_m - math.sqrt(square)
        index = arc.next(index, lacking_m if lacking_m >= -ahead_m else -ahead_m, end)
        if index >= end:
            return _farthest(arc, start, end, x_m, y_m, ahead_x, ahead_y)
        if index >= arc.measured or arc.measured >= enough:
            stop = end
            break
    else:
        stop = min(end, max(start + _LEAST_POINTS, arc.next(start, _REACH * lookahead_m, end)))
    found = _first_beyond(arc, index, stop, x_m, y_m, ahead_x, ahead_y, reach) if index < stop else -1
    return found if found >= 0 else _farthest(arc, start, stop, x_m, y_m, ahead_x, ahead_y)


def _first_beyond(
    arc: ArcLength, start: int, stop: int, x_m: float, y_m: float, ahead_x: float, ahead_y: float, reach: float
) -> int:
    """Search point by point, with the square of the look-ahead; −1 when no point qualifies."""
    step = -(-(stop - start) // _SAMPLES)
    beyond = _squares_ahead(arc, slice(start, stop, step), x_m, y_m, ahead_x, ahead_y) >= reach
    if not beyond.any():
        return -1
    found = start + step * int(beyond.argmax())
    if step == 1 or found == start:
        return found
    near = _squares_ahead(arc, slice(found - min(step, _SAMPLES) + 1, found + 1), x_m, y_m, ahead_x, ahead_y)
    return found - len(near) + 1 + int((near >= reach).argmax())


def _farthest(arc: ArcLength, start: int, stop: int, x_m: float, y_m: float, ahead_x: float, ahead_y: float) -> int:
    """Return the first of the farthest points ahead; −1 when no point is ahead."""
    last = stop - 1
    is_behind = (arc.xs_m[start] - x_m) * ahead_x + (arc.ys_m[start] - y_m) * ahead_y <= 0.0
    if is_behind and start < last:
        start += 1  # what the vehicle has just passed
    if (arc.xs_m[last] - x_m) * ahead_x + (arc.ys_m[last] - y_m) * ahead_y > 0.0:
        found = arc.first_of_end(start, last, x_m, y_m)
        if found >= 0:
            return found
    step = -(-(stop - start) // _SAMPLES)
    begin = start + (stop - 1 - start) % step  # so that the last point is looked at
    squares = _squares_ahead(arc, slice(begin, stop, step), x_m, y_m, ahead_x, ahead_y)
    best = int(squares.argmax())
    if squares[best] < 0.0:
        return -1
    found = begin + step * best
    if step == 1:
        return found
    around = min(step, _SAMPLES) - 1
    near = slice(max(found - around, start), min(found + around + 1, stop))
    return near.start + int(_squares_ahead(arc, near, x_m, y_m, ahead_x, ahead_y).argmax())


def _squares_ahead(
    arc: ArcLength, points: slice, x_m: float, y_m: float, ahead_x: float, ahead_y: float
) -> np.typing.NDArray[np.float64]:
    """Return (m,) squared distances in m²; −1 for points that are not ahead."""
    with np.errstate(over="ignore", invalid="ignore"):
        dx, dy = np.asarray(arc.xs_m[points]) - x_m, np.asarray(arc.ys_m[points]) - y_m
        ahead = dx * ahead_x + dy * ahead_y > 0.0
        dx *= dx
        dy *= dy
        dx += dy
        dx[~ahead] = -1.0
    return dx
