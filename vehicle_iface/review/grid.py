"""Series at common times, and the sums over a short window that kinematic laws are checked with.

A law between a quantity and its rate is checked without differentiation: the change over a window against the mean rate
in it. Both sides are then smoothed alike, and noise does not grow with the rate of the messages.
"""

from dataclasses import dataclass

import numpy as np

from vehicle_iface.review.series import Series
from vehicle_iface.trajectory import FloatArray

STEP_S = 0.01
MAX_TIMES = 400_000
"""Maximum number of common times; in longer logs they are further apart."""
MIN_WINDOW_S = 0.5
SHORTEST_GAP_S = 0.25
GAP_PERIODS = 4.0
"""Values further apart than this many periods are not interpolated."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Equidistant times; values at them are NaN where a series has a gap."""

    times_s: FloatArray
    """(n,)"""
    step_s: float

    @classmethod
    def over(cls, duration_s: float) -> "Grid":
        """Make the grid from 0 to the end of a drive."""
        step_s = max(STEP_S, duration_s / MAX_TIMES)
        return cls(times_s=np.arange(0.0, duration_s + step_s / 2.0, step_s), step_s=step_s)

    def resample(self, series: Series) -> FloatArray:
        """Interpolate linearly to (n,), or (n, 2) for a position."""
        if series.values.ndim == 2:
            return np.column_stack([self._resample(series.times_s, column) for column in series.values.T])
        return self._resample(series.times_s, series.values)

    def mean(self, values: FloatArray, window_s: float) -> FloatArray:
        """Return (n,) the mean over a window around each time."""
        half = self._half(window_s)
        sums = np.concatenate(([0.0], np.cumsum(np.where(np.isfinite(values), values, 0.0))))
        missing = np.concatenate(([0], np.cumsum(~np.isfinite(values))))
        result = np.full(len(values), np.nan)
        if len(values) > 2 * half:
            ends = 0.5 * (values[: len(values) - 2 * half] + values[2 * half :])
            inner = sums[2 * half : len(values)] - sums[1 : len(values) - 2 * half + 1]
            whole = missing[2 * half + 1 :] == missing[: len(values) - 2 * half]
            result[half : len(values) - half] = np.where(whole, (inner + ends) / (2 * half), np.nan)
        return result

    def rate(self, values: FloatArray, window_s: float) -> FloatArray:
        """Return (n,) the change per second over a window around each time."""
        half = self._half(window_s)
        result = np.full_like(values, np.nan)
        if len(values) > 2 * half:
            change = values[2 * half :] - values[: len(values) - 2 * half]
            result[half : len(values) - half] = change / (2 * half * self.step_s)
        return result

    def _half(self, window_s: float) -> int:
        return max(1, round(window_s / self.step_s / 2.0))

    def _resample(self, times_s: FloatArray, values: FloatArray) -> FloatArray:
        if len(times_s) < 2:
            return np.full(len(self.times_s), np.nan)
        after = np.clip(np.searchsorted(times_s, self.times_s), 1, len(times_s) - 1)
        gap_s = times_s[after] - times_s[after - 1]
        longest_s = max(SHORTEST_GAP_S, GAP_PERIODS * float(np.median(np.diff(times_s))))
        is_inside = (self.times_s >= times_s[0]) & (self.times_s <= times_s[-1]) & (gap_s <= longest_s)
        return np.where(is_inside, np.interp(self.times_s, times_s, values), np.nan)


def choose_window_s(*series: Series) -> float:
    """Choose the window in s: at least two periods of the slowest series."""
    periods_s = [float(np.median(np.diff(one.times_s))) for one in series if len(one.times_s) > 1]
    return max(MIN_WINDOW_S, 2.0 * max(periods_s, default=0.0))
