"""What must be observed of the vehicle's true motion, whatever its sensors say."""

import math
from dataclasses import dataclass

from vehicle_bus_contract.reference import AUTONOMOUS, S

from hil_bench.along_route import follow_route
from hil_bench.expect.base import Observation, check
from hil_bench.result import Check, Event, EventKind, Verdict

AT_DWELL_M = 0.75
"""A vehicle that stands this near stands at its dwell."""
STANDING_MPS = 0.05
EARLY_S = 0.2
"""By which it may set off before its time, for the rounding of times and speeds."""


@dataclass(frozen=True)
class StaysNear:
    """From the injection until the operator acts, the driven vehicle is truly within this distance of its route."""

    most_m: float

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        driven = [
            instant
            for instant in observed.history
            if observed.inject_ns <= instant.at_ns < observed.then_ns and instant.mode == AUTONOMOUS
        ]
        farthest_m = max((abs(place.lateral_m) for place in follow_route(observed.route, driven)), default=0.0)
        return Check(
            text="the vehicle stays near its path",
            verdict=Verdict.PASS if farthest_m <= self.most_m else Verdict.FAIL,
            measured=round(farthest_m, 3),
            limit=self.most_m,
            unit="m",
        ), []


@dataclass(frozen=True)
class StandsAtDwells:
    """The vehicle truly comes to rest at each dwell of its route, and sets off no earlier than the route does."""

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        route = observed.route
        engaged_ns = next((pair.stamp_ns for pair in observed.pairs if pair.is_enabled), observed.begin_ns)
        wrong: list[str] = []
        events: list[Event] = []
        for point in route.dwells():
            place = f"the dwell at {route.x_m[point]:.1f}, {route.y_m[point]:.1f} m"
            stands_ns = [
                each.at_ns
                for each in observed.history
                if abs(each.speed_mps) <= STANDING_MPS
                and each.at_ns >= engaged_ns
                and math.hypot(each.x_m - route.x_m[point], each.y_m - route.y_m[point]) <= AT_DWELL_M
            ]
            if not stands_ns:
                wrong.append(f"it does not stand at {place}")
                continue
            events.append(Event(at_s=observed.at_s(stands_ns[0]), kind=EventKind.STANDSTILL, text=f"stands at {place}"))
            early_s = route.time_s[point] - (stands_ns[-1] - engaged_ns) / S
            if early_s > EARLY_S:
                wrong.append(f"it sets off from {place} {early_s:.2f} s early")
        return check("the vehicle stands at each dwell of its route until its time", wrong), events
