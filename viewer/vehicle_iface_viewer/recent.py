"""The snapshots of the last minutes, as columns."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.columns import PLACES, ROW, Columns
from vehicle_iface.units import NS_PER_S


class RecentSnapshots:
    """Keeps `length_s` seconds of snapshots, in the order of their times."""

    def __init__(self, *, length_s: float, rate_hz: float = 100.0) -> None:
        self._length_ns = round(length_s * NS_PER_S)
        # The kept rows are moved to the front when the end is reached: each slice is one piece, without a copy.
        self._rows: Columns = np.zeros(round(length_s * rate_hz * 1.25) + 16, ROW)
        self._begin = self._end = 0

    @property
    def newest_ns(self) -> int:
        """When the newest snapshot was published; 0: there is none."""
        return int(self._rows["published_ns"][self._end - 1]) if self._end > self._begin else 0

    def clear(self) -> None:
        """Remove all snapshots."""
        self._begin = self._end = 0

    def extend(self, snapshots: Iterable[Snapshot]) -> None:
        """Append the snapshots that are newer than the newest; those that are too old are forgotten."""
        for snapshot in snapshots:
            if snapshot.published_ns > self.newest_ns:
                self._append(snapshot)

    def between(self, begin_ns: int, end_ns: int) -> Columns:
        """Return the snapshots after `begin_ns` and up to `end_ns`: valid until the next `extend`."""
        times_ns = self._rows["published_ns"][self._begin : self._end]
        first, last = np.searchsorted(times_ns, (begin_ns, end_ns), side="right")
        return self._rows[self._begin + first : self._begin + last]

    def _append(self, snapshot: Snapshot) -> None:
        if self._end == len(self._rows):
            self._make_room()
        try:
            self._rows[self._end] = tuple(snapshot[place] for place in PLACES)
        except OverflowError:  # a number of a damaged recording
            return
        self._end += 1

    def _make_room(self) -> None:
        """Move the kept rows to the front; where they come faster than expected, keep fewer."""
        kept = self.between(self.newest_ns - self._length_ns, self.newest_ns)[-len(self._rows) * 4 // 5 :].copy()
        self._rows[: len(kept)] = kept
        self._begin, self._end = 0, len(kept)
