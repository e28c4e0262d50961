"""Detects samples that are older than their stamps: frames that a gateway or an adapter has delayed.

A sample's stamp is the time of its arrival here. Frames that were delayed before they reached this machine have new
stamps and old values. They arrive faster than the vehicle measures.
"""

from enum import Enum, auto

SLACK = 0.8
"""Share of the period that must pass between two samples: a vehicle's clock may run fast, and frames arrive unevenly.
"""
MOST_PERIODS = 2
"""Largest number of samples that may follow at once after a late one."""


class Arrival(Enum):
    """Verdict on the age of a sample, by its arrival."""

    YOUNG = auto()
    """The sample is used for driving."""
    DOUBTFUL = auto()
    """The sample may be old: it is answered with a stop."""
    BURST = auto()
    """The sample arrived too soon after others: it is not answered."""


class ArrivalFilter:
    """Accepts one sample per period, and a second one at once if the sample before was late.

    A gap earns no further samples. After a gap, samples are doubtful until one arrives half a period or more after its
    predecessor: the first ones may have been delayed since the gap began.
    """

    def __init__(self, period_ns: int, gap_ns: int) -> None:
        self._period_ns, self._gap_ns = period_ns, gap_ns
        self._cost_ns, self._most_ns = round(period_ns * SLACK), MOST_PERIODS * period_ns
        self._last_ns: int | None = None
        self._saved_ns = self._most_ns
        self._follows_gap: bool  # set by the first sample

    def judge(self, stamp_ns: int) -> Arrival:
        """Judge the sample that arrived at `stamp_ns` (monotonic)."""
        since_ns = stamp_ns - self._last_ns if self._last_ns is not None else self._period_ns
        self._last_ns = stamp_ns
        is_gap = since_ns > self._gap_ns
        if is_gap or 2 * since_ns >= self._period_ns:
            self._follows_gap = is_gap
        saved_ns = self._cost_ns if is_gap else self._saved_ns + since_ns
        self._saved_ns = saved_ns if saved_ns < self._most_ns else self._most_ns
        if self._saved_ns < self._cost_ns:
            return Arrival.BURST
        self._saved_ns -= self._cost_ns
        return Arrival.DOUBTFUL if self._follows_gap else Arrival.YOUNG
