"""Errors of tracking while the loop drives: over the run, and for each lap of a closed route."""

import math

import numpy as np
from msgspec import UNSET, UnsetType

from vehicle_iface.runtime.histogram import LogHistogram
from vehicle_iface.telemetry.details import ErrorSummary, LapSummary, TrackingSummary
from vehicle_iface.trajectory import FloatArray

AT_ONCE = 64
"""Samples that are counted together."""
MAX_LAPS = 200
"""Later laps count in the figures of the run only."""


class ErrorStats:
    """RMS, 95 % and maximum of one error, regardless of its sign; from 1e-5 to 10,000 in its unit."""

    __slots__ = ("_sizes", "_squares")

    def __init__(self) -> None:
        self._sizes, self._squares = LogHistogram(smallest=1e-5, octaves=30), 0.0

    def add_all(self, errors: FloatArray) -> None:
        """Count all errors of an array (n,)."""
        self._sizes.add_all(np.abs(errors))
        self._squares += float(errors @ errors)

    def summary(self) -> ErrorSummary:
        """Return the figures in the error's unit; p95 is the upper edge of its bin, 4.4 % wide."""
        sizes = self._sizes
        rms = math.sqrt(self._squares / sizes.count) if sizes.count else 0.0
        return ErrorSummary(rms=rms, p95=sizes.quantile(0.95), max=sizes.max)


class _Errors:
    __slots__ = ("heading_rad", "lateral_m", "samples")

    def __init__(self) -> None:
        self.samples, self.lateral_m, self.heading_rad = 0, ErrorStats(), ErrorStats()

    def add_all(self, lateral_m: FloatArray, heading_rad: FloatArray) -> None:
        self.samples += len(lateral_m)
        self.lateral_m.add_all(lateral_m)
        self.heading_rad.add_all(heading_rad)


class TrackingStats:
    """Errors against the spatial reference, of each sample that was answered with a command to drive.

    They are counted `AT_ONCE` together: one by one they would cost a pass as much as its gate does.
    """

    def __init__(self) -> None:
        self._pending: list[tuple[float, float]] = []
        self._run = _Errors()
        self._laps: list[_Errors] = []
        self._lap: int | None = None
        self._in_lap: _Errors | None = None
        """Those of the present lap; None where none is kept."""

    def add(self, lateral_m: float, heading_rad: float, *, lap: int | None) -> None:
        """Add one sample; `lap` changes with each round of a closed route, and is None on any other."""
        if lap != self._lap:
            self._count_pending()
            self._lap, self._in_lap = lap, None
            if lap is not None and len(self._laps) < MAX_LAPS:
                self._in_lap = _Errors()
                self._laps.append(self._in_lap)
        self._pending.append((lateral_m, heading_rad))
        if len(self._pending) == AT_ONCE:
            self._count_pending()

    def _count_pending(self) -> None:
        lateral_m, heading_rad = np.array(self._pending, dtype=np.float64).reshape(-1, 2).T
        self._pending.clear()
        self._run.add_all(lateral_m, heading_rad)
        if self._in_lap is not None:
            self._in_lap.add_all(lateral_m, heading_rad)

    def summary(self) -> TrackingSummary | UnsetType:
        """Return all figures; UNSET when nothing was driven."""
        self._count_pending()
        if not self._run.samples:
            return UNSET
        return TrackingSummary(
            samples=self._run.samples,
            lateral_m=self._run.lateral_m.summary(),
            heading_rad=self._run.heading_rad.summary(),
            laps=[
                LapSummary(
                    samples=lap.samples, lateral_m=lap.lateral_m.summary(), heading_rad=lap.heading_rad.summary()
                )
                for lap in self._laps
            ],
        )
