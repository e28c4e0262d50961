"""Histograms of a run in a fixed amount of memory, mainly of latencies."""

import math
from typing import Self

import numpy as np

from vehicle_iface.telemetry.details import LatencySummary
from vehicle_iface.trajectory import FloatArray

_PER_OCTAVE = 16


class LogHistogram:
    """Counts sizes in logarithmic bins: each 4.4 % wide, `octaves` of them from `smallest` on; memory never grows."""

    def __init__(self, smallest: float, octaves: int) -> None:
        self._smallest = smallest
        self._bins = [0] * (_PER_OCTAVE * octaves + 1)
        self.count = 0
        self.total = self.max = 0.0

    def add(self, size: float) -> None:
        """Count one value; one below the smallest bin, negative ones included, counts in that bin."""
        place = math.ceil(math.log2(size / self._smallest) * _PER_OCTAVE) if size > self._smallest else 0
        bins = self._bins
        bins[place if place < len(bins) else -1] += 1
        self.count += 1
        self.total += size
        if size > self.max:
            self.max = size

    def add_all(self, sizes: FloatArray) -> None:
        """Count all values of an array (n,)."""
        octaves = np.log2(np.maximum(sizes / self._smallest, 1.0))
        places = np.minimum(np.ceil(octaves * _PER_OCTAVE), len(self._bins) - 1)
        bins = self._bins
        for place in places.astype(np.int64).tolist():
            bins[place] += 1
        self.count += len(sizes)
        self.total += float(sizes.sum())
        self.max = max(self.max, float(sizes.max(initial=0.0)))

    def merge(self, other: Self) -> None:
        """Count all values of another histogram of the same bins."""
        self._bins = [count + others for count, others in zip(self._bins, other._bins, strict=True)]
        self.count += other.count
        self.total += other.total
        self.max = max(self.max, other.max)

    def quantile(self, share: float) -> float:
        """Return the value that `share` of all did not exceed (upper edge of its bin); 0 if there are none."""
        rank, seen = math.ceil(share * self.count), 0
        for place, count in enumerate(self._bins[:-1]):
            seen += count
            if seen >= rank:
                return float(min(self._smallest * 2.0 ** (place / _PER_OCTAVE), self.max))
        return self.max


class LatencyHistogram:
    """Latencies from 1 ns to 18 minutes."""

    def __init__(self) -> None:
        self._sizes_ns = LogHistogram(smallest=1.0, octaves=40)
        self.add = self._sizes_ns.add
        """Count one latency in nanoseconds; negative ones count as 0."""

    def quantile_s(self, share: float) -> float | None:
        """Return the latency in s that `share` of all did not exceed (upper edge of its bin); None without any."""
        return self._sizes_ns.quantile(share) / 1e9 if self._sizes_ns.count else None

    def summary(self) -> LatencySummary:
        """Return the count, and p50, p95, p99 and max in s."""
        return LatencySummary(
            count=self._sizes_ns.count,
            p50_s=self.quantile_s(0.50),
            p95_s=self.quantile_s(0.95),
            p99_s=self.quantile_s(0.99),
            max_s=self._sizes_ns.max / 1e9 if self._sizes_ns.count else None,
        )
