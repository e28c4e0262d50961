"""Cases in which a device must limit what it wants, because it is far from where it should be."""

from contextlib import AbstractContextManager

from hil_bench import routes
from hil_bench.case import Case, Need, Then
from hil_bench.cases.common import ANY
from hil_bench.expect import DrivesOn, MakesUpForNothing
from hil_bench.faults import base, process, vehicle
from hil_bench.faults.base import Injection
from hil_bench.parts import Part
from hil_bench.rig import Rig
from hil_bench.wire import Wire

DRIFT_MPS, DRIFTS_S = 4.0, 0.7
"""Not quite as far as the vehicle is stopped for."""


def limit_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    swept = (_swept_aside(wire, side, way) for side, way in (("left", 1.0), ("right", -1.0)))
    return *swept, _swept_aside_unseen(wire)


def _swept_aside(wire: Wire, side: str, way: float) -> Case:
    return Case(
        name=f"swept-aside-to-the-{side}",
        fault="C2",
        tags=("state", "limits"),
        proves="A vehicle beside its path is led back within the limits of lateral acceleration and jerk at its speed.",
        injected=f"the vehicle drifts to the {side} at {DRIFT_MPS} m/s for {DRIFTS_S} s, at 12 m/s",
        route=lambda: routes.straight(600.0, 13.0),
        at_mps=12.0,
        inject=_drift(way * DRIFT_MPS),
        for_s=DRIFTS_S,
        after_s=2.0,
        about=(Part.POSITION,),
        lacks=_lacks(wire),
        see=(DrivesOn(afterwards_s=2.0),),
    )


def _swept_aside_unseen(wire: Wire) -> Case:
    return Case(
        name="swept-aside-while-paused",
        fault="P1",
        tags=("process", "limits"),
        proves="After 0.3 s without the processor, no limit of a rate makes up for the time that was missed.",
        injected=f"the device pauses for 0.3 s while the vehicle drifts at {DRIFT_MPS} m/s with its watchdog off",
        inject=base.combine(vehicle.change_vehicle(has_watchdog=False), _drift(DRIFT_MPS), process.pause()),
        for_s=0.3,
        after_s=1.0,
        about=(Part.POSITION,),
        lacks=_lacks(wire),
        see=(MakesUpForNothing(),),
        then=Then.MAY_GO_ON,
        allow=ANY,
        needs=(Need.OWN_PROCESS,),
    )


def _lacks(wire: Wire) -> str:
    return "" if wire.has("LATERAL_SPEED") else "without a lateral speed on its bus a drift contradicts its heading"


def _drift(to_left_mps: float) -> Injection:
    def inject(rig: Rig) -> AbstractContextManager[None]:
        return vehicle.change_vehicle(plant_drift_mps=to_left_mps * rig.wire.length_share)(rig)

    return inject
