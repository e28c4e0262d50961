"""What must be seen of the device, judged afterwards on what was on the bus, by the kernel's stamps."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

from bus_contract import AUTONOMOUS, Frame, S, Told
from bus_contract_judge import Pair

from hil.result import Check, Event, EventKind, Verdict
from hil.routes import Route
from hil.vehicle import WATCHDOG_NS, Instant

STOP_S = 0.150
PERIOD_S = 0.010
AT_END_M, AT_END_S = 1.5, 1.0


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What there is to judge by. Instants are monotonic, ns."""

    begin_ns: int
    inject_ns: int
    """The injection begins; 0 where there is none."""
    end_ns: int
    """The injection is over."""
    then_ns: int
    """The operator acts again, or the device is told to end."""
    samples_ns: Sequence[int]
    """When each complete sample was on the bus."""
    pairs: Sequence[Pair]
    told: Sequence[Told]
    """Everything intact that the device said."""
    frames: Sequence[Frame]
    """Everything that the device said."""
    history: Sequence[Instant]
    exit_status: int | None
    exit_ns: int
    route: Route

    def at_s(self, stamp_ns: int) -> float:
        """On the case's time line."""
        return (stamp_ns - self.begin_ns) / S

    def since_s(self, stamp_ns: int) -> float:
        """After the beginning of the injection; what was under way already counts as at once."""
        return max(0.0, (stamp_ns - self.inject_ns) / S)

    def between(self, begin_ns: int, end_ns: int) -> list[Pair]:
        """Commands sent then."""
        return [pair for pair in self.pairs if begin_ns <= pair.stamp_ns < end_ns]


class Expectation(Protocol):
    """One thing that must be seen."""

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        """Whether it was, and what of it belongs on the time line."""
        ...


def check(text: str, wrong: Iterable[str], measured: float | None = None, limit: float | None = None) -> Check:
    """Passed when nothing was wrong and what was measured (s) is within its limit."""
    found = list(wrong)
    if measured is not None and limit is not None and measured > limit:
        found.insert(0, f"{measured * 1e3:.1f} ms, more than {limit * 1e3:.0f} ms")
    return Check(
        text=text,
        verdict=Verdict.FAIL if found else Verdict.PASS,
        measured=None if measured is None else measured * 1e3,
        limit=None if limit is None else limit * 1e3,
        unit="" if measured is None and limit is None else "ms",
        found=found[:8],
    )


def _described(seen: Seen, pair: Pair) -> str:
    stop = ", stop" if pair.is_stop else ""
    return f"{seen.at_s(pair.stamp_ns):.3f} s: ENABLE {pair.is_enabled:d}{stop}, {pair.reason}"


@dataclass(frozen=True)
class Stops:
    """A stop command with one of these reasons within the time, and only stops until the injection is over.

    ENABLE stays 1: a vehicle that is let go rolls.
    """

    reasons: tuple[str, ...]
    within_s: float = STOP_S
    until_end: bool = True

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"a stop with {' or '.join(self.reasons)} within {self.within_s * 1e3:.0f} ms"
        begin_ns = seen.inject_ns
        after = [pair for pair in seen.pairs if pair.stamp_ns >= begin_ns and pair.is_enabled]
        stops = [pair for pair in after if pair.is_stop and pair.reason in self.reasons]
        if not stops:
            others = sorted({pair.reason for pair in after if pair.is_stop})
            return check(text, [f"no such stop; stops with {', '.join(others) or 'no reason at all'}"]), []
        first = stops[0]
        wrong = []
        if self.until_end:
            stretch = seen.between(first.stamp_ns, seen.end_ns)
            wrong = [_described(seen, pair) for pair in stretch if not (pair.is_enabled and pair.is_stop)]
        at_s = seen.at_s(first.stamp_ns)
        events = [
            Event(at_s=at_s, kind=EventKind.DETECTION, text=first.reason),
            Event(at_s=at_s, kind=EventKind.REACTION, text=f"SAFE_STOP, {first.drive['ACCEL_REQUEST']:.2f} m/s²"),
        ]
        return check(text, wrong, seen.since_s(first.stamp_ns), self.within_s), events


@dataclass(frozen=True)
class FallsSilent:
    """No command later than this, until the operator acts."""

    within_s: float = STOP_S

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"silence within {self.within_s * 1e3:.0f} ms, until it is armed again"
        late_ns = seen.inject_ns + round(self.within_s * S)
        wrong = [
            f"{seen.at_s(told.stamp_ns):.3f} s: {told.name}"
            for told in seen.told
            if told.name.endswith("COMMAND") and told.name != "BODY_COMMAND" and late_ns <= told.stamp_ns < seen.then_ns
        ]
        last = seen.between(seen.inject_ns, late_ns)
        silent_ns = last[-1].stamp_ns if last else seen.inject_ns
        events = []
        if not wrong:
            events.append(
                Event(at_s=seen.at_s(silent_ns), kind=EventKind.REACTION, text="the last command before silence")
            )
        return check(text, wrong, None if wrong else seen.since_s(silent_ns), self.within_s), events


