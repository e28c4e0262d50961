"""What must be observed of the device's commands."""

import math
from dataclasses import dataclass
from itertools import pairwise

from vehicle_bus_contract.reference import S

from hil_bench.expect.base import Observation, check, describe, not_applicable
from hil_bench.result import Check, Event, EventKind
from hil_bench.vehicle import WATCHDOG_NS
from hil_bench.vocabulary import Wait

STOP_S = 0.150
GAP_PERIODS = 5
MOVES_MPS = 0.05
FRONT_WHEEL = "FRONT_WHEEL_ANGLE_REQUEST"
LED_ON_S = 0.1
"""After so long without a command the reference vehicle no longer obeys: no command continues an older one."""


@dataclass(frozen=True)
class Stops:
    """A stop command with one of these reasons within the time, and only stops until the injection is over.

    ENABLE stays 1: a released vehicle rolls.
    """

    reasons: tuple[str, ...]
    within_s: float = STOP_S
    until_end: bool = True
    waits_for: Wait = Wait.STATE

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        within_s = self.within_s + observed.later_s(self.waits_for)
        with_reason = f" with {' or '.join(self.reasons)}" if observed.wire.tells_reasons else ""
        text = f"a stop{with_reason} within {within_s * 1e3:.0f} ms"
        begin_ns = observed.inject_ns
        after = [pair for pair in observed.pairs if pair.stamp_ns >= begin_ns and pair.is_enabled]
        stops = [pair for pair in after if pair.is_stop and observed.has_reason(pair, self.reasons)]
        if not stops:
            others = sorted({pair.reason for pair in after if pair.is_stop})
            return check(text, [f"no such stop; other stops: {', '.join(others) or 'none'}"]), []
        first = stops[0]
        wrong = []
        if self.until_end:
            stretch = observed.between(first.stamp_ns, observed.end_ns)
            wrong = [describe(observed, pair) for pair in stretch if not (pair.is_enabled and pair.is_stop)]
        at_s = observed.at_s(first.stamp_ns)
        events = [
            Event(at_s=at_s, kind=EventKind.DETECTION, text=first.reason),
            Event(at_s=at_s, kind=EventKind.REACTION, text=f"SAFE_STOP, {first.drive['ACCEL_REQUEST']:.2f} m/s²"),
        ]
        return check(text, wrong, observed.since_s(first.stamp_ns), within_s), events


@dataclass(frozen=True)
class FallsSilent:
    """No command after this time, until the operator acts."""

    within_s: float = STOP_S
    waits_for: Wait = Wait.NOTHING

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        within_s = self.within_s + observed.later_s(self.waits_for)
        text = f"silence within {within_s * 1e3:.0f} ms, until armed again"
        late_ns = observed.inject_ns + round(within_s * S)
        wrong = [
            f"{observed.at_s(decoded.stamp_ns):.3f} s: {decoded.name}"
            for decoded in observed.decoded
            if decoded.name in observed.wire.command and late_ns <= decoded.stamp_ns < observed.then_ns
        ]
        last = observed.between(observed.inject_ns, late_ns)
        silent_ns = last[-1].stamp_ns if last else observed.inject_ns
        events = []
        if not wrong:
            events.append(
                Event(at_s=observed.at_s(silent_ns), kind=EventKind.REACTION, text="the last command before silence")
            )
        return check(text, wrong, None if wrong else observed.since_s(silent_ns), within_s), events


@dataclass(frozen=True)
class LetsGo:
    """ENABLE = 0 with one of these reasons within the time, and never ENABLE = 1 until the operator acts."""

    reasons: tuple[str, ...]
    within_s: float = STOP_S
    waits_for: Wait = Wait.STATUS

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        within_s = self.within_s + observed.later_s(self.waits_for)
        with_reason = f" with {' or '.join(self.reasons)}" if observed.wire.tells_reasons else ""
        text = f"ENABLE = 0{with_reason} within {within_s * 1e3:.0f} ms, until armed again"
        after = observed.between(observed.inject_ns, observed.then_ns)
        if not observed.wire.tells_enable:
            late_ns = observed.inject_ns + round(within_s * S)
            wrong = [describe(observed, pair) for pair in after if pair.stamp_ns > late_ns]
            return check(f"no command from {within_s * 1e3:.0f} ms on, until armed again", wrong), []
        released = [pair for pair in after if not pair.is_enabled and observed.has_reason(pair, self.reasons)]
        if not released:
            found = sorted({pair.reason for pair in after if not pair.is_enabled})
            return check(text, [f"no such command; other ENABLE = 0: {', '.join(found) or 'none'}"]), []
        first = released[0]
        wrong = [describe(observed, p) for p in after if p.is_enabled and p.stamp_ns > first.stamp_ns]
        event = Event(at_s=observed.at_s(first.stamp_ns), kind=EventKind.REACTION, text=f"ENABLE = 0, {first.reason}")
        return check(text, wrong, observed.since_s(first.stamp_ns), within_s), [event]


