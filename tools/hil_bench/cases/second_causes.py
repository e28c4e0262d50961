"""A second cause while the first one still acts: of a vehicle that is stopped, released, or at the end of its run."""

import signal
from dataclasses import replace

from hil_bench import routes
from hil_bench.case import Case, Need, Then
from hil_bench.cases.common import ANY
from hil_bench.cases.thresholds.common import Numbers, backwards, sequence_case, straight
from hil_bench.cases.thresholds.deviation import NO_STOP
from hil_bench.cases.thresholds.driver import RELEASES_S
from hil_bench.cases.thresholds.times import find_recurring
from hil_bench.expect import Ends, EndsOrderly, LetsGo, NeverEnables, StaysOut, Stops
from hil_bench.faults import base, frames, growing, process, signals, vehicle
from hil_bench.faults.base import Injection
from hil_bench.parts import Part
from hil_bench.steps import Step
from hil_bench.wire import Wire

PUSHED_S, OVERRIDES_S, FAULT_S, DRIVER_S = 0.4, 0.7, 0.4, 0.4
"""From the beginning of the injection until the slope ends, the driver acts, the vehicle reports its fault."""
ROLLED_BACK = base.combine(
    vehicle.change_vehicle(plant_push_mps2=-7.0), vehicle.change_after(PUSHED_S, plant_push_mps2=0.0)
)
"""A slope against a vehicle that drives forwards, for a while."""
FAULT_CODE = 5
TURNED_SHARE = 0.4
"""Of the greatest wheel angle."""
LATCHED_FAULT = 4
"""Exit status."""