@dataclass(frozen=True)
class LetsGo:
    """ENABLE = 0 with one of these reasons within the time, and never ENABLE = 1 until the operator acts."""

    reasons: tuple[str, ...]
    within_s: float = STOP_S

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"ENABLE = 0 with {' or '.join(self.reasons)} within {self.within_s * 1e3:.0f} ms, and it stays so"
        after = seen.between(seen.inject_ns, seen.then_ns)
        released = [pair for pair in after if not pair.is_enabled and pair.reason in self.reasons]
        if not released:
            found = sorted({pair.reason for pair in after if not pair.is_enabled})
            return check(text, [f"no such command; ENABLE = 0 with {', '.join(found) or 'no reason at all'}"]), []
        first = released[0]
        wrong = [_described(seen, p) for p in after if p.is_enabled and p.stamp_ns > first.stamp_ns]
        event = Event(at_s=seen.at_s(first.stamp_ns), kind=EventKind.REACTION, text=f"ENABLE = 0, {first.reason}")
        return check(text, wrong, seen.since_s(first.stamp_ns), self.within_s), [event]


@dataclass(frozen=True)
class DrivesOn:
    """Neither a stop nor ENABLE = 0 from the injection until some time after it."""

    afterwards_s: float = 0.3

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = "drives on: no stop, no ENABLE = 0, no gap in the commands"
        end_ns = min(seen.end_ns + round(self.afterwards_s * S), seen.then_ns)
        pairs = seen.between(seen.inject_ns, end_ns)
        wrong = [_described(seen, pair) for pair in pairs if pair.is_stop or not pair.is_enabled]
        wrong += [
            f"{seen.at_s(a):.3f} s: no command for {(b - a) / S:.3f} s"
            for a, b in pairwise((seen.inject_ns, *(pair.stamp_ns for pair in pairs), end_ns))
            if b - a > WATCHDOG_NS
        ]
        return check(text, wrong), []


@dataclass(frozen=True)
class FollowsGaps:
    """Where a sample was left out, so is its answer: between the samples beside a gap there is one command, not two.

    In a steady stream a device that answers late by whole periods cannot be told from one that answers at once.
    """

    gap_s: tuple[float, float] = (1.5 * PERIOD_S, 3.0 * PERIOD_S)

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        shortest_ns, longest_ns = (round(limit * S) for limit in self.gap_s)
        commands = [
            len(seen.between(before_ns, after_ns))
            for before_ns, after_ns in pairwise(seen.samples_ns)
            if seen.inject_ns < before_ns < seen.end_ns and shortest_ns < after_ns - before_ns < longest_ns
        ]
        text = f"a sample that is left out leaves out a command within the period ({len(commands)} gaps)"
        late = sum(count > 1 for count in commands)
        wrong = [f"{late} of {len(commands)} gaps hold two commands or more"] if 2 * late >= len(commands) else []
        return check(text, wrong), []


@dataclass(frozen=True)
class MomentaryAtMost:
    """Stops for so long at most, with these reasons; never ENABLE = 0."""

    reasons: tuple[str, ...]
    most_s: float

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"at most {self.most_s * 1e3:.0f} ms of stopping ({', '.join(self.reasons)}), no ENABLE = 0"
        pairs = seen.between(seen.inject_ns, seen.then_ns)
        wrong = [
            _described(seen, pair)
            for pair in pairs
            if not pair.is_enabled or (pair.is_stop and pair.reason not in self.reasons)
        ]
        stopped_s = sum(pair.is_stop for pair in pairs) * PERIOD_S
        return check(text, wrong, stopped_s, self.most_s), []


@dataclass(frozen=True)
class Answers:
    """So many of the vehicle's samples while the injection works are answered, in parts of all: no more and no fewer.

    A command that stops for lack of state is no answer.
    """

    least: float
    most: float
    reasons: tuple[str, ...] = ("STATE_STALE",)

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"from {self.least:.0%} to {self.most:.0%} of the samples in this time are answered"
        due = sum(seen.inject_ns <= instant.at_ns < seen.end_ns for instant in seen.history)
        pairs = [pair for pair in seen.between(seen.inject_ns, seen.end_ns) if pair.reason not in self.reasons]
        share = len(pairs) / due if due else 0.0
        wrong = [] if self.least <= share <= self.most else [f"{len(pairs)} commands for {due} samples ({share:.0%})"]
        return check(text, wrong), []


