"""What must be observed of the device's process: how it ends, and what it says."""

import re
from dataclasses import dataclass

from vehicle_bus_contract.reference import S

from hil_bench.expect.base import Observation, check, describe
from hil_bench.result import Check, Event, EventKind
from hil_bench.vocabulary import Wait


@dataclass(frozen=True)
class Refuses:
    """The device ends with this status and sends no frame."""

    status: int
    within_s: float = 20.0

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = f"ends with status {self.status} before the first frame"
        wrong = []
        if observed.exit_status != self.status:
            wrong.append("it still runs" if observed.exit_status is None else f"status {observed.exit_status}")
        wrong += [f"{observed.at_s(frame.stamp_ns):.3f} s: 0x{frame.can_id:03X}" for frame in observed.frames]
        event = Event(
            at_s=observed.at_s(observed.exit_ns), kind=EventKind.REACTION, text=f"status {observed.exit_status}"
        )
        return check(text, wrong), [event]


@dataclass(frozen=True)
class Ends:
    """The device ends within the time, with one of these statuses (negative: by a signal)."""

    status: tuple[int, ...]
    within_s: float

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = f"ends with status {' or '.join(map(str, self.status))} within {self.within_s:.0f} s"
        if observed.exit_status is None:
            return check(text, ["it still runs"]), []
        wrong = [] if observed.exit_status in self.status else [f"status {observed.exit_status}"]
        event = Event(
            at_s=observed.at_s(observed.exit_ns), kind=EventKind.REACTION, text=f"status {observed.exit_status}"
        )
        return check(text, wrong, observed.since_s(observed.exit_ns), self.within_s), [event]


@dataclass(frozen=True)
class EndsOrderly:
    """After the signal: stop commands until standstill, then ENABLE = 0, then nothing."""

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        text = "stop commands until standstill, then ENABLE = 0, then nothing"
        pairs = observed.between(
            observed.inject_ns + round((0.1 + observed.later_s(Wait.STATE)) * S), observed.then_ns + 60 * S
        )
        wrong = [describe(observed, pair) for pair in pairs if pair.is_enabled and not pair.is_stop]
        if not pairs or pairs[-1].is_enabled:
            wrong.append("the last command has ENABLE = 1" if pairs else "no command at all")
        last_ns = pairs[-1].stamp_ns if pairs else observed.inject_ns
        moving = [i for i in observed.history if i.at_ns >= last_ns][:1]
        if moving and abs(moving[0].speed_mps) > 0.1:
            wrong.append(f"released at {moving[0].speed_mps:.2f} m/s")
        return check(text, wrong), []


@dataclass(frozen=True)
class NamesBus:
    """The device's output names the bus as the profile does, before the operator acts again."""

    bus: int

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        name = observed.wire.buses[self.bus]
        is_named = re.search(rf"\b{re.escape(name)}\b", observed.said) is not None
        last = (observed.said.strip() or "nothing").splitlines()[-1]
        return check(f"its output names the bus {name}", [] if is_named else [f"it says: {last}"]), []
