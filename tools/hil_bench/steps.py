"""Several injections in one drive: each one is made, observed and taken back before the next."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import msgspec
from vehicle_bus_contract.reference import AUTONOMOUS, S

from hil_bench.expect import Expectation, Measurement, Observation, check, measure
from hil_bench.faults.base import Injection, release
from hil_bench.result import Check, Event, EventKind, Measured
from hil_bench.rig import Rig
from hil_bench.vocabulary import Wait

REARM_S = 8.0
REARM_AGAIN_S = 2.5
REACH_S = 12.0
"""Time in which the vehicle reaches a step's speed."""
RECOVERS_S = 1.0
"""A device that has not driven on by then is armed again."""
BEFORE_S = 0.3
"""What is missing from the start has been missing for so long when the device is armed."""
CAN_BEGIN = ": can begin"
ATTEMPTS = 3
REST_S = 10.0
"""Time in which the driver brings the vehicle to rest."""
STOPPED_S = 0.3
STEADY_S = 0.25
"""The vehicle is driven for this long before a step begins."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """One injection of several in a drive."""

    name: str
    inject: Injection
    for_s: float = 0.4
    see: tuple[Expectation, ...] = ()
    measure: tuple[Measurement, ...] = ()
    after_s: float = 0.0
    """Observed after the injection, before the operator acts."""
    at_mps: float | None = None
    """The injection begins at this speed; None: at the case's."""
    is_from_start: bool = False
    """The device is released, and armed again during the injection."""
    ends_with_stop: bool = False
    """The injection ends when the device has stopped the vehicle, if that is sooner."""
    is_left_alone: bool = False
    """The operator arms the device again after it, even if it drives on."""


@dataclass(frozen=True, kw_only=True)
class StepFindings:
    """What was found in one step."""

    checks: list[Check] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    measured: list[Measured] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """When a step was carried out, ns; without a beginning it was not."""

    step: Step
    begin_ns: int = 0
    end_ns: int = 0
    then_ns: int = 0
    why: str = ""
    """It could not begin."""

    def judge(self, observed: Observation) -> StepFindings:
        """What the step expects and measures, by what was observed meanwhile."""
        if self.why:
            return StepFindings(checks=[check(f"{self.step.name}{CAN_BEGIN}", [self.why])])
        seen = replace(observed, inject_ns=self.begin_ns, end_ns=self.end_ns, then_ns=self.then_ns)
        judged = [expectation.judge(seen) for expectation in self.step.see]
        checks = [msgspec.structs.replace(one, text=f"{self.step.name}: {one.text}") for one, _ in judged]
        events = [event for _, at in judged for event in at]
        return StepFindings(checks=checks, events=events, measured=measure(self.step.measure, seen))


def run_steps(rig: Rig, steps: Sequence[Step], *, at_mps: float) -> list[Stretch]:
    """Carry out each step; the device drives between them, armed again where it does not drive on by itself."""
    stretches: list[Stretch] = []
    for step in steps:
        why = _release(rig) if step.is_from_start else _drive(rig, at_mps if step.at_mps is None else step.at_mps)
        if why:
            rig.note(EventKind.CLEAN_UP, f"{step.name}: {why}")
            stretches.append(Stretch(step=step, why=why))
            break
        stretches.append(_carry_out(rig, step))
    return stretches


def rearm(rig: Rig) -> None:
    """Make the vehicle ready, then arm the device, as an operator does; repeat until it engages."""
    end_ns = rig.now_ns + round(REARM_S * S)
    rig.note(EventKind.CLEAN_UP, "the vehicle is made ready, the device is armed again")
    while rig.now_ns < end_ns and not rig.is_engaged:
        rig.vehicle.make_ready()
        rig.run_for(0.3)
        rig.rearm()
        again_ns = rig.now_ns + round(REARM_AGAIN_S * S)
        while not rig.is_engaged and rig.now_ns < again_ns:
            rig.tick()
    if rig.is_engaged:
        rig.note(EventKind.CLEAN_UP, "engaged again")


def _carry_out(rig: Rig, step: Step) -> Stretch:
    rig.mark_injection()
    begin_ns = rig.inject_ns
    rig.touched_ns = rig.touched_ns or begin_ns
    rig.note(EventKind.INJECTION, step.name)
    with step.inject(rig):
        if step.is_from_start:
            rig.run_for(BEFORE_S + rig.wire.later_s[Wait.STATUS_LOST])
            rig.rearm()
        if step.ends_with_stop:
            _run_until_stopped(rig, step.for_s)
        else:
            rig.run_for(step.for_s)
        rig.end_ns = end_ns = rig.now_ns
    rig.run_for(step.after_s)
    then_ns = rig.now_ns
    if step.is_left_alone:
        release(rig)
    return Stretch(step=step, begin_ns=begin_ns, end_ns=end_ns, then_ns=then_ns)


def _run_until_stopped(rig: Rig, longest_s: float) -> None:
    """Until a stop has lasted for a moment."""
    end_ns = rig.now_ns + round(longest_s * S)
    was_driven, stopped_ns = rig.is_engaged, 0
    while rig.now_ns < end_ns and not (stopped_ns and rig.now_ns - stopped_ns > STOPPED_S * S):
        rig.tick()
        was_driven = was_driven or rig.is_engaged
        stopped_ns = 0 if rig.is_engaged or not was_driven else stopped_ns or rig.now_ns


def _release(rig: Rig) -> str:
    """The device is not armed, and the vehicle at rest; why not, if so."""
    release(rig)
    rig.vehicle.driver_brake = True
    rig.wait_for(lambda: rig.vehicle.is_standing, REST_S, "the driver to stop the vehicle")
    rig.vehicle.make_ready()
    return "the device engaged unasked" if rig.is_engaged else ""


def _drive(rig: Rig, at_mps: float) -> str:
    """The device drives the vehicle at this speed; why not, if so."""
    for _ in range(ATTEMPTS):
        if rig.vehicle.mode == AUTONOMOUS:
            rig.wait_for(lambda: rig.is_engaged, RECOVERS_S, "the device to drive on")
        if not rig.is_engaged:
            rearm(rig)
        rig.wait_for(lambda: abs(rig.vehicle.plant.speed_mps) >= at_mps, REACH_S, f"{at_mps:.3g} m/s")
        rig.run_for(STEADY_S)
        if rig.is_engaged and abs(rig.vehicle.plant.speed_mps) >= 0.9 * at_mps:
            return ""
    return f"it does not drive at {at_mps:.3g} m/s"
