"""Cases of a vehicle that leaves its path or its speed."""

from hil_bench import routes
from hil_bench.case import Case, Then
from hil_bench.expect import Standstill, Stops
from hil_bench.faults import vehicle
from hil_bench.parts import Part

DEVIATION = (
    Case(
        name="drifting-off",
        fault="C2",
        tags=("state", "deviation"),
        proves="A vehicle more than 3 m off its path is stopped and held.",
        injected="the vehicle drifts to the left at 4 m/s, whatever the steering",
        inject=vehicle.change_vehicle(plant_drift_mps=4.0),
        for_s=3.0,
        about=(Part.POSITION,),
        see=(Stops(("DEVIATION",), within_s=2.5), Standstill(5.5)),
        then=Then.HOLDS,
        after_s=1.0,
    ),
    Case(
        name="steering-stuck",
        fault="C2 X3",
        tags=("state", "deviation", "limits"),
        proves="With stuck wheels the steering command does not run away; off its path the vehicle is stopped.",
        injected="the wheels are stuck before a curve of 7 m radius",
        route=routes.u_turn,
        inject=vehicle.change_vehicle(plant_wheel_rate_limit_radps=0.0),
        for_s=5.0,
        about=(Part.WHEELS,),
        see=(Stops(("DEVIATION",), within_s=4.5), Standstill(7.0)),
        then=Then.HOLDS,
        after_s=2.0,
    ),
    Case(
        name="rolling-back",
        fault="C8",
        tags=("state", "deviation"),
        proves="A vehicle that rolls against its direction of travel is stopped.",
        injected="a slope accelerates the vehicle backwards at 7 m/s²",
        at_mps=1.0,
        inject=vehicle.change_vehicle(plant_push_mps2=-7.0),
        for_s=1.2,
        about=(Part.BACKWARDS,),
        see=(Stops(("DEVIATION",), within_s=1.2, until_end=False),),
        then=Then.HOLDS,
        after_s=1.0,
        allow=frozenset({"command"}),
    ),
    Case(
        name="overspeed",
        fault="C7",
        tags=("state", "deviation", "slow"),
        proves="A vehicle pushed above its speed limit is stopped.",
        injected="the vehicle is towed forward against its brakes until far above the limit",
        route=lambda: routes.straight(900.0, 8.0),
        at_mps=6.0,
        inject=vehicle.tow_forward(),
        for_s=2.0,
        see=(Stops(("DEVIATION",), within_s=2.2, until_end=False),),
        then=Then.HOLDS,
        after_s=0.5,
    ),
)
