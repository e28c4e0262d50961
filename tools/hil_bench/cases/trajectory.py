"""Cases of the trajectory's end and of its length."""

from hil_bench import routes
from hil_bench.case import Case, Then
from hil_bench.expect import DrivesOn, ReachesEnd
from hil_bench.faults import base
from hil_bench.parts import Part

TRAJECTORY = (
    Case(
        name="end-of-space",
        fault="T1 C6",
        tags=("trajectory",),
        proves="At the end of the trajectory the vehicle is stopped and held, without hazard lights.",
        route=lambda: routes.route("short", [(12.0, 0.0)], 4.0),
        see=(ReachesEnd(),),
        then=Then.END_OF_ROUTE,
        max_path_error_m=0.3,
    ),
    Case(
        name="end-of-time",
        fault="T1 C6",
        tags=("trajectory",),
        proves="At the end of the trajectory's time the vehicle is stopped, wherever it is.",
        injected="a trajectory whose time ends long before the vehicle can reach its end",
        route=lambda: routes.route("hurried", [(60.0, 0.0)], 5.0, slack=0.4),
        setup={"drive_limit_mps2": 0.8},
        about=(Part.REASON,),
        see=(ReachesEnd(("PAST_END_TIME",)),),
        then=Then.END_OF_ROUTE,
    ),
    Case(
        name="many-points",
        fault="T2",
        tags=("trajectory", "slow"),
        proves="A trajectory of 200,000 points is driven normally.",
        route=lambda: routes.route("dense", [(400.0, 0.0)], 5.0, spacing_m=0.002),
        inject=base.inject_nothing,
        injected="no fault, only the number of points",
        for_s=2.0,
        see=(DrivesOn(),),
        max_path_error_m=0.3,
    ),
)