def second_cause_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    turned_rad = TURNED_SHARE * numbers.or_else("limits.front_wheel_angle_rad", 0.5)
    recurring = find_recurring(numbers)
    held_s = recurring.every_s * (recurring.stops - 1.0) + 0.6
    status_s = numbers.or_else("timing.status_period_s", 0.02)
    return (
        Case(
            name="driver-brakes-during-a-stop",
            fault="V1",
            tags=("driver", "deviation"),
            proves="A driver gets the vehicle also while the device stops it, and holds it.",
            injected="a slope rolls the vehicle back until it is stopped; the driver brakes, the mode stays AUTONOMOUS",
            route=straight(),
            at_mps=1.0,
            inject=growing.take_back(base.combine(ROLLED_BACK, _brake_after(OVERRIDES_S))),
            for_s=OVERRIDES_S + 0.4,
            after_s=1.0,
            about=(Part.BACKWARDS, Part.BRAKE),
            lacks="" if wire.has_stop_signal else NO_STOP,
            see=(LetsGo(("DRIVER_OVERRIDE",), within_s=OVERRIDES_S + RELEASES_S + status_s), StaysOut()),
            then=Then.REARM,
            allow=ANY | {"command"},
            needs=(Need.REARM,),
        ),
        Case(
            name="rolled-back-for-a-moment",
            fault="C8",
            tags=("state", "deviation"),
            proves="A vehicle that was stopped for a deviation is held when the cause is gone and it stands.",
            injected="a slope rolls the vehicle back until it is stopped, then no longer",
            route=straight(),
            at_mps=1.0,
            inject=ROLLED_BACK,
            for_s=4.0,
            about=(Part.BACKWARDS,),
            see=(Stops(("DEVIATION",), within_s=1.2),),
            then=Then.HOLDS,
            after_s=1.0,
            allow=frozenset({"command"}),
            exit_status=(0, LATCHED_FAULT),
        ),
        Case(
            name="ended-in-reverse",
            fault="P2",
            tags=("process",),
            proves="A vehicle that drives in reverse is braked to standstill, and only then released.",
            injected="SIGTERM in reverse",
            route=backwards(),
            at_mps=2.0,
            inject=process.send_signals(signal.SIGTERM),
            for_s=0.1,
            about=(Part.REVERSE,),
            see=(Stops(("SHUTDOWN",), until_end=False), EndsOrderly(), Ends((0,), 12.0)),
            then=Then.ENDED,
            needs=(Need.OWN_PROCESS,),
        ),
        Case(
            name="fault-during-the-end",
            fault="P2 V4",
            tags=("process", "driver"),
            proves="A fault of the vehicle during the last stop releases it, and shows in the exit status.",
            injected=f"SIGTERM, and a fault of the vehicle {FAULT_S} s later",
            route=lambda: routes.straight(300.0, 6.0),
            at_mps=5.0,
            inject=base.combine(
                process.send_signals(signal.SIGTERM), vehicle.change_after(FAULT_S, fault_code=FAULT_CODE)
            ),
            for_s=FAULT_S + 0.2,
            lacks="" if wire.has("FAULT_CODE") else "on the vehicle's bus a fault is no other than an override",
            see=(Ends((LATCHED_FAULT,), 12.0),),
            then=Then.ENDED,
            exit_status=(LATCHED_FAULT,),
            allow=ANY | {"release", "command"},
            needs=(Need.OWN_PROCESS,),
        ),
        Case(
            name="driver-brakes-while-held",
            fault="V1",
            tags=("driver", "state"),
            proves="A driver gets the vehicle also while the device holds it after stops that recurred.",
            injected="the pose is invalid again and again; the driver brakes when the vehicle is held",
            route=straight(),
            at_mps=2.5,
            inject=base.combine(recurring.inject, _brake_after(held_s)),
            for_s=held_s + 0.4,
            after_s=1.0,
            lacks=recurring.lacks,
            about=(Part.BRAKE,),
            see=(LetsGo(("DRIVER_OVERRIDE",), within_s=held_s + RELEASES_S + status_s), StaysOut()),
            then=Then.REARM,
            allow=ANY,
            needs=(Need.REARM,),
        ),
        Case(
            name="driver-brakes-during-the-end",
            fault="P2 V1",
            tags=("process", "driver"),
            proves="A driver gets the vehicle also during the last stop.",
            injected=f"SIGTERM, and the driver brakes {DRIVER_S} s later, the mode stays AUTONOMOUS",
            route=lambda: routes.straight(300.0, 6.0),
            at_mps=5.0,
            inject=base.combine(process.send_signals(signal.SIGTERM), _brake_after(DRIVER_S)),
            for_s=DRIVER_S + 0.2,
            about=(Part.BRAKE,),
            see=(
                LetsGo(("DRIVER_OVERRIDE", "SHUTDOWN"), within_s=DRIVER_S + RELEASES_S + status_s),
                Ends((0,), 12.0),
            ),
            then=Then.ENDED,
            allow=ANY | {"release"},
            needs=(Need.OWN_PROCESS,),
        ),
        Case(
            name="wheels-turned-by-hand",
            fault="V1",
            tags=("driver", "engagement", "limits"),
            proves="Armed again after an override, the device leads the wheels on from where the driver left them.",
            injected="the driver brakes, and turns the wheels before the device is armed again",
            at_mps=1.0,
            inject=base.combine(
                vehicle.change_until_ready(driver_brake=True), vehicle.change_after(0.2, plant_wheel_rad=turned_rad)
            ),
            for_s=0.3,
            after_s=0.5,
            about=(Part.BRAKE, Part.WHEELS),
            see=(LetsGo(("DRIVER_OVERRIDE",), within_s=0.06), StaysOut()),
            then=Then.REARM,
            needs=(Need.REARM,),
        ),
        _not_engaged(numbers),
    )


def _brake_after(after_s: float) -> Injection:
    """The driver brakes, and the vehicle keeps its mode."""
    return vehicle.change_after(after_s, driver_brake=True, yields_to_driver=False)


def _not_engaged(numbers: Numbers) -> Case:
    """What the vehicle reports while it is READY."""
    wire = numbers.wire
    for_s = 0.5 + numbers.or_else("timing.engage_settle_s", 0.5) + 4.0 * numbers.period_s
    found: list[tuple[str, Injection]] = []
    if wire.status and numbers.find("timing.status_stale_s") is not None:
        found.append(("no status any more", frames.change_frames(frames.drop, of_status=True)))
    if wire.has("FAULT_CODE"):
        found.append(("a fault code in READY", signals.set_signals(FAULT_CODE=float(FAULT_CODE))))
    steps = [
        Step(name=name, inject=inject, for_s=for_s, is_from_start=True, see=(NeverEnables(),), is_left_alone=True)
        for name, inject in found
    ]
    case = sequence_case(
        name="not-fit-to-engage",
        fault="V2 V4",
        tags=("driver", "engagement"),
        proves="A vehicle that has a fault, or whose status is missing, is not asked to engage, whatever its mode was.",
        injected=", ".join(name for name, _ in found),
        route=straight(),
        at_mps=0.0,
        steps=steps,
        lacks="" if steps else "the vehicle's bus has no status that could be missing or wrong",
    )
    return replace(case, answers_in_time=False)
