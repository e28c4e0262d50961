"""A part of the ground that holds a whole drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vehicle_iface.trajectory import FloatArray

_SMALLEST_M = 20.0
_MARGIN = 0.12
"""Part of the extent beyond the points: the box is changed when that is used up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A part of the ground, m east and north of an origin."""

    west: float
    south: float
    width: float
    height: float

    @classmethod
    def around(cls, points: FloatArray) -> Box:
        """Return the box of (n, 2) points with a margin."""
        low, high = points.min(axis=0), points.max(axis=0)
        width, height = np.maximum(high - low, _SMALLEST_M) * (1.0 + 2.0 * _MARGIN)
        west, south = (low + high - (width, height)) / 2.0
        return cls(west=float(west), south=float(south), width=float(width), height=float(height))

    def holds(self, points: FloatArray) -> bool:
        """Whether all points are inside, and use more than a third of it in one direction."""
        low, high = points.min(axis=0), points.max(axis=0)
        corner, size = np.array((self.west, self.south)), np.array((self.width, self.height))
        is_used = bool(((high - low) > size / 3.0).any()) or max(size) <= _SMALLEST_M * (1.0 + 2.0 * _MARGIN)
        return bool((low >= corner).all() and (high <= corner + size).all()) and is_used
