"""What must be observed of the vehicle: that it stops, where it stops, and that its lights are on."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, S

from hil_bench.expect.base import Observation, check, describe
from hil_bench.result import Check, Event, EventKind

AT_END_M, AT_END_S = 1.5, 1.0


@dataclass(frozen=True)
class Standstill:
    """The vehicle is at rest within the time."""

    within_s: float

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = f"the vehicle is at rest within {self.within_s:.1f} s"
        at = next((i for i in observed.history if i.at_ns >= observed.inject_ns and abs(i.speed_mps) < 0.02), None)
        if at is None:
            return check(text, ["it never came to rest"]), []
        event = Event(at_s=observed.at_s(at.at_ns), kind=EventKind.STANDSTILL, text="the vehicle is at rest")
        return check(text, [], observed.since_s(at.at_ns), self.within_s), [event]


@dataclass(frozen=True)
class WatchdogActs:
    """The vehicle's own watchdog reacts to silence: mode FAULT within the time."""

    within_s: float = 0.25

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = f"the vehicle's watchdog trips within {self.within_s * 1e3:.0f} ms"
        at = next((i for i in observed.history if i.at_ns >= observed.inject_ns and i.mode == FAULT), None)
        if at is None:
            return check(text, ["it never tripped"]), []
        event = Event(at_s=observed.at_s(at.at_ns), kind=EventKind.DETECTION, text="the vehicle's watchdog")
        return check(text, [], observed.since_s(at.at_ns), self.within_s), [event]


@dataclass(frozen=True)
class HazardLights:
    """On within 500 ms of the injection, as at every stop but the end of a trajectory."""

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        on = [
            t
            for t in observed.decoded
            if t.name == "BODY_COMMAND" and t.stamp_ns > observed.inject_ns and t["HAZARD_LIGHTS"]
        ]
        if not on:
            return check("hazard lights on", ["never on"]), []
        return check("hazard lights on within 500 ms", [], observed.since_s(on[0].stamp_ns), 0.5), []


@dataclass(frozen=True)
class ReachesEnd:
    """A stop with one of these reasons where or when the route ends, without hazard lights, then standstill."""

    reasons: tuple[str, ...] = ("PAST_END_SPACE",)

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = f"reaches the end: {' or '.join(self.reasons)}, at rest"
        stops = [pair for pair in observed.pairs if pair.is_stop and pair.reason in self.reasons]
        if not stops:
            found = sorted({pair.reason for pair in observed.pairs if pair.is_stop})
            return check(text, [f"no such stop; other stops: {', '.join(found) or 'none'}"]), []
        first_ns = stops[0].stamp_ns
        wrong = [
            describe(observed, p)
            for p in observed.between(observed.begin_ns, first_ns)
            if p.is_stop and _is_moving(observed, p)
        ]
        lights = [
            decoded
            for decoded in observed.decoded
            if decoded.name == "BODY_COMMAND" and first_ns < decoded.stamp_ns < observed.then_ns
        ]
        if any(decoded["HAZARD_LIGHTS"] for decoded in lights[1:]):
            wrong.append("hazard lights at the end of the trajectory")
        wrong += self._too_early(observed, first_ns, stops[0].reason)
        rest = [i for i in observed.history if first_ns < i.at_ns < observed.then_ns]
        if not rest or abs(rest[-1].speed_mps) > 0.02:
            wrong.append("it is not at rest at the end")
        event = Event(at_s=observed.at_s(first_ns), kind=EventKind.REACTION, text=stops[0].reason)
        return check(text, wrong), [event]

    def _too_early(self, observed: Observation, first_ns: int, reason: str) -> Iterable[str]:
        """A device that reports the end must have driven the route."""
        driven = [i for i in observed.history if i.mode == AUTONOMOUS and i.at_ns <= first_ns]
        if not driven:
            yield "it was never driven"
        elif reason == "PAST_END_SPACE":
            left_m = math.hypot(observed.route.x_m[-1] - driven[-1].x_m, observed.route.y_m[-1] - driven[-1].y_m)
            if left_m > AT_END_M:
                yield f"{observed.at_s(first_ns):.3f} s: {left_m:.2f} m from the end of the route"
        elif abs((first_ns - driven[0].at_ns) / S - observed.route.time_s[-1]) > AT_END_S:
            took_s = (first_ns - driven[0].at_ns) / S
            yield f"after {took_s:.2f} s of a route that takes {observed.route.time_s[-1]:.2f} s"


def _is_moving(observed: Observation, pair: Pair) -> bool:
    """Whether a stop command meant a vehicle in motion (a change of direction is a stop at rest)."""
    at = next((i for i in observed.history if i.at_ns >= pair.stamp_ns), None)
    return at is not None and abs(at.speed_mps) > 0.3
