"""What must be observed of the vehicle: that it stops, where it stops, and that its lights are on."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, S

from hil_bench.expect.base import Observation, check, describe, not_applicable
from hil_bench.result import Check, Event, EventKind
from hil_bench.vehicle import Instant
from hil_bench.vocabulary import Wait

AT_END_M, AT_END_S = 1.5, 1.0
WATCHDOG_S = 0.1
"""Of the reference vehicle."""


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
    waits_for: Wait = Wait.NOTHING

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        within_s = self.within_s + observed.later_s(self.waits_for) + observed.wire.watchdog_s - WATCHDOG_S
        text = f"the vehicle's watchdog trips within {within_s * 1e3:.0f} ms"
        at = next((i for i in observed.history if i.at_ns >= observed.inject_ns and i.mode == FAULT), None)
        if at is None:
            return check(text, ["it never tripped"]), []
        event = Event(at_s=observed.at_s(at.at_ns), kind=EventKind.DETECTION, text="the vehicle's watchdog")
        return check(text, [], observed.since_s(at.at_ns), within_s), [event]


@dataclass(frozen=True)
class HazardLights:
    """On within 500 ms of the injection, as at every stop but the end of a trajectory."""

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        if not observed.wire.has_lights:
            return not_applicable("hazard lights on within 500 ms", "the vehicle has no hazard lights on its bus"), []
        on = [t for t in observed.decoded if t.stamp_ns > observed.inject_ns and observed.wire.lights_in(t)]
        if not on:
            return check("hazard lights on", ["never on"]), []
        return check("hazard lights on within 500 ms", [], observed.since_s(on[0].stamp_ns), 0.5), []


@dataclass(frozen=True)
class AsksForItsSpeed:
    """SPEED_REQUEST is at most the speed of the route near the vehicle, where acceleration is commanded."""

    near_m: float = 6.0
    tolerance_mps: float = 0.5

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = "SPEED_REQUEST is no more than the route's speed where the vehicle is"
        if not observed.wire.commands_acceleration:
            return not_applicable(text, "the vehicle's speed is commanded, not told"), []
        wrong, place = [], 0
        for pair in observed.pairs[::10]:
            asked_mps = pair.drive.signals.get("SPEED_REQUEST")
            if asked_mps is None or not pair.is_enabled or pair.is_stop:
                continue
            while place + 1 < len(observed.history) and observed.history[place + 1].at_ns <= pair.stamp_ns:
                place += 1
            least_mps, most_mps = self._range_mps(observed, observed.history[place])
            if not least_mps - self.tolerance_mps <= asked_mps <= most_mps + self.tolerance_mps:
                between = f"not from {least_mps:.1f} to {most_mps:.1f} m/s"
                wrong.append(f"{observed.at_s(pair.stamp_ns):.3f} s: {asked_mps:.2f} m/s, {between}")
        return check(text, wrong), []

    def _range_mps(self, observed: Observation, instant: Instant) -> tuple[float, float]:
        """Of the points near the vehicle, and 0: where the gear changes, no speed is requested."""
        route = observed.route
        near = [0.0] + [
            speed_mps
            for x_m, y_m, speed_mps in zip(route.x_m, route.y_m, route.speed_mps, strict=True)
            if math.hypot(x_m - instant.x_m, y_m - instant.y_m) < self.near_m
        ]
        return min(0.0, *near), max(0.0, *near)


@dataclass(frozen=True)
class ReachesEnd:
    """A stop with one of these reasons where or when the route ends, without hazard lights, then standstill."""

    reasons: tuple[str, ...] = ("PAST_END_SPACE",)

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        if not observed.wire.tells_reasons:
            return self._judge_place(observed)
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
        told = [t for t in observed.decoded if first_ns < t.stamp_ns < observed.then_ns]
        lights = [on for one in told if (on := observed.wire.lights_in(one)) is not None]
        if any(lights[1:]):
            wrong.append("hazard lights at the end of the trajectory")
        wrong += self._too_early(observed, first_ns, stops[0].reason)
        rest = [i for i in observed.history if first_ns < i.at_ns < observed.then_ns]
        if not rest or abs(rest[-1].speed_mps) > 0.02:
            wrong.append("it is not at rest at the end")
        event = Event(at_s=observed.at_s(first_ns), kind=EventKind.REACTION, text=stops[0].reason)
        return check(text, wrong), [event]

    def _judge_place(self, observed: Observation) -> tuple[Check, list[Event]]:
        """Of a vehicle that is told no reason: at rest where the route ends, and enabled until then."""
        near_m = AT_END_M * min(1.0, observed.wire.length_share)
        text = f"reaches the end: at rest within {near_m:.2f} m of it, and enabled until then"
        driven = [i for i in observed.history if i.at_ns < observed.then_ns]
        if not any(i.mode == AUTONOMOUS for i in driven):
            return check(text, ["it was never driven"]), []
        last, route = driven[-1], observed.route
        left_m = math.hypot(route.x_m[-1] - last.x_m, route.y_m[-1] - last.y_m)
        wrong = (
            [] if left_m <= near_m else [f"{observed.at_s(last.at_ns):.3f} s: {left_m:.2f} m from the end of the route"]
        )
        if abs(last.speed_mps) > 0.02:
            wrong.append("it is not at rest at the end")
        first = next(i for i in driven if i.mode == AUTONOMOUS)
        moving = [
            i for i in driven if i.at_ns > first.at_ns and abs(i.speed_mps) > 0.3 * min(1.0, observed.wire.speed_share)
        ]
        if any(i.mode != AUTONOMOUS for i in moving):
            wrong.append("it was not autonomous all the way")
        rest = next((i for i in driven if moving and i.at_ns > moving[-1].at_ns and abs(i.speed_mps) <= 0.02), last)
        event = Event(at_s=observed.at_s(rest.at_ns), kind=EventKind.STANDSTILL, text="at rest")
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
