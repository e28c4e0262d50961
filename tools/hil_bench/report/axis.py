"""Axes with round numbers, and lines as SVG path data."""

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

from hil_bench.report.formatting import is_finite, number

LARGEST = 1e9
"""Beyond it a value is not drawn: everything else would be a flat line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """From `low` to `high`, with round numbers between them."""

    low: float
    high: float
    step: float

    def share(self, value: float) -> float:
        """0 at the low end, 1 at the high one."""
        return (value - self.low) / (self.high - self.low)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Share and text of each round number."""
        first, last = math.ceil(self.low / self.step - 1e-9), math.floor(self.high / self.step + 1e-9)
        return [(self.share(n * self.step), number(round(n * self.step, 12))) for n in range(first, last + 1)]


def axis(values: Iterable[float], count: int = 5, margin: float = 0.0) -> Axis:
    """Over all of them; never empty."""
    drawn = [value for value in values if is_drawable(value)] or [0.0, 1.0]
    low, high = min(drawn), max(drawn)
    if high - low <= 1e-9 * max(1.0, abs(low), abs(high)):
        spread = max(abs(low) * 0.1, 1e-3)
        low, high = low - spread, high + spread
    low, high = low - margin * (high - low), high + margin * (high - low)
    return Axis(low=low, high=high, step=round_step((high - low) / count))


def is_drawable(value: float | None) -> bool:
    return is_finite(value) and abs(value or 0.0) <= LARGEST


def line(points: list[tuple[int, int]]) -> str:
    """Relative steps, which are the shortest to write; steps in one direction are one."""
    if not points:
        return ""
    steps: list[tuple[int, int]] = []
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        dx, dy = x1 - x0, y1 - y0
        if (dx, dy) == (0, 0):
            continue
        if steps and dy == 0 and steps[-1][1] == 0 and steps[-1][0] * dx > 0:
            steps[-1] = (steps[-1][0] + dx, 0)
        else:
            steps.append((dx, dy))
    return f"M{points[0][0]} {points[0][1]}l" + " ".join(f"{dx} {dy}" for dx, dy in steps or [(0, 0)])


def round_step(rough: float) -> float:
    """1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(rough))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough * (1 - 1e-9))
