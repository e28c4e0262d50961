"""Measurements of where a device acts: one value of one observation beside the profile's threshold."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import NO_REQUEST, S

from hil_bench.expect.base import Observation
from hil_bench.result import Measured
from hil_bench.vehicle import Instant

ANSWERED_NS = round(0.004 * S)
"""A command is no answer to a sample that is younger."""
QUIET_S = 0.15
"""Commands have ended after so long without one."""
RESTS_MPS = 0.02


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A threshold of the profile, with the range in which the device may act."""

    key: str
    name: str
    unit: str
    profile: float
    lowest: float | None = None
    highest: float | None = None
    place: str = ""

    def at(self, acts_at: float | None) -> list[Measured]:
        """Where the device acted; None: it did not."""
        return [
            Measured(
                name=self.name,
                unit=self.unit,
                key=self.key,
                place=self.place,
                profile=self.profile,
                lowest=self.lowest,
                highest=self.highest,
                acts_at=None if acts_at is None else round(acts_at, 5),
            )
        ]


Quantity = Callable[[Observation, Instant], float]
"""Of the vehicle's true state."""


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
    """Time from the last complete sample to the last command."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        lost_ns = _last_ns(observed, (), observed.inject_ns + round(0.02 * S))
        stamps = [pair.stamp_ns for pair in observed.between(observed.inject_ns, observed.end_ns)]
        is_silent = stamps and observed.end_ns - stamps[-1] > QUIET_S * S
        return self.limit.at((stamps[-1] - lost_ns) / S if is_silent else None)


@dataclass(frozen=True, kw_only=True)
class ReleaseAt:
    """The value of a signal in the last frame before the first ENABLE = 0."""

    limit: Limit
    signal: str

    def measure(self, observed: Observation) -> list[Measured]:
        pairs = observed.between(observed.inject_ns, observed.then_ns)
        first = next((pair for pair in pairs if not pair.is_enabled), None)
        if first is None:
            return self.limit.at(None)
        values = [
            told.signals[self.signal]
            for told in observed.told
            if self.signal in told.signals and told.stamp_ns <= first.stamp_ns
        ]
        return self.limit.at(values[-1] if values else None)


@dataclass(frozen=True, kw_only=True)
class DrivesAfter:
    """Time from the first sample after the injection to the first command that drives."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        first_ns = next((stamp_ns for stamp_ns in observed.samples_ns if stamp_ns >= observed.end_ns), None)
        pairs = observed.between(observed.end_ns, observed.then_ns)
        driving = next((pair for pair in pairs if _drives(pair)), None)
        if first_ns is None or driving is None:
            return self.limit.at(None)
        return self.limit.at((driving.stamp_ns - first_ns) / S)


@dataclass(frozen=True, kw_only=True)
class AsksFor:
    """Time during which engagement is requested of a vehicle that does not engage."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        asked = [pair.stamp_ns for pair in observed.between(observed.inject_ns, observed.then_ns) if pair.is_enabled]
        has_ended = asked and observed.then_ns - asked[-1] > QUIET_S * S
        return self.limit.at((asked[-1] - asked[0]) / S if has_ended else None)


@dataclass(frozen=True, kw_only=True)
class Brakes:
    """Mean deceleration between 90 % and 30 % of the speed at the beginning of a stop."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        first = _first_stop(observed)
        if first is None:
            return self.limit.at(None)
        after = [i for i in observed.history if first.stamp_ns <= i.at_ns < observed.then_ns]
        begin_mps = abs(after[0].speed_mps) if after else 0.0
        begin = next((i for i in after if abs(i.speed_mps) <= 0.9 * begin_mps), None)
        end = next((i for i in after if abs(i.speed_mps) <= 0.3 * begin_mps), None)
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
class ReleasedAt:
    """Speed of the vehicle when it is released; None if it never is."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        after = [pair for pair in observed.pairs if pair.stamp_ns >= observed.inject_ns]
        released_ns = next((pair.stamp_ns for pair in after if not pair.is_enabled), None)
        if released_ns is None and after and observed.exit_ns:
            released_ns = after[-1].stamp_ns
        instant = None if released_ns is None else instant_before(observed, released_ns)
        return self.limit.at(None if instant is None else abs(instant.speed_mps))


@dataclass(frozen=True, kw_only=True)
class ReleasedAfter:
    """Time from the injection to the first ENABLE = 0."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        after = (
            pair.stamp_ns for pair in observed.pairs if pair.stamp_ns >= observed.inject_ns and not pair.is_enabled
        )
        released_ns = next(after, None)
        return self.limit.at(None if released_ns is None else (released_ns - observed.inject_ns) / S)


