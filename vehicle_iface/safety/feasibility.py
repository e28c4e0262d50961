"""Feasibility of a trajectory: whether the vehicle's limits allow it.

Speeds and wheel angles are checked point by point. The curvature follows from the path's geometry, over windows of two
chords, each at least half a wheelbase or half a second long, so that neither rounding nor points close together look
like a turn. A window with both directions of travel is not checked: there the path has a cusp.
"""

import math
from collections.abc import Generator, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle_iface.pieces import Scratch, finish, slices
from vehicle_iface.profile import Limits
from vehicle_iface.safety.lateral import curvature_per_m
from vehicle_iface.standstill import CREEPING_MPS
from vehicle_iface.trajectory import FloatArray, IntArray, Trajectory

CHORD_S = 0.5
CHORD_WHEELBASES = 0.5
STEP_WHEELBASES = 0.125
"""Windows begin this far apart, or at each point where the points are farther apart than that."""
SLACK = 1.1
"""Factor on the limit: rounding of coordinates to a centimetre makes the sharpest turn look this much sharper."""
_WINDOWS = 256
"""Windows that are checked in one piece."""


def find_violation(trajectory: Trajectory, limits: Limits, wheelbase_m: float) -> str:
    """A point that asks for more than the limits allow, with the value and the limit; empty for none.

    Of values the first, of turns the sharpest.
    """
    return finish(find_violation_in_pieces(trajectory, limits, wheelbase_m))


def find_violation_in_pieces(trajectory: Trajectory, limits: Limits, wheelbase_m: float) -> Generator[None, None, str]:
    """As `find_violation`; each piece takes well under 1 ms, however long the trajectory is."""
    for name, limit in (
        ("speed_mps", limits.speed_max_mps),
        ("front_wheel_angle_rad", limits.front_wheel_angle_rad),
    ):
        values: FloatArray = getattr(trajectory, name)  # (n,)
        for part in slices(len(values)):
            beyond = np.abs(values[part]) > limit * (1.0 + 1e-9)
            if beyond.any():
                point = part.start + int(beyond.argmax())
                return f"{name}[{point}] = {values[point]:.10g}: must be in [{-limit}, {limit}]"
            yield
    return (yield from _find_sharp_turn(trajectory, limits, wheelbase_m)) if len(trajectory) > 2 else ""


def _find_sharp_turn(trajectory: Trajectory, limits: Limits, wheelbase_m: float) -> Generator[None, None, str]:
    arc_length = Scratch(len(trajectory))
    yield from _measure(trajectory, arc_length.numbers)
    turns = yield from _find_turns(trajectory.speed_mps)
    greatest, text = SLACK, ""
    for i in _window_starts(arc_length.numbers, STEP_WHEELBASES * wheelbase_m):
        excess, point_text = _excess_curvature(trajectory, limits, wheelbase_m, arc_length.numbers, turns, i)
        if excess > greatest:
            greatest, text = excess, point_text
        yield
    yield from arc_length.release()
    return text


class _Turns(NamedTuple):
    """The changes of the direction of travel, in the order of the points."""

    last: IntArray
    """(t,) the last point of the motion before each."""
    first: IntArray
    """(t + 1,) the first point of the motion after each, and a number beyond every point."""

    def are_between(self, i: IntArray, k: IntArray) -> npt.NDArray[np.bool_]:
        """(w,) whether there are points with both directions of travel among the points i to k, both included."""
        between: npt.NDArray[np.bool_] = self.first[np.searchsorted(self.last, i)] <= k
        return between


def _measure(trajectory: Trajectory, s_m: FloatArray) -> Generator[None]:
    """Write the length of the path up to each point into `s_m` (n,)."""
    s_m[0] = 0.0
    for part in slices(len(s_m) - 1):
        points = slice(part.start, part.stop + 1)
        with np.errstate(all="ignore"):  # points may lie as far apart as floats reach; what is no number is no turn
            chord_m = np.hypot(np.diff(trajectory.x_m[points]), np.diff(trajectory.y_m[points]))
            chord_m[0] += s_m[part.start]
            np.cumsum(chord_m, out=s_m[part.start + 1 : part.stop + 1])
        yield


def _find_turns(speed_mps: FloatArray) -> Generator[None, None, _Turns]:
    lasts, firsts = [], []
    point, sign = np.array([], dtype=np.int64), np.array([])
    for part in slices(len(speed_mps)):
        moving = np.flatnonzero(speed_mps[part])
        point = np.concatenate((point[-1:], part.start + moving))  # each piece begins with the last moving point before
        sign = np.concatenate((sign[-1:], np.sign(speed_mps[part][moving])))
        turns = np.flatnonzero(sign[1:] * sign[:-1] < 0.0)
        lasts.append(point[turns])
        firsts.append(point[turns + 1])
        yield
    return _Turns(np.concatenate(lasts), np.concatenate((*firsts, [len(speed_mps)])))