@dataclass(frozen=True)
class Standstill:
    """The vehicle stands within the time."""

    within_s: float

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"the vehicle stands within {self.within_s:.1f} s"
        at = next((i for i in seen.history if i.at_ns >= seen.inject_ns and abs(i.speed_mps) < 0.02), None)
        if at is None:
            return check(text, ["it never stood"]), []
        event = Event(at_s=seen.at_s(at.at_ns), kind=EventKind.STANDSTILL, text="the vehicle stands")
        return check(text, [], seen.since_s(at.at_ns), self.within_s), [event]


@dataclass(frozen=True)
class NeverEnables:
    """No ENABLE = 1 until the injection is over; with `at_all`, not one frame."""

    at_all: bool = False

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        if self.at_all:
            wrong = [f"{seen.at_s(frame.stamp_ns):.3f} s: identifier 0x{frame.can_id:03X}" for frame in seen.frames]
            return check("not one frame of the device's is on the bus", wrong), []
        pairs = seen.between(seen.begin_ns, seen.end_ns)
        return check("never ENABLE = 1", [_described(seen, pair) for pair in pairs if pair.is_enabled]), []


@dataclass(frozen=True)
class GivesUp:
    """Asks for so long, and then no more until the operator acts."""

    after_s: float
    slack_s: float = 0.3

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"asks the vehicle for {self.after_s:.0f} s, then no more until it is armed again"
        asked = [pair for pair in seen.between(seen.begin_ns, seen.then_ns) if pair.is_enabled]
        if not asked:
            return check(text, ["it never asked"]), []
        first_ns, last_ns = asked[0].stamp_ns, asked[-1].stamp_ns
        asked_s = (last_ns - first_ns) / S
        wrong = [f"gave up after {asked_s:.2f} s"] if asked_s < self.after_s - self.slack_s else []
        if seen.then_ns - last_ns < S:
            wrong.append("it still asked at the end")
        event = Event(at_s=seen.at_s(last_ns), kind=EventKind.REACTION, text="the last ENABLE = 1")
        return check(text, wrong, asked_s, self.after_s + self.slack_s), [event]


@dataclass(frozen=True)
class StaysOut:
    """From the end of the injection until the operator acts, no ENABLE = 1: no burst of old commands either.

    One that had been silent may have been stopped between its last look and its last word: that is one command.
    """

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        settled_ns = seen.end_ns + round(0.05 * S)
        wrong = [_described(seen, pair) for pair in seen.between(settled_ns, seen.then_ns) if pair.is_enabled]
        at_once = [pair for pair in seen.between(seen.end_ns, settled_ns) if pair.is_enabled]
        if len(at_once) > 1 and not seen.between(seen.end_ns - round(STOP_S * S), seen.end_ns):
            wrong.append(f"{len(at_once)} commands in a burst, {_described(seen, at_once[0])}")
        return check("stays out until it is armed again", wrong), []


@dataclass(frozen=True)
class Refuses:
    """The device ends with this status, and not one frame of its was on the bus."""

    status: int
    within_s: float = 20.0

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"ends with status {self.status} before the first frame"
        wrong = []
        if seen.exit_status != self.status:
            wrong.append("it runs" if seen.exit_status is None else f"status {seen.exit_status}")
        wrong += [f"{seen.at_s(frame.stamp_ns):.3f} s: 0x{frame.can_id:03X}" for frame in seen.frames]
        event = Event(at_s=seen.at_s(seen.exit_ns), kind=EventKind.REACTION, text=f"status {seen.exit_status}")
        return check(text, wrong), [event]


@dataclass(frozen=True)
class Ends:
    """The device has ended within the time after the injection, with one of these statuses (negative: by a signal)."""

    status: tuple[int, ...]
    within_s: float

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"ends with status {' or '.join(map(str, self.status))} within {self.within_s:.0f} s"
        if seen.exit_status is None:
            return check(text, ["it runs"]), []
        wrong = [] if seen.exit_status in self.status else [f"status {seen.exit_status}"]
        event = Event(at_s=seen.at_s(seen.exit_ns), kind=EventKind.REACTION, text=f"status {seen.exit_status}")
        return check(text, wrong, seen.since_s(seen.exit_ns), self.within_s), [event]


