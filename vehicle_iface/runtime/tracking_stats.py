"""Errors of tracking while the loop drives: over the run, and for each lap of a closed route."""

import math
from typing import Self

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

    def merge(self, other: Self) -> None:
        """Count all errors of another one."""
        self._sizes.merge(other._sizes)
        self._squares += other._squares

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

    def merge(self, other: Self) -> None:
        self.samples += other.samples
        self.lateral_m.merge(other.lateral_m)
        self.heading_rad.merge(other.heading_rad)

    def lap_summary(self) -> LapSummary:
        return LapSummary(
            samples=self.samples, lateral_m=self.lateral_m.summary(), heading_rad=self.heading_rad.summary()
        )


class TrackingStats:
    """Errors against the spatial reference, of each sample that was answered with a command to drive.

    They are counted `AT_ONCE` together: one by one they would cost a pass as much as its gate does. Of a lap that is
    over only the figures are kept: its histograms would take 8 KiB.
    """

    def __init__(self) -> None:
        self._lateral_m: list[float] = []
        self._heading_rad: list[float] = []
        self._before = _Errors()
        """Those of all laps before the present one."""
        self._present = _Errors()
        self._lap: int | None = None
        self._laps: list[LapSummary] = []

    def add(self, lateral_m: float, heading_rad: float, *, lap: int | None) -> None:
        """Add one sample; `lap` changes with each round of a closed route, and is None on any other."""
        if lap != self._lap:
            self._count_pending()
            self._laps = self._all_laps()
            self._before.merge(self._present)
            self._lap, self._present = lap, _Errors()
        self._lateral_m.append(lateral_m)
        self._heading_rad.append(heading_rad)
        if len(self._lateral_m) == AT_ONCE:
            self._count_pending()

    def summary(self) -> TrackingSummary | UnsetType:
        """Return all figures; UNSET when nothing was driven."""
        self._count_pending()
        run = _Errors()
        run.merge(self._before)
        run.merge(self._present)
        if not run.samples:
            return UNSET
        return TrackingSummary(
            samples=run.samples,
            lateral_m=run.lateral_m.summary(),
            heading_rad=run.heading_rad.summary(),
            laps=self._all_laps(),
        )

    def _count_pending(self) -> None:
        self._present.add_all(np.array(self._lateral_m), np.array(self._heading_rad))
        self._lateral_m.clear()
        self._heading_rad.clear()

    def _all_laps(self) -> list[LapSummary]:
        """The first `MAX_LAPS` laps, the present one among them."""
        if self._lap is None or len(self._laps) == MAX_LAPS:
            return self._laps
        return [*self._laps, self._present.lap_summary()]
