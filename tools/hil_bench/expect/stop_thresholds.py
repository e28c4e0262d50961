"""Measurements of a device's stops: when they begin, how they brake, and how they are held."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import S

from hil_bench.expect.base import QUIET_S, Observation
from hil_bench.expect.limit import Limit
from hil_bench.expect.true_state import Quantity, instant_before
from hil_bench.result import Measured

RESTS_MPS = 0.02
BRAKES_FROM, BRAKES_UNTIL = 0.9, 0.3
"""Between these shares of the speed at its beginning a stop's deceleration is measured."""
LONGEST_PERIOD = 0.1
"""Of a stop's commands, as a share of the time until silence."""


@dataclass(frozen=True, kw_only=True)
class StopAt:
    """The quantity in the sample that the first stop answers."""

    limit: Limit
    of: Quantity

    def measure(self, observed: Observation) -> list[Measured]:
        first = _first_stop(observed)
        instant = None if first is None else instant_before(observed, first.stamp_ns)
        return self.limit.at(None if instant is None else self.of(observed, instant))


@dataclass(frozen=True, kw_only=True)
class StopAfter:
    """Time from the last frame of the messages, or the last complete sample, to the first stop."""

    limit: Limit
    messages: tuple[str, ...] = ()
    is_from_injection: bool = False
    """The last one before the injection counts."""

    def measure(self, observed: Observation) -> list[Measured]:
        first = _first_stop(observed)
        if first is None:
            return self.limit.at(None)
        until_ns = observed.inject_ns if self.is_from_injection else first.stamp_ns
        last_ns = _last_ns(observed, self.messages, until_ns)
        return self.limit.at((first.stamp_ns - last_ns) / S)


@dataclass(frozen=True, kw_only=True)
class SilentAfter:
    """Time from the last complete sample to the last command.

    The next command would have come a period later. So a device that repeats its stops more slowly than it answers
    samples may send the last one that much before its time.
    """

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        lost_ns = _last_ns(observed, (), observed.inject_ns + round(0.02 * S))
        stamps = [pair.stamp_ns for pair in observed.between(observed.inject_ns, observed.end_ns)]
        if not stamps or observed.end_ns - stamps[-1] <= QUIET_S * S:
            return self.limit.at(None)
        return self._allow_for_period(stamps).at((stamps[-1] - lost_ns) / S)

    def _allow_for_period(self, stamps: Sequence[int]) -> Limit:
        if self.limit.lowest is None or len(stamps) < 2:
            return self.limit
        early_s = min(LONGEST_PERIOD * self.limit.profile, 1.1 * (stamps[-1] - stamps[-2]) / S)
        return replace(self.limit, lowest=min(self.limit.lowest, self.limit.profile - early_s))


@dataclass(frozen=True, kw_only=True)
class Brakes:
    """Mean deceleration between two shares of the speed at the beginning of a stop."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        first = _first_stop(observed)
        if first is None:
            return self.limit.at(None)
        after = [i for i in observed.history if first.stamp_ns <= i.at_ns < observed.then_ns]
        begin_mps = abs(after[0].speed_mps) if after else 0.0
        begin = next((i for i in after if abs(i.speed_mps) <= BRAKES_FROM * begin_mps), None)
        end = next((i for i in after if abs(i.speed_mps) <= BRAKES_UNTIL * begin_mps), None)
        if begin is None or end is None or end.at_ns == begin.at_ns:
            return self.limit.at(None)
        return self.limit.at((abs(begin.speed_mps) - abs(end.speed_mps)) * S / (end.at_ns - begin.at_ns))


@dataclass(frozen=True, kw_only=True)
class StopWay:
    """Way from the beginning of the injection to standstill."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        after = [i for i in observed.history if observed.inject_ns <= i.at_ns < observed.then_ns]
        rest = next((number for number, i in enumerate(after) if abs(i.speed_mps) <= RESTS_MPS), None)
        if rest is None:
            return self.limit.at(None)
        return self.limit.at(sum(math.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in pairwise(after[: rest + 1])))


@dataclass(frozen=True, kw_only=True)
class BrakesWithin:
    """Time from the first stop command to the first one that asks for `share` of the deceleration."""

    limit: Limit
    decel_mps2: float

    def measure(self, observed: Observation) -> list[Measured]:
        first = _first_stop(observed)
        if first is None:
            return self.limit.at(None)
        full = (
            pair.stamp_ns
            for pair in observed.between(first.stamp_ns, observed.then_ns)
            if abs(pair.drive["ACCEL_REQUEST"]) >= self.decel_mps2
        )
        full_ns = next(full, None)
        return self.limit.at(None if full_ns is None else (full_ns - first.stamp_ns) / S)


@dataclass(frozen=True, kw_only=True)
class AtRest:
    """The greatest size of a commanded value while the stopped vehicle stands."""

    limit: Limit
    of: Callable[[Pair], float]

    def measure(self, observed: Observation) -> list[Measured]:
        rests = [i for i in observed.history if observed.inject_ns <= i.at_ns and abs(i.speed_mps) <= RESTS_MPS]
        if not rests:
            return self.limit.at(None)
        held = observed.between(rests[0].at_ns + round(0.3 * S), observed.end_ns)
        return self.limit.at(max((self.of(pair) for pair in held), default=None))


@dataclass(frozen=True, kw_only=True)
class StopsUntilHeld:
    """How many stops there were before one from which the device does not drive on by itself."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        pairs = observed.between(observed.inject_ns, observed.then_ns)
        begun = sum(not before.is_stop and pair.is_stop for before, pair in pairwise(pairs))
        is_held = bool(pairs) and pairs[-1].is_stop
        return self.limit.at(float(begun) if is_held else None)


def _first_stop(observed: Observation) -> Pair | None:
    after: Iterator[Pair] = (pair for pair in observed.between(observed.inject_ns, observed.then_ns) if pair.is_enabled)
    return next((pair for pair in after if pair.is_stop), None)


def _last_ns(observed: Observation, messages: Sequence[str], until_ns: int) -> int:
    """When the last of these messages, or the last complete sample, was on the bus."""
    stamps = (
        [told.stamp_ns for told in observed.told if told.name in messages] if messages else list(observed.samples_ns)
    )
    return max((stamp_ns for stamp_ns in stamps if stamp_ns <= until_ns), default=observed.inject_ns)
