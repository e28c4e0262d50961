"""Find backward steps in a trajectory, and remove recording noise.

A controller takes point i+1 as passed when the vehicle is past the plane through it, across the step from point i
(`control.tracking`). A vehicle that drives on never passes a point that lies 5 mm *behind* the one before, so its index
stays there for good. Recordings have such steps from noise of the position, and many of them where the vehicle stood.

The direction of travel at a point is its heading, or the opposite one where its speed is negative. A step leads on when
it is within 60° of the direction of travel at either of its ends. At a change of direction both directions count, and
two points at one place (but for rounding), as in a dwell, are no step at all.
"""

import math
from collections import deque
from collections.abc import Generator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle_iface.errors import BackwardStepError
from vehicle_iface.pieces import finish, slices
from vehicle_iface.standstill import STANDING_MPS
from vehicle_iface.trajectory import FloatArray, IntArray, Trajectory
from vehicle_iface.value import Value

NOISE_M = 0.1
"""Noise of recorded positions: a point that does not lead on and is no further away than this is left out."""
LEAST_LEAD = 0.5
"""Share of a step's length that must be in the direction of travel: the cosine of 60°."""
ROUNDING_M = 1e-8
"""A step back of no more than this is rounding; a controller's index gets past it (`control.PASSED_TOLERANCE`)."""


class CleanedTrajectory(Value, frozen=True, kw_only=True):
    """A trajectory without backward steps, and the points that were changed for it."""

    trajectory: Trajectory
    """The given trajectory itself if nothing was changed."""
    dropped: IntArray
    """(k,) indices of the points that were left out, rising."""
    moved: IntArray
    """(m,) indices of the points that were moved to the place of a point before them, rising."""


class BackwardStep(NamedTuple):
    """A step against the direction of travel."""

    point: int
    """Index of the point that the step leads to, from the point before."""
    back_m: float
    """How far back the point lies, along the direction of travel; above 0."""

    def __str__(self) -> str:
        return f"point {self.point} lies {self.back_m:.4g} m behind point {self.point - 1} in the direction of travel"


def find_backward_step(trajectory: Trajectory) -> BackwardStep | None:
    """Return the first step back, which a controller's spatial index may never pass; None where there is none.

    That is a step against the direction of travel at both of its ends, next to a step that leads on: a path that leads
    back as a whole (a heading column or a sign of the speeds that is wrong) is not one.
    """
    return finish(find_backward_step_in_pieces(trajectory))


def find_backward_step_in_pieces(trajectory: Trajectory) -> Generator[None, None, BackwardStep | None]:
    """As `find_backward_step`; each piece takes well under 1 ms, however long the trajectory is."""
    turning: deque[IntArray] = deque()
    steps, dx_m, dy_m = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
    for part in slices(len(trajectory) - 1):
        points = slice(part.start, part.stop + 1)
        with np.errstate(over="ignore", invalid="ignore"):
            all_dx_m, all_dy_m = np.diff(trajectory.x_m[points]), np.diff(trajectory.y_m[points])
            moving = np.flatnonzero((all_dx_m != 0.0) | (all_dy_m != 0.0))
            # Each piece begins with the last step of the piece before.
            steps = np.concatenate((steps[-1:], part.start + moving))
            dx_m = np.concatenate((dx_m[-1:], all_dx_m[moving]))
            dy_m = np.concatenate((dy_m[-1:], all_dy_m[moving]))
            turns = np.flatnonzero(dx_m[1:] * dx_m[:-1] + dy_m[1:] * dy_m[:-1] < 0.0)
        if len(turns):
            is_turning = np.zeros(len(steps), dtype=bool)
            is_turning[turns] = is_turning[turns + 1] = True
            turning.append(steps[is_turning])
        yield
    if not turning:
        return None
    directions = yield from _find_directions(trajectory)
    while turning:
        first = turning.popleft()
        lead_m = directions.lead_m(first, first + 1)
        back = np.flatnonzero(lead_m < -ROUNDING_M)
        if len(back):
            return BackwardStep(int(first[back[0]]) + 1, -float(lead_m[back[0]]))
        yield
    return None


