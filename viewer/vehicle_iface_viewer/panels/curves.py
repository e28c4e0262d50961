"""Curves: values with their times, drawn as the lowest and the highest value of each column of pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle_iface.telemetry.columns import GAP_NS
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_S

COLUMNS = 80
"""Columns of a plot; each is about four pixels wide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeAxis:
    """The columns of a plot. They begin at whole multiples of their width, so that a curve keeps its shape when it
    moves."""

    now_ns: int
    width_ns: int
    first: int
    """Number of the first column."""

    @classmethod
    def until(cls, now_ns: int, window_s: float) -> TimeAxis:
        """Return the axis of the last `window_s` seconds."""
        width_ns = round(window_s * NS_PER_S) // COLUMNS
        return cls(now_ns=now_ns, width_ns=width_ns, first=now_ns // width_ns - COLUMNS - 1)

    @property
    def begin_ns(self) -> int:
        """When the first column begins."""
        return self.first * self.width_ns

    @property
    def columns(self) -> int:
        """One at each end is partly outside the window."""
        return COLUMNS + 2

    @property
    def times_s(self) -> FloatArray:
        """(2 · columns,) times of the points in s, two in each column; 0 is now."""
        quarters = 4 * np.arange(self.columns)[:, None] + np.array([1, 3])
        times_s: FloatArray = (quarters * self.width_ns / 4 - (self.now_ns - self.begin_ns)).ravel() / NS_PER_S
        times_s[-1] = 0.0
        return np.minimum(times_s, 0.0, out=times_s)

    def decimate(self, times_ns: npt.NDArray[np.int64], values: FloatArray, gap_ns: int = GAP_NS) -> FloatArray:
        """Return (2 · columns,) values: of each column the lowest and the highest, NaN where nothing is known.

        `times_ns` (n,) is in order and not before `begin_ns`; NaN in `values` (n,) are unknown. Between known values
        that are more than `gap_ns` apart is at least one NaN.
        """
        points = np.full(2 * self.columns, np.nan)
        is_known = np.isfinite(values)
        at_ns, known = times_ns[is_known] - self.begin_ns, values[is_known]
        if not len(known):
            return points
        column = at_ns // self.width_ns
        starts = np.flatnonzero(np.diff(column, prepend=-1))
        ends = np.append(starts[1:], len(known)) - 1
        low, high = np.minimum.reduceat(known, starts), np.maximum.reduceat(known, starts)
        falls = known[ends] < known[starts]
        points[2 * column[starts]] = np.where(falls, high, low)
        points[2 * column[starts] + 1] = np.where(falls, low, high)
        self._fill(points, at_ns, known, gap_ns)
        breaks = np.flatnonzero(np.diff(at_ns) > gap_ns)
        narrow = breaks[column[breaks + 1] - column[breaks] <= 1]
        points[2 * column[narrow] + 1] = np.nan
        return points

    def _fill(self, points: FloatArray, at_ns: npt.NDArray[np.int64], known: FloatArray, gap_ns: int) -> None:
        """Interpolate in columns without a value, except in gaps."""
        empty = np.flatnonzero(np.isnan(points))
        point_ns = (4 * (empty // 2) + 2 * (empty % 2) + 1) * self.width_ns // 4
        after = np.searchsorted(at_ns, point_ns)
        is_inside = (after > 0) & (after < len(at_ns))
        empty, point_ns, after = empty[is_inside], point_ns[is_inside], after[is_inside]
        is_near = at_ns[after] - at_ns[after - 1] <= gap_ns
        points[empty[is_near]] = np.interp(point_ns[is_near], at_ns, known)