@dataclass(frozen=True)
class StaysOut:
    """No ENABLE = 1 from the end of the injection until the operator acts: no burst of old commands either.

    One command is allowed after silence: the device may have been stopped between reading and sending.
    """

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        settled_ns = observed.end_ns + round((0.05 + observed.later_s(Wait.STATUS)) * S)
        wrong = [describe(observed, pair) for pair in observed.between(settled_ns, observed.then_ns) if pair.is_enabled]
        at_once = [pair for pair in observed.between(observed.end_ns, settled_ns) if pair.is_enabled]
        if len(at_once) > 1 and not observed.between(observed.end_ns - round(STOP_S * S), observed.end_ns):
            wrong.append(f"{len(at_once)} commands in a burst, {describe(observed, at_once[0])}")
        return check("stays released until armed again", wrong), []


@dataclass(frozen=True)
class DrivesOn:
    """Neither a stop nor ENABLE = 0 from the injection until some time after it."""

    afterwards_s: float = 0.3

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = "drives on: no stop, no ENABLE = 0, no gap in the commands"
        end_ns = min(observed.end_ns + round(self.afterwards_s * S), observed.then_ns)
        pairs = observed.between(observed.inject_ns, end_ns)
        wrong = [describe(observed, pair) for pair in pairs if pair.is_stop or not pair.is_enabled]
        wrong += [
            f"{observed.at_s(a):.3f} s: no command for {(b - a) / S:.3f} s"
            for a, b in pairwise((observed.inject_ns, *(pair.stamp_ns for pair in pairs), end_ns))
            if b - a > max(WATCHDOG_NS, GAP_PERIODS * observed.wire.period_s * observed.wire.ticks_per_command * S)
        ]
        return check(text, wrong), []


@dataclass(frozen=True)
class FollowsGaps:
    """A dropped sample has no answer: between the samples around a gap there is one command, not two.

    Without gaps, a device that answers late by whole periods looks like one that answers at once.
    """

    gap_periods: tuple[float, float] = (1.5, 3.0)

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        shortest_ns, longest_ns = (round(limit * observed.wire.period_s * S) for limit in self.gap_periods)
        commands = [
            len(observed.between(before_ns, after_ns))
            for before_ns, after_ns in pairwise(observed.samples_ns)
            if observed.inject_ns < before_ns < observed.end_ns and shortest_ns < after_ns - before_ns < longest_ns
        ]
        text = f"a dropped sample drops a command within the period ({len(commands)} gaps)"
        late = sum(count > 1 for count in commands)
        wrong = [f"{late} of {len(commands)} gaps hold two commands or more"] if 2 * late >= len(commands) else []
        return check(text, wrong), []


@dataclass(frozen=True)
class MomentaryAtMost:
    """Stops for at most this long in total (any time if infinite), with these reasons; never ENABLE = 0."""

    reasons: tuple[str, ...]
    most_s: float

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        most_s = self.most_s + observed.later_s(Wait.STATE)
        limit = f"at most {most_s * 1e3:.0f} ms of stopping" if self.most_s < math.inf else "stops only for its reasons"
        text = f"{limit} ({', '.join(self.reasons)}), no ENABLE = 0"
        pairs = observed.between(observed.inject_ns, observed.then_ns)
        wrong = [
            describe(observed, pair)
            for pair in pairs
            if not pair.is_enabled or (pair.is_stop and not observed.has_reason(pair, self.reasons))
        ]
        if self.most_s == math.inf:
            return check(text, wrong), []
        stopped_s = sum(pair.is_stop for pair in pairs) * observed.wire.command_period_s
        return check(text, wrong, stopped_s, most_s), []


