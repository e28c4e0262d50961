"""Where on the way the vehicle has to stand before it goes on.

A stop is a run of trajectory points without speed, or the last point before the speed changes its sign. The
vehicle goes on from it when the time of the run's last point has come (so the run is the dwell) and the
vehicle stands. A run that the vehicle is already past when it is first seen, like the standing start of a
trajectory, asks for its time only.

Each point is looked at once, as the look-ahead reaches it.
"""

from collections.abc import Sequence

_NO_SPEED_MPS = 1e-3


class Stops:
    """The next stop on one trajectory, and the direction of travel towards it."""

    __slots__ = ("_looked_at", "_speeds_mps", "direction", "first", "last", "must_stand", "turns")

    def __init__(self, speeds_mps: Sequence[float], index: int) -> None:
        """`speeds_mps` (n,), seen from point `index` on."""
        self._speeds_mps = speeds_mps
        self._looked_at = index
        self.direction = 1.0
        """Of travel up to the next stop: 1.0 forwards, −1.0 backwards."""
        self.first: int | None = None
        """First point of the next stop; None when there is none among the points looked at."""
        self.last = 0
        """Last point of the next stop: its time is when the vehicle goes on."""
        self.turns = False
        """Whether the direction of travel changes at the next stop."""
        self.must_stand = False
        """Whether the vehicle has to come to rest at the next stop, or only to wait for its time."""
        self._resume_at(index)

    def look(self, index: int, until: int) -> bool:
        """Whether there is a stop up to and with point `until`, or known; the vehicle is past point
        `index`."""
        if self.first is not None:
            return True
        if index > self._looked_at:  # the vehicle was set ahead, over points that nobody looked at
            self._resume_at(index)
        speeds_mps, direction = self._speeds_mps, self.direction
        at = self._looked_at
        while at <= until and at < len(speeds_mps):
            along_mps = speeds_mps[at] * direction
            if along_mps <= _NO_SPEED_MPS:
                self._note(at if along_mps >= -_NO_SPEED_MPS else max(at - 1, 0), index)
                break
            at += 1
        self._looked_at = at
        return self.first is not None

    def release(self) -> None:
        """Go on from the stop."""
        self.first = None
        self._resume_at(self.last + 1)

    def _note(self, first: int, index: int) -> None:
        self.first = self.last = first
        self.must_stand = first > index
        speeds_mps, end = self._speeds_mps, len(self._speeds_mps)
        while self.last + 1 < end and abs(speeds_mps[self.last + 1]) <= _NO_SPEED_MPS:
            self.last += 1
        self.turns = self.last + 1 < end and speeds_mps[self.last + 1] * self.direction < 0.0

    def _resume_at(self, index: int) -> None:
        self._looked_at = index
        for at in range(index, len(self._speeds_mps)):
            speed_mps = self._speeds_mps[at]
            if abs(speed_mps) > _NO_SPEED_MPS:
                self.direction = 1.0 if speed_mps > 0.0 else -1.0
                break
