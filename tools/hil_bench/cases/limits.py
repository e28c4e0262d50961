"""Cases in which a device must limit what it wants, because it is far from where it should be."""

from contextlib import AbstractContextManager

from hil_bench import routes
from hil_bench.case import Case
from hil_bench.expect import DrivesOn
from hil_bench.faults import vehicle
from hil_bench.faults.base import Injection
from hil_bench.parts import Part
from hil_bench.rig import Rig
from hil_bench.wire import Wire

DRIFT_MPS, DRIFTS_S = 4.0, 0.7
"""Not quite as far as the vehicle is stopped for."""


def limit_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    return tuple(_swept_aside(wire, side, way) for side, way in (("left", 1.0), ("right", -1.0)))


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
        lacks="" if wire.has("LATERAL_SPEED") else "without a lateral speed on its bus a drift contradicts its heading",
        see=(DrivesOn(afterwards_s=2.0),),
    )


def _drift(to_left_mps: float) -> Injection:
    def inject(rig: Rig) -> AbstractContextManager[None]:
        return vehicle.change_vehicle(plant_drift_mps=to_left_mps * rig.wire.length_share)(rig)

    return inject
