"""Stops along a trajectory: where the vehicle must stand before it goes on.

A stop is a dwell or a change of direction. A dwell is two or more points without speed at one place with
different times; a change of direction is the last point before the speed has the other sign. The vehicle goes
on from a stop when the time of its last point has come and the vehicle stands. A stop that the vehicle is at
when the trajectory begins, like a standing start, only waits for its time.

Other points without speed, and those after the last motion, are ordinary points.

All stops are found once for a trajectory, in pieces; finding the next one then costs a bisection.
"""

from bisect import bisect_left
from collections.abc import Generator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle_iface.control.tracking import PathProgress, as_numbers
from vehicle_iface.pieces import slices
from vehicle_iface.trajectory import FloatArray, IntArray, Trajectory

_NO_SPEED_MPS = 1e-3
_SAME_PLACE_M = 1e-3


class Stops(NamedTuple):
    """All places of a trajectory where the vehicle may have to stand, and its stretches of motion in one direction."""

    firsts: Sequence[int] = ()
    """The first point of each stop."""
    lasts: Sequence[int] = ()
    """The last point of each stop."""
    signs: Sequence[int] = ()
    """Of each stretch of motion: 1 or −1."""
    moving_lasts: Sequence[int] = ()
    """The last point of each stretch of motion."""


def find_stops(trajectory: Trajectory) -> Generator[None, None, Stops]:
    """Find all stops of a trajectory with points, in pieces."""
    begins = yield from _stretches(trajectory.speed_mps)  # (m,)
    if len(begins) == 1:  # nothing but motion in one direction, or none at all
        sign = int(_signs(trajectory.speed_mps[:1])[0])
        return Stops(signs=(sign,), moving_lasts=(len(trajectory) - 1,)) if sign else Stops()
    signs = _signs(trajectory.speed_mps[begins])  # (m,)
    moving = np.flatnonzero(signs)
    lasts = np.append(begins[1:], len(trajectory)) - 1
    motion = signs[moving]
    turn = begins[moving[1:][motion[1:] != motion[:-1]]] - 1
    resting = np.flatnonzero((signs == 0) & (lasts > begins))
    resting = resting[: np.searchsorted(resting, moving[-1])]
    if len(resting):  # with motion after it
        first, last = yield from _dwells(trajectory, int(begins[resting[0]]), int(lasts[resting[-1]]))
        turn = turn[~np.isin(turn, last)]
        first, last = np.concatenate([first, turn]), np.concatenate([last, turn])
        order = last.argsort()
        first, last = first[order], last[order]
    else:
        first = last = turn
    return Stops(
        firsts=as_numbers(first),
        lasts=as_numbers(last),
        signs=as_numbers(motion),
        moving_lasts=as_numbers(lasts[moving]),
    )


class StopSchedule:
    """The next stop on one trajectory, and the direction of travel towards it."""

    __slots__ = (
        "_all",
        "_count",
        "direction",
        "first",
        "last",
        "must_stand",
        "turns",
    )

    def __init__(self, progress: PathProgress, stops: Stops) -> None:
        """Of a trajectory with points, and with these stops, seen from its spatial index on."""
        self._all = stops
        self._count = progress.last + 1
        self.direction = 1.0
        """Of travel up to the next stop: 1.0 forwards, −1.0 backwards."""
        self.first = self._count
        """First point of the next stop; the number of points when there is none."""
        self.last = self._count
        """Last point of the next stop: its time is when the vehicle goes on."""
        self.turns = False
        """Whether the direction of travel changes at the next stop."""
        self.must_stand = False
        """Whether the vehicle has to come to rest at the next stop, as one that saw it ahead; otherwise it
        only waits for the stop's time."""
        self.resume(progress.spatial_index)

    def resume(self, index: int) -> None:
        """Go on to the next stop that does not end before point `index`."""
        self.must_stand = self.turns = False
        sign = self._sign(index)
        self.direction = float(sign)
        for stop in range(bisect_left(self._all.lasts, index), len(self._all.lasts)):
            self.first, self.last = self._all.firsts[stop], self._all.lasts[stop]
            self.turns = self._sign(self.last + 1) != sign
            if self.turns or self.first < self.last:
                return  # otherwise a change of direction that `index` is past
        self.first = self.last = self._count

    def release(self, index: int) -> None:
        """Go on from this stop, with the vehicle past point `index`."""
        self.resume(max(self.last + 1, index))

    def _sign(self, index: int) -> int:
        """Of the first speed from point `index` on; of the last one where there is no more."""
        signs, moving_lasts = self._all.signs, self._all.moving_lasts
        return signs[min(bisect_left(moving_lasts, index), len(signs) - 1)] if signs else 1


def _signs(speed_mps: npt.NDArray[np.float64]) -> npt.NDArray[np.int8]:
    """(n,) 1, −1, or 0 for no speed."""
    forwards, backwards = speed_mps > _NO_SPEED_MPS, speed_mps < -_NO_SPEED_MPS
    return forwards.view(np.int8) - backwards.view(np.int8)


def _stretches(speed_mps: FloatArray) -> Generator[None, None, IntArray]:
    """(m,) the first point of each stretch of equal sign."""
    found = [np.zeros(1, dtype=np.int64)]
    for part in slices(len(speed_mps) - 1):
        sign = _signs(speed_mps[part.start : part.stop + 1])
        changes = np.flatnonzero(sign[1:] != sign[:-1])
        if len(changes):
            found.append(changes + (part.start + 1))
        yield
    return np.concatenate(found)


def _dwells(trajectory: Trajectory, begin: int, end: int) -> Generator[None, None, tuple[IntArray, IntArray]]:
    """First and last point of each dwell among the points begin..end; both (k,)."""
    stays = np.zeros(end - begin + 2, dtype=bool)  # led and followed by a point that does not
    for part in slices(end - begin):
        stays[part.start + 1 : part.stop + 1] = _stays(trajectory, slice(begin + part.start, begin + part.stop + 1))
        yield
    edges = begin + np.flatnonzero(stays[1:] != stays[:-1])
    return edges[::2], edges[1::2]


def _stays(trajectory: Trajectory, points: slice) -> npt.NDArray[np.bool_]:
    """(m − 1,) whether each of the m points but the last stands together with the next one, which is
    later."""
    rests = np.abs(trajectory.speed_mps[points]) <= _NO_SPEED_MPS
    x, y, time = trajectory.x_m[points], trajectory.y_m[points], trajectory.time_from_start_ns[points]
    with np.errstate(over="ignore"):
        dx, dy = x[1:] - x[:-1], y[1:] - y[:-1]
        dx *= dx
        dy *= dy
        dx += dy
    stays: npt.NDArray[np.bool_] = dx <= _SAME_PLACE_M * _SAME_PLACE_M
    stays &= rests[1:]
    stays &= rests[:-1]
    stays &= time[1:] > time[:-1]
    return stays