def _window_starts(s_m: FloatArray, step_m: float) -> Iterator[IntArray]:
    """The first points of the windows, `_WINDOWS` of them or fewer at a time."""
    last = len(s_m) - 1
    if not s_m[-1] < step_m * last:
        for part in slices(last, _WINDOWS):
            yield np.arange(part.start, part.stop)
        return
    before = -1
    for part in slices(math.ceil(s_m[-1] / step_m), _WINDOWS):
        i = np.searchsorted(s_m, np.arange(part.start, part.stop) * step_m)
        i = i[np.diff(i, prepend=before) > 0]  # each once; np.unique would import numpy.ma while the vehicle drives
        before = i[-1] if len(i) else before
        yield i


def _excess_curvature(
    trajectory: Trajectory, limits: Limits, wheelbase_m: float, s_m: FloatArray, turns: _Turns, i: IntArray
) -> tuple[float, str]:
    """Of the windows that begin at the points i, the greatest curvature as a part of the allowed one, and its text."""
    speed_mps = trajectory.speed_mps
    with np.errstate(all="ignore"):
        i, j, k, chord_m = _windows(trajectory, wheelbase_m, s_m, turns, i)
        slowest_mps = np.minimum(np.abs(speed_mps[i]), np.minimum(np.abs(speed_mps[j]), np.abs(speed_mps[k])))
        sharpest_per_m = max_curvature(slowest_mps, limits, wheelbase_m)
        by_positions = _of_positions(trajectory, i, j, k, chord_m)
        sharpness_per_m = np.maximum(by_positions, _of_headings(trajectory, i, j, chord_m))
        too_sharp = np.nan_to_num(sharpness_per_m / sharpest_per_m, nan=0.0)
    if not (too_sharp > SLACK).any():
        return 0.0, ""
    w = int(too_sharp.argmax())
    return float(too_sharp[w]), (
        f"the path turns by {sharpness_per_m[w]:.4g} rad/m at point {j[w]}: "
        f"must be at most {sharpest_per_m[w]:.4g} rad/m at {slowest_mps[w]:.4g} m/s"
    )


def max_curvature(speed_mps: FloatArray, limits: Limits, wheelbase_m: float) -> FloatArray:
    """(n,) the greatest curvature in 1/m that wheels and lateral acceleration allow at these speeds without sign."""
    table = np.array(limits.front_wheel_angle_by_speed)  # (rows, 2)
    front_rad = np.minimum(np.interp(speed_mps, table[:, 0], table[:, 1]), limits.front_wheel_angle_rad)
    by_wheels = curvature_per_m(0.0, -limits.rear_wheel_angle_rad, wheelbase_m) + np.tan(front_rad) / wheelbase_m
    by_force: FloatArray = limits.lateral_accel_mps2 / np.maximum(speed_mps, CREEPING_MPS) ** 2
    allowed: FloatArray = np.minimum(by_wheels, by_force)
    return allowed


def _windows(
    trajectory: Trajectory, wheelbase_m: float, s_m: FloatArray, turns: _Turns, i: IntArray
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """First, middle and last point of each window (w,) that begins at one of the points i, and its chords' lengths
    (2, w) in m."""
    x_m, y_m, last = trajectory.x_m, trajectory.y_m, len(s_m) - 1
    wanted_m = np.maximum(CHORD_WHEELBASES * wheelbase_m, CHORD_S * np.abs(trajectory.speed_mps[i]))
    j = np.minimum(np.searchsorted(s_m, s_m[i] + wanted_m), last)
    k = np.minimum(np.searchsorted(s_m, s_m[j] + wanted_m), last)
    chord_m = np.stack([np.hypot(x_m[b] - x_m[a], y_m[b] - y_m[a]) for a, b in ((i, j), (j, k))])
    # Shorter ones are of the path's end, or of a vehicle that stands while its position is measured again and again.
    is_long = (chord_m >= 0.5 * wanted_m).all(axis=0)
    kept = np.flatnonzero(is_long & ~turns.are_between(i, k))
    return i[kept], j[kept], k[kept], chord_m[:, kept]


def _of_positions(trajectory: Trajectory, i: IntArray, j: IntArray, k: IntArray, chord_m: FloatArray) -> FloatArray:
    """(w,) curvature of the circle through the three points (Menger); exact however coarsely a circle is drawn.

    Where the second chord leads back, as on a line driven up and down, the circle says nothing and the angle does.
    """
    x_m, y_m = trajectory.x_m, trajectory.y_m
    (ax, bx), (ay, by) = ((values[j] - values[i], values[k] - values[j]) for values in (x_m, y_m))
    area, along = np.abs(ax * by - ay * bx), ax * bx + ay * by
    lengths = chord_m[0] * chord_m[1]
    by_circle = 2.0 * area / (lengths * np.hypot(x_m[k] - x_m[i], y_m[k] - y_m[i]))
    by_angle = 2.0 * np.sqrt(np.clip(0.5 - 0.5 * along / lengths, 0.0, 1.0)) / chord_m.max(axis=0)
    curvature: FloatArray = np.where(along < 0.0, by_angle, by_circle)
    return curvature


def _of_headings(trajectory: Trajectory, i: IntArray, j: IntArray, chord_m: FloatArray) -> FloatArray:
    """(w,) curvature of the arc over the first chord whose ends have these headings."""
    turned_rad = trajectory.heading_rad[j] - trajectory.heading_rad[i]
    curvature: FloatArray = 2.0 * np.abs(np.sin(0.5 * turned_rad)) / chord_m[0]
    return curvature
