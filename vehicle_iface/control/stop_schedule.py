"""Stops along a trajectory: where the vehicle must stand before it goes on.

A stop is a dwell or a change of direction. A dwell is two or more points without speed at one place with
different times; a change of direction is the last point before the speed has the other sign. The vehicle goes
on from a stop when the time of its last point has come and the vehicle stands. A stop that the vehicle is at
when the trajectory begins, like a standing start, only waits for its time.

Other points without speed, and those after the last motion, are ordinary points.

All stops are found in one vectorised pass when a trajectory is first followed; finding the next one then costs
a bisection.
"""

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from vehicle_iface.control.tracking import PathProgress, as_numbers

_NO_SPEED_MPS = 1e-3
_SAME_PLACE_M = 1e-3
_BLOCK = 16384


class StopSchedule:
    """The next stop on one trajectory, and the direction of travel towards it."""

    __slots__ = (
        "_count",
        "_firsts",
        "_lasts",
        "_moving_lasts",
        "_signs",
        "direction",
        "first",
        "last",
        "must_stand",
        "turns",
    )

    def __init__(self, progress: PathProgress) -> None:
        """Of a trajectory with points, seen from its spatial index on."""
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
        self._firsts: Sequence[int] = ()
        self._lasts: Sequence[int] = ()
        self._signs: Sequence[int] = ()
        """Of each stretch of motion in one direction: 1 or −1."""
        self._moving_lasts: Sequence[int] = ()
        """The last point of each."""
        self._find(progress)
        self.resume(progress.spatial_index)

    def resume(self, index: int) -> None:
        """Go on to the next stop that does not end before point `index`."""
        self.must_stand = self.turns = False
        sign = self._sign(index)
        self.direction = float(sign)
        for stop in range(bisect_left(self._lasts, index), len(self._lasts)):
            self.first, self.last = self._firsts[stop], self._lasts[stop]
            self.turns = self._sign(self.last + 1) != sign
            if self.turns or self.first < self.last:
                return  # otherwise a change of direction that `index` is past
        self.first = self.last = self._count

    def release(self, index: int) -> None:
        """Go on from this stop, with the vehicle past point `index`."""
        self.resume(max(self.last + 1, index))

    def _sign(self, index: int) -> int:
        """Of the first speed from point `index` on; of the last one where there is no more."""
        if not self._signs:
            return 1
        return self._signs[min(bisect_left(self._moving_lasts, index), len(self._signs) - 1)]

    def _find(self, progress: PathProgress) -> None:
        begins = _stretches(progress.speeds_mps)  # (m,)
        if len(begins) == 1:  # nothing but motion in one direction, or none at all
            sign = int(_signs(np.asarray(progress.speeds_mps[:1]))[0])
            self._signs, self._moving_lasts = ((sign,), (self._count - 1,)) if sign else ((), ())
            return
        signs = _signs(np.asarray(progress.speeds_mps)[begins])  # (m,)
        moving = np.flatnonzero(signs)
        lasts = np.append(begins[1:], self._count) - 1
        self._signs, self._moving_lasts = as_numbers(signs[moving]), as_numbers(lasts[moving])
        motion = signs[moving]
        turn = begins[moving[1:][motion[1:] != motion[:-1]]] - 1
        resting = np.flatnonzero((signs == 0) & (lasts > begins))
        resting = resting[: np.searchsorted(resting, moving[-1])]
        if len(resting):  # with motion after it
            first, last = _dwells(progress, int(begins[resting[0]]), int(lasts[resting[-1]]))
            turn = turn[~np.isin(turn, last)]
            first, last = np.concatenate([first, turn]), np.concatenate([last, turn])
            order = last.argsort()
            first, last = first[order], last[order]
        else:
            first = last = turn
        self._firsts, self._lasts = as_numbers(first), as_numbers(last)


def _signs(speed_mps: npt.NDArray[np.float64]) -> npt.NDArray[np.int8]:
    """(n,) 1, −1, or 0 for no speed."""
    forwards, backwards = speed_mps > _NO_SPEED_MPS, speed_mps < -_NO_SPEED_MPS
    return forwards.view(np.int8) - backwards.view(np.int8)


def _stretches(speeds_mps: Sequence[float]) -> npt.NDArray[np.int64]:
    """(m,) the first point of each stretch of equal sign; in blocks that stay in the processor's cache."""
    found = [np.zeros(1, dtype=np.int64)]
    for at in range(0, len(speeds_mps) - 1, _BLOCK):
        sign = _signs(np.asarray(speeds_mps[at : at + _BLOCK + 1]))
        changes = np.flatnonzero(sign[1:] != sign[:-1])
        if len(changes):
            found.append(changes + (at + 1))
    return np.concatenate(found)


def _dwells(progress: PathProgress, begin: int, end: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First and last point of each dwell among the points begin..end; both (k,)."""
    stays = np.zeros(end - begin + 2, dtype=bool)  # led and followed by a point that does not
    for at in range(begin, end, _BLOCK):
        stop = min(at + _BLOCK, end)
        stays[at - begin + 1 : stop - begin + 1] = _stays(progress, slice(at, stop + 1))
    edges = begin + np.flatnonzero(stays[1:] != stays[:-1])
    return edges[::2], edges[1::2]


def _stays(progress: PathProgress, points: slice) -> npt.NDArray[np.bool_]:
    """(m − 1,) whether each of the m points but the last stands together with the next one, which is
    later."""
    rests = np.abs(np.asarray(progress.speeds_mps[points])) <= _NO_SPEED_MPS
    x, y, time = (np.asarray(values[points]) for values in (progress.xs_m, progress.ys_m, progress.times_ns))
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
