"""Measurements of where a device engages, releases, drives on, changes gear and drops a sample."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import NO_REQUEST, S

from hil_bench.expect.base import QUIET_S, Observation
from hil_bench.expect.limit import Limit
from hil_bench.expect.true_state import instant_before
from hil_bench.result import Measured


@dataclass(frozen=True, kw_only=True)
class AsksFor:
    """Time during which engagement is requested of a vehicle that does not engage."""

    limit: Limit

    def measure(self, observed: Observation) -> list[Measured]:
        asked = [pair.stamp_ns for pair in observed.between(observed.inject_ns, observed.then_ns) if pair.is_enabled]
        has_ended = asked and observed.then_ns - asked[-1] > QUIET_S * S
        return self.limit.at((asked[-1] - asked[0]) / S if has_ended else None)


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
class OldestAnswered:
    """The greatest age of the newest sample when a command that drives was sent; 0 without such a command.

    Where no signal says so, a command is taken as a stop `begins_s` after the stop has begun. The commands in between
    belong to the stop: the first asks for at least `falls` (m/s or m/s²) less than the one before, none for more.
    """

    limit: Limit
    begins_s: float = 0.0
    falls: float = 0.0

    def measure(self, observed: Observation) -> list[Measured]:
        # The stop may begin with the first command: what that asks is compared with the last one before the injection.
        begins_ns = round(self.begins_s * S)
        pairs = observed.between(observed.inject_ns - begins_ns, observed.end_ns + begins_ns)
        stops = [number for number, pair in enumerate(pairs) if pair.is_stop and number and _drives(pairs[number - 1])]
        of_stops = {stamp_ns for number in stops for stamp_ns in self._begin_of_stop_ns(pairs[: number + 1])}
        during = observed.between(observed.inject_ns, observed.end_ns)
        driving = {pair.stamp_ns for pair in during if _drives(pair)} - of_stops
        ages_s = [(at_ns - newest_ns) / S for at_ns in driving if (newest_ns := _newest_ns(observed, at_ns))]
        return self.limit.at(max(ages_s, default=0.0))

    def _begin_of_stop_ns(self, pairs: Sequence[Pair]) -> list[int]:
        """When the commands were sent that begin the stop, of which the last one is the first that is taken as one."""
        earlier: list[int] = []
        begun: list[int] = []
        for before, pair in reversed(list(pairwise(pairs[:-1]))):
            fell = _asked(before) - _asked(pair)
            if fell < 0.0 or pair.stamp_ns < pairs[-1].stamp_ns - self.begins_s * S:
                break
            earlier.append(pair.stamp_ns)
            if fell >= self.falls:
                begun = list(earlier)
        return begun


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
class FirstDropped:
    """The size of the first change that costs its sample: the n-th frame of each `every` is changed by n times `step`.

    The sample after a changed one may be dropped in its place: a device compares both ways. Where commands are slower
    than samples, one is sent for every few of them, all of which are changed.
    """

    limit: Limit
    every: int
    step: float
    message: str = ""
    """That is changed; empty: the one that completes the sample."""

    def measure(self, observed: Observation) -> list[Measured]:
        wire = observed.wire
        changed, samples = (
            [told.stamp_ns for told in observed.told if told.name == name and self._is_during(observed, told.stamp_ns)]
            for name in (self.message or wire.trigger, wire.trigger)
        )
        per_command = max(1, round(wire.command_period_s / wire.period_s))
        answers = 2 if per_command == 1 else 3
        for number, stamp_ns in enumerate(changed, 1):
            first = bisect_left(samples, stamp_ns)
            if number % self.every or first + answers * per_command >= len(samples):
                continue
            after_ns = samples[first + answers * per_command]
            if len(observed.between(samples[first], after_ns)) < answers:
                return self.limit.at(self.step * (number // self.every))
        return self.limit.at(None)

    def _is_during(self, observed: Observation, stamp_ns: int) -> bool:
        return observed.inject_ns < stamp_ns < observed.end_ns


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


def _drives(pair: Pair) -> bool:
    return pair.is_enabled and not pair.is_stop


def _asked(pair: Pair) -> float:
    """The commanded speed, or else the acceleration, on a drive forwards."""
    return pair.drive.signals.get("SPEED_REQUEST", pair.drive["ACCEL_REQUEST"])


def _newest_ns(observed: Observation, at_ns: int) -> int:
    """When the last complete sample before an instant was on the bus; 0 if there was none."""
    return max((stamp_ns for stamp_ns in observed.samples_ns if stamp_ns <= at_ns), default=0)
