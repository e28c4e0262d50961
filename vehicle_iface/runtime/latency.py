"""Latencies of a whole run in a fixed amount of memory."""

import math

_PER_OCTAVE = 16
_OCTAVES = 40


class LatencyHistogram:
    """Counts in logarithmic bins: each 4.4 % wide, from 1 ns to 18 minutes, memory that never grows."""

    def __init__(self) -> None:
        self._bins = [0] * (_PER_OCTAVE * _OCTAVES)
        self.count = 0
        self.max_ns = 0

    def add(self, latency_ns: int) -> None:
        """Count one latency; negative ones count as 0."""
        place = int(math.log2(latency_ns) * _PER_OCTAVE) if latency_ns > 1 else 0
        self._bins[min(place, len(self._bins) - 1)] += 1
        self.count += 1
        self.max_ns = max(self.max_ns, latency_ns)

    def quantile_s(self, share: float) -> float | None:
        """The latency in seconds that `share` of all were at or below (upper edge of its bin); None without any."""
        if not self.count:
            return None
        rank, seen = math.ceil(share * self.count), 0
        for place, count in enumerate(self._bins):
            seen += count
            if seen >= rank:
                return float(min(2.0 ** ((place + 1) / _PER_OCTAVE), self.max_ns) / 1e9)
        return self.max_ns / 1e9

    def summary(self) -> dict[str, float | int | None]:
        """Count, and p50, p95, p99 and max in seconds."""
        return {
            "count": self.count,
            "p50_s": self.quantile_s(0.50),
            "p95_s": self.quantile_s(0.95),
            "p99_s": self.quantile_s(0.99),
            "max_s": self.max_ns / 1e9 if self.count else None,
        }
