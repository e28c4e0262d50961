"""Contestants that take turns, and what a row of figures comes to."""

import gc
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median, quantiles
from time import perf_counter_ns

NS_PER_US = 1000


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, and the tenths that lie below and above."""

    median: float
    p10: float
    p90: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        tenths = quantiles(values, n=10, method="inclusive")
        return cls(median(values), tenths[0], tenths[-1])


def interleaved(contestants: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, list[int]]:
    """Nanoseconds of each call, in rounds in which everybody runs once; who begins moves on by one each round.

    Each runs once before, unmeasured. No garbage is collected meanwhile, as with timeit.
    """
    order = list(contestants)
    took: dict[str, list[int]] = {name: [] for name in order}
    for contestant in contestants.values():
        contestant()
    was_on = gc.isenabled()
    gc.disable()
    try:
        for number in range(rounds):
            first = number % len(order)
            for name in order[first:] + order[:first]:
                run = contestants[name]
                begun_ns = perf_counter_ns()
                run()
                took[name].append(perf_counter_ns() - begun_ns)
    finally:
        if was_on:
            gc.enable()
    return took


def ratios(above: Sequence[float], below: Sequence[float]) -> Spread:
    """Round by round, so that what slows a round slows both."""
    return Spread.of([one / other for one, other in zip(above, below, strict=True)])


def geometric_mean(values: Iterable[float]) -> float:
    logs = [math.log(value) for value in values]
    return math.exp(sum(logs) / len(logs))