@dataclass(frozen=True)
class EndsOrderly:
    """After the signal: stops until standstill, then ENABLE = 0, and nothing more."""

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = "stop commands until standstill, then ENABLE = 0, then nothing"
        pairs = seen.between(seen.inject_ns + round(0.1 * S), seen.then_ns + 60 * S)
        wrong = [_described(seen, pair) for pair in pairs if pair.is_enabled and not pair.is_stop]
        if not pairs or pairs[-1].is_enabled:
            wrong.append("the last command has ENABLE = 1" if pairs else "no command at all")
        last_ns = pairs[-1].stamp_ns if pairs else seen.inject_ns
        moving = [i for i in seen.history if i.at_ns >= last_ns][:1]
        if moving and abs(moving[0].speed_mps) > 0.1:
            wrong.append(f"let go at {moving[0].speed_mps:.2f} m/s")
        return check(text, wrong), []


@dataclass(frozen=True)
class WatchdogActs:
    """The device is silent, and the vehicle's own watchdog brings it to FAULT within the time."""

    within_s: float = 0.25

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"the vehicle's watchdog acts within {self.within_s * 1e3:.0f} ms"
        at = next((i for i in seen.history if i.at_ns >= seen.inject_ns and i.mode == 3), None)
        if at is None:
            return check(text, ["it never acted"]), []
        event = Event(at_s=seen.at_s(at.at_ns), kind=EventKind.DETECTION, text="the vehicle's watchdog")
        return check(text, [], seen.since_s(at.at_ns), self.within_s), [event]


@dataclass(frozen=True)
class ReachesEnd:
    """A stop with one of these reasons, where or when the route ends, without hazard lights, and standstill."""

    reasons: tuple[str, ...] = ("PAST_END_SPACE",)

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        text = f"comes to the end: {' or '.join(self.reasons)}, at rest"
        stops = [pair for pair in seen.pairs if pair.is_stop and pair.reason in self.reasons]
        if not stops:
            found = sorted({pair.reason for pair in seen.pairs if pair.is_stop})
            return check(text, [f"stops only with {', '.join(found) or 'no reason at all'}"]), []
        first_ns = stops[0].stamp_ns
        wrong = [
            _described(seen, p) for p in seen.between(seen.begin_ns, first_ns) if p.is_stop and _is_moving(seen, p)
        ]
        lights = [told for told in seen.told if told.name == "BODY_COMMAND" and first_ns < told.stamp_ns < seen.then_ns]
        if any(told["HAZARD_LIGHTS"] for told in lights[1:]):
            wrong.append("hazard lights at the end of the trajectory")
        wrong += self._too_early(seen, first_ns, stops[0].reason)
        rest = [i for i in seen.history if first_ns < i.at_ns < seen.then_ns]
        if not rest or abs(rest[-1].speed_mps) > 0.02:
            wrong.append("it does not stand at the end")
        event = Event(at_s=seen.at_s(first_ns), kind=EventKind.REACTION, text=stops[0].reason)
        return check(text, wrong), [event]

    def _too_early(self, seen: Seen, first_ns: int, reason: str) -> Iterable[str]:
        """Whoever says that the route is over must have driven it."""
        driven = [i for i in seen.history if i.mode == AUTONOMOUS and i.at_ns <= first_ns]
        if not driven:
            yield "it was never driven"
        elif reason == "PAST_END_SPACE":
            left_m = math.hypot(seen.route.x_m[-1] - driven[-1].x_m, seen.route.y_m[-1] - driven[-1].y_m)
            if left_m > AT_END_M:
                yield f"{seen.at_s(first_ns):.3f} s: {left_m:.2f} m from the end of the route"
        elif abs((first_ns - driven[0].at_ns) / S - seen.route.time_s[-1]) > AT_END_S:
            took_s = (first_ns - driven[0].at_ns) / S
            yield f"after {took_s:.2f} s of a route that takes {seen.route.time_s[-1]:.2f} s"


def _is_moving(seen: Seen, pair: Pair) -> bool:
    """Whether a stop command meant a vehicle in motion (a change of direction is a stop at rest)."""
    at = next((i for i in seen.history if i.at_ns >= pair.stamp_ns), None)
    return at is not None and abs(at.speed_mps) > 0.3


@dataclass(frozen=True)
class HazardLights:
    """On within half a second of the injection, as at every stop but the end of a trajectory."""

    def judge(self, seen: Seen) -> tuple[Check, list[Event]]:
        on = [t for t in seen.told if t.name == "BODY_COMMAND" and t.stamp_ns > seen.inject_ns and t["HAZARD_LIGHTS"]]
        if not on:
            return check("hazard lights on", ["never on"]), []
        return check("hazard lights on within 500 ms", [], seen.since_s(on[0].stamp_ns), 0.5), []