@dataclass(frozen=True)
class MakesUpForNothing:
    """After a silence the wheels are led on from where they were: the time without a command counts as `LED_ON_S`."""

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = f"after the silence the wheels turn no further than in {LED_ON_S} s"
        wire = observed.wire
        if not wire.commands_angle:
            return not_applicable(text, "the vehicle is not commanded a wheel angle"), []
        enabled = [pair for pair in observed.pairs if pair.is_enabled]
        gaps = [(a, b) for a, b in pairwise(enabled) if a.stamp_ns < observed.end_ns <= b.stamp_ns]
        most_rad = wire.profile["limits"]["front_wheel_rate_radps"] * LED_ON_S + wire.wheel_count_rad
        turned_rad = [abs(b.steer[FRONT_WHEEL] - a.steer[FRONT_WHEEL]) for a, b in gaps]
        return check(text, [f"by {rad:.3f} rad, at most {most_rad:.3f}" for rad in turned_rad if rad > most_rad]), []


@dataclass(frozen=True)
class Answers:
    """The share of samples that are answered during the injection is in this range.

    A stop for lack of state is no answer.
    """

    least: float
    most: float
    reasons: tuple[str, ...] = ("STATE_STALE",)

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = f"from {self.least:.0%} to {self.most:.0%} of the samples in this time are answered"
        ticks = sum(observed.inject_ns <= instant.at_ns < observed.end_ns for instant in observed.history)
        due = ticks / observed.wire.ticks_per_command
        pairs = [
            pair
            for pair in observed.between(observed.inject_ns, observed.end_ns)
            if not observed.wire.tells_reasons or pair.reason not in self.reasons
        ]
        share = len(pairs) / due if due else 0.0
        wrong = (
            [] if self.least <= share <= self.most else [f"{len(pairs)} commands for {due:.0f} samples ({share:.0%})"]
        )
        return check(text, wrong), []


@dataclass(frozen=True)
class NeverEnables:
    """No ENABLE = 1 from the beginning of the injection to its end; with `at_all`, not one frame."""

    at_all: bool = False

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        if self.at_all:
            wrong = [
                f"{observed.at_s(frame.stamp_ns):.3f} s: identifier 0x{frame.can_id:03X}" for frame in observed.frames
            ]
            return check("the device sends no frame at all", wrong), []
        pairs = observed.between(observed.inject_ns, observed.end_ns)
        return check("never ENABLE = 1", [describe(observed, pair) for pair in pairs if pair.is_enabled]), []


@dataclass(frozen=True)
class NeverDrives:
    """No command that drives until the injection is over: at most stops, or ENABLE = 0.

    Where no signal says that a command is a stop, the vehicle must not move.
    """

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        if not observed.wire.has_stop_signal:
            moving = (
                f"{observed.at_s(instant.at_ns):.3f} s: {instant.speed_mps:.2f} m/s"
                for instant in observed.history
                if observed.inject_ns <= instant.at_ns < observed.end_ns and abs(instant.speed_mps) > MOVES_MPS
            )
            return check("the vehicle does not move", moving), []
        pairs = observed.between(observed.inject_ns, observed.end_ns)
        wrong = [describe(observed, pair) for pair in pairs if pair.is_enabled and not pair.is_stop]
        return check("no command that drives", wrong), []


@dataclass(frozen=True)
class GivesUp:
    """Requests engagement for as long as the profile has it, says why it ends, and stays out until armed again."""

    slack_s: float = 0.3
    reason: str = "VEHICLE_NOT_AUTONOMOUS"

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        after_s = float(observed.wire.profile["timing"]["engage_timeout_s"])
        text = f"requests engagement for {after_s:.0f} s, then not again until armed"
        asked = [pair for pair in observed.between(observed.begin_ns, observed.then_ns) if pair.is_enabled]
        if not asked:
            return check(text, ["it never requested it"]), []
        first_ns, last_ns = asked[0].stamp_ns, asked[-1].stamp_ns
        asked_s = (last_ns - first_ns) / S
        wrong = [f"gave up after {asked_s:.2f} s"] if asked_s < after_s - self.slack_s else []
        if observed.then_ns - last_ns < S:
            wrong.append("it still requested it at the end")
        told = {pair.reason for pair in observed.between(last_ns + 1, observed.then_ns)}
        if observed.wire.tells_reasons and told != {self.reason}:
            wrong.append(f"says {', '.join(sorted(told)) or 'nothing'} then, not {self.reason}")
        event = Event(at_s=observed.at_s(last_ns), kind=EventKind.REACTION, text="the last ENABLE = 1")
        return check(text, wrong, asked_s, after_s + self.slack_s + observed.later_s(Wait.STATUS)), [event]
