"""Contestants that take turns, and what a row of figures comes to."""

import gc
import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median, quantiles
from time import perf_counter_ns
from typing import TypeVar

Name = TypeVar("Name", bound=Hashable)

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


def interleaved(
    contestants: Mapping[Name, Callable[[], object]], rounds: int, prepare: Callable[[Name], None] = lambda _: None
) -> dict[Name, list[int]]:
    """Nanoseconds of each call, in turns; `prepare` is called before each, unmeasured.

    No garbage is collected meanwhile, as with timeit.
    """

    def timed(name: Name) -> int:
        prepare(name)
        call = contestants[name]
        begun_ns = perf_counter_ns()
        call()
        return perf_counter_ns() - begun_ns

    was_on = gc.isenabled()
    gc.disable()
    try:
        return in_turns({name: partial(timed, name) for name in contestants}, rounds)
    finally:
        if was_on:
            gc.enable()


def in_turns(measure: Mapping[Name, Callable[[], int]], rounds: int) -> dict[Name, list[int]]:
    """What each measures, in rounds in which everybody measures once; who begins moves on by one each round.

    Each measures once before, and that is thrown away.
    """
    order = list(measure)
    found: dict[Name, list[int]] = {name: [] for name in order}
    for name in order:
        measure[name]()
    for number in range(rounds):
        first = number % len(order)
        for name in order[first:] + order[:first]:
            found[name].append(measure[name]())
    return found


def ratios(above: Sequence[float], below: Sequence[float]) -> Spread:
    """Round by round, so that what slows a round slows both."""
    return Spread.of([one / other for one, other in zip(above, below, strict=True)])


def geometric_mean(values: Iterable[float]) -> float:
    logs = [math.log(value) for value in values]
    return math.exp(sum(logs) / len(logs))
