"""Values over time: the recent ones of a signal, and how fast a value may change."""

import math
from collections import deque
from collections.abc import Iterable

from vehicle_bus_contract.reference import MS

ANSWERED_NS = 100 * MS
"""Maximum age of the sample that a command answers."""


class Recent:
    """The recent values of one signal, queried in the order of time."""

    def __init__(self, told: Iterable[tuple[int, float]]) -> None:
        self._coming = deque(told)
        self._lately: deque[tuple[int, float]] = deque()

    def until(self, stamp_ns: int) -> list[float]:
        """The values that a command at this time may answer, oldest first. Never empty."""
        while self._coming and self._coming[0][0] <= stamp_ns:
            self._lately.append(self._coming.popleft())
        while len(self._lately) > 1 and self._lately[1][0] <= stamp_ns - ANSWERED_NS:
            self._lately.popleft()
        return [value for _, value in self._lately] or [0.0]


class Pace:
    """Checks that a value changes by no more than was `granted` over any interval, plus `slack`."""

    def __init__(self, *, falls_freely: bool = False) -> None:
        self._falls_freely = falls_freely
        self._lowest, self._highest = math.inf, -math.inf

    def is_broken(self, value: float, granted: float, slack: float) -> bool:
        """True if this value breaks the rate; the check then restarts from it."""
        rising, falling, half = value - granted, value + granted, slack / 2.0
        broken = rising - half > self._lowest or (falling + half < self._highest and not self._falls_freely)
        if broken:
            self._lowest, self._highest = math.inf, -math.inf
        self._lowest, self._highest = min(self._lowest, rising + half), max(self._highest, falling - half)
        return broken

    def counts_from(self, limit: float, granted: float, slack: float) -> None:
        """Allow values beyond this limit to return to it at any rate."""
        if limit > 0.0:
            self._highest = min(self._highest, limit + granted - slack / 2.0)
        else:
            self._lowest = max(self._lowest, limit - granted + slack / 2.0)
