"""Drives without a fault."""

from collections.abc import Callable

from hil_bench import routes
from hil_bench.case import Case, Then
from hil_bench.expect import AsksForItsSpeed, Expectation, ReachesEnd, StandsAtDwells
from hil_bench.parts import Part


def _manoeuvre(
    name: str,
    proves: str,
    route: Callable[[], routes.Route],
    error_m: float,
    *tags: str,
    about: tuple[Part, ...] = (),
    more: tuple[Expectation, ...] = (),
) -> Case:
    return Case(
        name=f"drive-{name}",
        tags=("manoeuvre", *tags),
        proves=proves,
        route=route,
        see=(ReachesEnd(), AsksForItsSpeed(), *more),
        then=Then.END_OF_ROUTE,
        max_path_error_m=error_m,
        about=about,
    )


MANOEUVRES = (
    _manoeuvre("step", "One lane change, at 5 m/s.", routes.step, 0.5),
    _manoeuvre("slalom", "Left and right bends in turn, at 5 m/s.", routes.slalom, 0.5),
    _manoeuvre(
        "double-lane-change", "Around an obstacle and back into the lane, at 8 m/s.", routes.double_lane_change, 0.6
    ),
    _manoeuvre(
        "stop-and-go",
        "Two dwells on the way: it stands until its time, and drives on.",
        routes.stop_and_go,
        0.3,
        more=(StandsAtDwells(),),
    ),
    _manoeuvre("reverse-bay", "Past a bay, then in reverse into it.", routes.reverse_bay, 0.5, about=(Part.REVERSE,)),
    _manoeuvre("u-turn", "A half circle of 7 m radius, at 3 m/s.", routes.u_turn, 0.6, "quick"),
    _manoeuvre("circle", "A full circle of 12 m radius, at 4 m/s.", routes.circle, 0.5),
    _manoeuvre("figure-eight", "A circle to the left, then one to the right, at 4 m/s.", routes.figure_eight, 0.5),
    Case(
        name="drive-from-the-side",
        tags=("manoeuvre", "limits"),
        proves="From a start beside the path, turned away by 0.6 rad, the device steers hard, but within the limits.",
        route=lambda: routes.straight(36.0, 4.0),
        setup={"y_m": 0.2, "heading_rad": 0.6},
        about=(Part.POSITION,),
        see=(ReachesEnd(),),
        then=Then.END_OF_ROUTE,
    ),
)
