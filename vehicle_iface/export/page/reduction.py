"""Fewer rows for a long drive: of each group of rows the extremes of every curve are kept."""

from dataclasses import dataclass

import numpy as np

from vehicle_iface.trajectory import FloatArray

MAX_ROWS = 120_000
"""20 minutes at 100 Hz; a longer drive has fewer rows."""


@dataclass(frozen=True, slots=True)
class Reduction:
    """Reduces arrays of `rows` values to at most about `MAX_ROWS`, two for each group."""

    rows: int
    group: int
    """Number of rows in a group; 1: nothing is reduced."""

    @classmethod
    def of(cls, rows: int, max_rows: int = MAX_ROWS) -> "Reduction":
        """Return the one that is needed for so many rows."""
        return cls(rows, 1 if rows <= max_rows else -(-2 * rows // max_rows))

    def pick(self, values: FloatArray) -> FloatArray:
        """Return the first value of each group and the one in its middle."""
        if self.group == 1:
            return values
        grouped = self._group(values, values[-1])
        return grouped[:, (0, self.group // 2)].ravel()

    def extremes(self, values: FloatArray) -> FloatArray:
        """Return the least and the greatest value of each group in their order; NaN only where a group has no other."""
        if self.group == 1:
            return values
        grouped = self._group(values, np.nan)
        lowest = np.where(np.isnan(grouped), np.inf, grouped)
        highest = np.where(np.isnan(grouped), -np.inf, grouped)
        places = np.sort(np.stack([lowest.argmin(axis=1), highest.argmax(axis=1)], axis=1), axis=1)
        return np.take_along_axis(grouped, places, axis=1).ravel()

    def _group(self, values: FloatArray, padding: float) -> FloatArray:
        missing = -len(values) % self.group
        return np.concatenate([values, np.full(missing, padding, values.dtype)]).reshape(-1, self.group)