@dataclass(frozen=True, kw_only=True)
class Greatest:
    """The greatest value of the commands that drive."""

    limit: Limit
    of: Callable[[Pair], float]

    def measure(self, observed: Observation) -> list[Measured]:
        return self.limit.at(max((self.of(pair) for pair in observed.pairs if _drives(pair)), default=None))


@dataclass(frozen=True, kw_only=True)
class FirstDropped:
    """The size of the first change that costs its sample: the n-th sample of each `every` is changed by n times `step`.

    The sample after a changed one may be dropped in its place: a device compares both ways.
    """

    limit: Limit
    every: int
    step: float

    def measure(self, observed: Observation) -> list[Measured]:
        name = observed.wire.trigger
        stamps = (told.stamp_ns for told in observed.told if told.name == name)
        samples = [stamp_ns for stamp_ns in stamps if observed.inject_ns < stamp_ns < observed.end_ns]
        for number, stamp_ns in enumerate(samples[:-2], 1):
            if number % self.every:
                continue
            after_ns = samples[number + 1]
            if len(observed.between(stamp_ns, after_ns)) < 2:
                return self.limit.at(self.step * (number // self.every))
        return self.limit.at(None)


@dataclass(frozen=True, kw_only=True)
class StopsUntilHeld:
    """How many stops there were before one from which the device does not drive on by itself."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        pairs = observed.between(observed.inject_ns, observed.then_ns)
        begun = sum(not before.is_stop and pair.is_stop for before, pair in pairwise(pairs))
        is_held = bool(pairs) and pairs[-1].is_stop
        return self.limit.at(float(begun) if is_held else None)


@dataclass(frozen=True, kw_only=True)
class GearRequestedAt:
    """The greatest speed at which a gear is requested; 0 if none is."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        asked = [
            instant_before(observed, pair.stamp_ns)
            for pair in observed.between(observed.inject_ns, observed.then_ns)
            if pair.drive.signals.get("GEAR_REQUEST", NO_REQUEST) != NO_REQUEST
        ]
        return self.limit.at(max((abs(instant.speed_mps) for instant in asked if instant is not None), default=0.0))


def instant_before(observed: Observation, stamp_ns: int) -> Instant | None:
    """The vehicle's true state in the sample that a command at this time answers."""
    before = [instant for instant in observed.history if instant.at_ns <= stamp_ns]
    return before[-1] if before else None


def distance_m(observed: Observation, instant: Instant) -> float:
    """From the route."""
    route = observed.route
    points = list(zip(route.x_m, route.y_m, strict=True))
    return min(_segment_distance_m(instant, a, b) for a, b in pairwise(points))


def heading_error_rad(observed: Observation, instant: Instant) -> float:
    """From the heading of the route's nearest point, without sign."""
    route = observed.route
    nearest = min(
        range(len(route.x_m)), key=lambda i: math.hypot(route.x_m[i] - instant.x_m, route.y_m[i] - instant.y_m)
    )
    return abs(math.remainder(instant.heading_rad - route.heading_rad[nearest], math.tau))


def speed_mps(_observed: Observation, instant: Instant) -> float:
    """Without sign."""
    return abs(instant.speed_mps)


def _segment_distance_m(instant: Instant, a: tuple[float, float], b: tuple[float, float]) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    px, py = instant.x_m - a[0], instant.y_m - a[1]
    square = dx * dx + dy * dy
    share = min(1.0, max(0.0, (px * dx + py * dy) / square)) if square else 0.0
    return math.hypot(px - share * dx, py - share * dy)


def _drives(pair: Pair) -> bool:
    return pair.is_enabled and not pair.is_stop


def _first_stop(observed: Observation) -> Pair | None:
    after: Iterator[Pair] = (pair for pair in observed.between(observed.inject_ns, observed.then_ns) if pair.is_enabled)
    return next((pair for pair in after if pair.is_stop), None)


def _last_ns(observed: Observation, messages: Sequence[str], until_ns: int) -> int:
    """When the last of these messages, or the last complete sample, was on the bus."""
    stamps = (
        [told.stamp_ns for told in observed.told if told.name in messages] if messages else list(observed.samples_ns)
    )
    return max((stamp_ns for stamp_ns in stamps if stamp_ns <= until_ns), default=observed.inject_ns)
