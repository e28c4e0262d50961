"""What must be observed when fields of the vehicle's state are wrong: a stop where they show it, and no harm anyway."""

import math
from bisect import bisect_right
from dataclasses import dataclass

from vehicle_bus_contract.reference import AUTONOMOUS, S

from hil_bench.along_route import follow_route
from hil_bench.contradictions import WINDOWS_S, Tolerances, find_contradiction, tell_truth
from hil_bench.expect.base import Observation, check, describe
from hil_bench.result import Check, Event, EventKind
from hil_bench.vehicle import Instant
from hil_bench.vocabulary import Wait
from hil_bench.wrong_fields import WrongFields

REACTS_S = 0.15
TOO_FAST_S = 1.0


@dataclass(frozen=True, kw_only=True)
class StopsOnContradiction:
    """No command drives the vehicle soon after its fields contradict one another clearly beyond the tolerances."""

    wrong: WrongFields
    is_from_start: bool = False
    """What the state was before is not compared: the device has forgotten it when it is armed."""

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        may = Tolerances.of(observed.wire)
        shown_ns, what = find_contradiction(self._told(observed, may), may, observed.inject_ns)
        if not shown_ns:
            return check("no command drives after its fields contradict each other: until the end they do not", []), []
        due_ns = shown_ns + round((REACTS_S + observed.later_s(Wait.STATE)) * S)
        driving = [p for p in observed.between(due_ns, observed.end_ns) if p.is_enabled and not p.is_stop]
        text = f"no command drives {(due_ns - shown_ns) / S * 1e3:.0f} ms after {what} contradict each other"
        event = Event(at_s=observed.at_s(shown_ns), kind=EventKind.DETECTION, text=f"{what} contradict each other")
        return check(text, [describe(observed, pair) for pair in driving]), [event]

    def _told(self, observed: Observation, may: Tolerances) -> list[tuple[int, dict[str, float]]]:
        begin_ns = observed.inject_ns
        since_ns = begin_ns - (0 if self.is_from_start else round(max(WINDOWS_S) * S))
        instants = [i for i in observed.history if since_ns < i.at_ns < observed.end_ns]
        true = [(instant.at_ns, tell_truth(instant, may.wheelbase_m)) for instant in instants]
        first = next((fields for at_ns, fields in true if at_ns > begin_ns), {})
        return [(at_ns, self.wrong.tell(fields, first) if at_ns > begin_ns else fields) for at_ns, fields in true]


@dataclass(frozen=True)
class DoesNoHarm:
    """While it is driven, the vehicle is truly within the profile's distance of its path, and not long too fast."""

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        may = observed.wire.profile["deviation"]
        most_m, most_mps = float(may["lateral_stop_m"]), max(map(abs, observed.route.speed_mps))
        if (
            observed.wire.loses_its_place
        ):  # no position confirms the speed, and dead reckoning by a wrong one goes astray
            most_m, most_mps = math.inf, float(observed.wire.profile["limits"]["speed_max_mps"])
        most_mps += float(may["overspeed_mps"])
        wrong, too_fast_s, before_ns = [], 0.0, observed.inject_ns
        driven = _driven(observed)
        for instant, place in zip(driven, follow_route(observed.route, driven), strict=True):
            if abs(place.lateral_m) > most_m:
                wrong.append(f"{observed.at_s(instant.at_ns):.3f} s: {abs(place.lateral_m):.2f} m off the path")
            is_too_fast = abs(instant.speed_mps) > most_mps
            too_fast_s = too_fast_s + (instant.at_ns - before_ns) / S if is_too_fast else 0.0
            before_ns = instant.at_ns
            if too_fast_s > TOO_FAST_S:
                wrong.append(f"{observed.at_s(instant.at_ns):.3f} s: {instant.speed_mps:.2f} m/s")
        beside = f"no further than {most_m:g} m off its path, nor " if most_m < math.inf else ""
        text = f"not driven {beside}for {TOO_FAST_S:g} s above {most_mps:.3g} m/s"
        return check(text, wrong), []


def _driven(observed: Observation) -> list[Instant]:
    """While the newest command drives."""
    stamps = [pair.stamp_ns for pair in observed.pairs]
    found = []
    for instant in observed.history:
        if observed.inject_ns <= instant.at_ns < observed.end_ns and instant.mode == AUTONOMOUS:
            newest = bisect_right(stamps, instant.at_ns) - 1
            if newest >= 0 and observed.pairs[newest].is_enabled and not observed.pairs[newest].is_stop:
                found.append(instant)
    return found