def drop_backward_steps(trajectory: Trajectory) -> CleanedTrajectory:
    """Leave out the points that do not lead on from the last point before them that does.

    What is kept has its time as before, and with these exceptions its place: a standstill (speeds of at most
    `STANDING_MPS`, all places within `NOISE_M` of the first) with steps to and fro in it becomes a dwell, its first
    and its last point at one place, without speed. A slow point and the last point of all are not left out but put at
    the place of the point before, so that no time is lost.

    Raises `BackwardStepError`, which names the point, where a point that does not lead on is further away than
    `NOISE_M`: that is no noise.
    """
    cleaned, directions = trajectory, finish(_find_directions(trajectory))
    points, places, dwells = _insert_dwells(trajectory, directions)
    if len(dwells):
        cleaned = _rebuild(trajectory, points, places, dwells)
        directions = finish(_find_directions(cleaned))
    while not directions.leading_on().all():
        # Once more where a point was left out that told the direction of travel of its neighbours.
        kept, kept_places = _remove_noise(cleaned, directions, points)
        cleaned = _rebuild(cleaned, kept, kept_places)
        directions = finish(_find_directions(cleaned))
        points, places = points[kept], places[kept_places]
    is_dropped = np.ones(len(trajectory), dtype=bool)
    is_dropped[points] = False
    return CleanedTrajectory(
        trajectory=cleaned,
        dropped=np.flatnonzero(is_dropped),
        moved=points[points != places],
    )


def _insert_dwells(trajectory: Trajectory, directions: "_Directions") -> tuple[IntArray, IntArray, IntArray]:
    """Reduce each noisy standstill to its first and last point: return the remaining points (k,), the points whose
    places they take, and whether each is in a dwell."""
    places, is_kept = np.arange(len(trajectory)), np.ones(len(trajectory), dtype=bool)
    is_dwell = np.zeros(len(trajectory), dtype=bool)
    is_slow = np.concatenate(([False], np.abs(trajectory.speed_mps) <= STANDING_MPS, [False]))
    edges = np.flatnonzero(is_slow[1:] != is_slow[:-1])
    for first, last in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
        if directions.is_noisy_standstill(first, last):
            is_kept[first + 1 : last] = False
            is_dwell[[first, last]] = True
            places[last] = first
    points = np.flatnonzero(is_kept)
    return points, places[points], np.flatnonzero(is_dwell[points])


def _remove_noise(trajectory: Trajectory, directions: "_Directions", numbers: IntArray) -> tuple[IntArray, IntArray]:
    """Return the points (k,) that lead on or must stay, and the points whose places they take.

    Messages name a point by its number in `numbers` (n,).
    """
    xs_m, ys_m, speeds_mps = (values.tolist() for values in (trajectory.x_m, trajectory.y_m, trajectory.speed_mps))
    leads, last, points, places = directions.leading_on().tolist(), len(trajectory) - 1, [0], [0]
    for i in range(1, last + 1):
        before = places[-1]
        if leads[i - 1] if before == i - 1 else directions.lead_on(np.array([before]), np.array([i]))[0]:
            points.append(i)
            places.append(i)
            continue
        away_m = math.hypot(xs_m[i] - xs_m[before], ys_m[i] - ys_m[before])
        if away_m > NOISE_M:
            raise BackwardStepError(
                f"point {numbers[i]} lies {away_m:.4g} m from point {numbers[before]} and not ahead of it, by heading "
                f"and sign of the speed: at most {NOISE_M} m is taken for noise and left out",
                point=int(numbers[i]),
            )
        if i == last or abs(speeds_mps[i]) <= STANDING_MPS:
            points.append(i)
            places.append(before)
    return np.array(points), np.array(places)


def _rebuild(trajectory: Trajectory, points: IntArray, places: IntArray, dwells: IntArray | None = None) -> Trajectory:
    """Build the trajectory of these points, each at its place in `places`; points in `dwells` are at rest."""
    columns = {name: getattr(trajectory, name)[points] for name in ("time_from_start_ns", "front_wheel_angle_rad")}
    columns |= {name: getattr(trajectory, name)[places] for name in ("x_m", "y_m", "heading_rad")}
    for name in ("speed_mps", "accel_mps2", "yaw_rate_radps"):
        columns[name] = getattr(trajectory, name)[points]
        if dwells is not None:
            columns[name][dwells] = 0.0
    return Trajectory(stamp_ns=trajectory.stamp_ns, frame_id=trajectory.frame_id, **columns)


