"""What must be observed of the vehicle's true motion, whatever its sensors say."""

from dataclasses import dataclass

from vehicle_bus_contract.reference import AUTONOMOUS

from hil_bench.along_route import follow_route
from hil_bench.expect.base import Observation
from hil_bench.result import Check, Event, Verdict


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