def _find_directions(trajectory: Trajectory) -> Generator[None, None, "_Directions"]:
    """Find the directions of travel, in pieces."""
    count = len(trajectory)
    sign, before, after = (np.zeros(count, dtype=np.int8) for _ in range(3))
    for part in slices(count):
        speed_mps = trajectory.speed_mps[part]
        sign[part] = np.sign(speed_mps) * (np.abs(speed_mps) > STANDING_MPS)
        before[part] = _last_signs(sign[part], before[part.start - 1] if part.start else 0)
        yield
    for part in reversed([*slices(count)]):
        after[part] = _last_signs(sign[part][::-1], after[part.stop] if part.stop < count else 0)[::-1]
        yield
    if count and not before[-1]:  # nothing moves
        before[:] = after[:] = -1 if trajectory.speed_mps.sum() < 0.0 else 1
    for part in slices(count):
        both = before[part], after[part]
        before[part], after[part] = np.where(both[0], *both), np.where(both[1], *both[::-1])
        yield
    return _Directions(trajectory, sign, before, after)


def _last_signs(sign: npt.NDArray[np.int8], given: int) -> npt.NDArray[np.int8]:
    """Return (n,) of each sign the last one up to it that is not 0; `given` where there is none."""
    last = np.maximum.accumulate(np.where(sign, np.arange(len(sign)), -1))
    return np.where(last < 0, np.int8(given), sign[last])


class _Directions:
    """The directions of travel of a trajectory."""

    def __init__(
        self,
        trajectory: Trajectory,
        sign: npt.NDArray[np.int8],
        before: npt.NDArray[np.int8],
        after: npt.NDArray[np.int8],
    ) -> None:
        self._x_m, self._y_m, self._heading_rad = trajectory.x_m, trajectory.y_m, trajectory.heading_rad
        self._sign = sign
        """(n,) 0 where the vehicle stands."""
        self._before, self._after = before, after
        """(n,) direction of the last motion up to each point and the first after; either where one is missing."""

    def leading_on(self) -> npt.NDArray[np.bool_]:
        """Return (n − 1,) whether each point but the first leads on from the one before."""
        j = np.arange(1, len(self._sign))
        return self.lead_on(j - 1, j)

    def lead_m(self, i: IntArray, j: IntArray) -> FloatArray:
        """Return (m,) how far in m each point j lies ahead of point i in the direction of travel; negative when behind.

        Of the directions at the two points, the one with the greater result counts.
        """
        sign_i = np.where((self._sign[i] != 0.0) | (self._sign[j] == 0.0), self._before[i], self._sign[j])
        sign_j = np.where((self._sign[j] != 0.0) | (self._sign[i] == 0.0), self._after[j], self._sign[i])
        with np.errstate(over="ignore", invalid="ignore"):
            dx_m, dy_m = self._x_m[j] - self._x_m[i], self._y_m[j] - self._y_m[i]
            along_m = np.stack([self._along_m(end, dx_m, dy_m) for end in (i, j)])  # (2, m)
            lead_m: FloatArray = np.maximum(sign_i * along_m, sign_j * along_m).max(axis=0)
        return lead_m

    def lead_on(self, i: IntArray, j: IntArray) -> npt.NDArray[np.bool_]:
        """Return (m,) whether the step from each point i to point j leads on; a step without length does."""
        with np.errstate(over="ignore"):
            length_m = np.hypot(self._x_m[j] - self._x_m[i], self._y_m[j] - self._y_m[i])
        leads: npt.NDArray[np.bool_] = (self.lead_m(i, j) >= LEAST_LEAD * length_m) | (length_m <= ROUNDING_M)
        return leads

    def is_noisy_standstill(self, first: int, last: int) -> bool:
        """Return whether these slow points are at one place except for noise, and step to and fro there.

        At a change of direction, a short move in the first direction and then in the second is no noise.
        """
        i = np.arange(first, last)
        with np.errstate(over="ignore", invalid="ignore"):
            away_m = np.hypot(self._x_m[i + 1] - self._x_m[first], self._y_m[i + 1] - self._y_m[first])
            if not (away_m <= NOISE_M).all():
                return False
            dx_m, dy_m = self._x_m[i + 1] - self._x_m[i], self._y_m[i + 1] - self._y_m[i]
            on_m = self._before[first] * self._along_m(i, dx_m, dy_m)
        is_on = on_m[np.abs(on_m) > ROUNDING_M] > 0.0
        return bool(not self.lead_on(i, i + 1).all() or (is_on[1:] > is_on[:-1]).any())

    def _along_m(self, i: IntArray, dx_m: FloatArray, dy_m: FloatArray) -> FloatArray:
        """Return (m,) how far these steps lead along the headings of the points i."""
        heading_rad = self._heading_rad[i]
        along_m: FloatArray = np.cos(heading_rad) * dx_m + np.sin(heading_rad) * dy_m
        return along_m
