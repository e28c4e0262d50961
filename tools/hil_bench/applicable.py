"""The catalogue for one vehicle: which cases apply to it, and how fast and how far they drive."""

import math
from collections.abc import Callable
from dataclasses import replace

from hil_bench import routes
from hil_bench.case import Case, Need, Then
from hil_bench.expect import Expectation, FallsSilent, GivesUp, LetsGo, MomentaryAtMost, Standstill, Stops, WatchdogActs
from hil_bench.parts import Part, parts_of
from hil_bench.routes import Route
from hil_bench.wire import Wire

STALE = {"STATE_STALE"}
SHOWN_BY_MOTION_S = 1.0
"""A reaction with more time than this waits for the vehicle's motion, not for its bus."""
WATCHED_AFTER_S = 9.0
"""So long is a device watched that has given up to engage."""
LEAST_ERROR_SHARE = 0.5
"""Errors of a path shrink less than the path: a controller looks ahead as far as it does."""
FASTEST_SHARE = 0.9
"""Of the profile's speed limit."""
ODOMETRY_SHARE = 0.005
"""Of the way: what odometry may be off, by counts of wheel speed and yaw rate."""
SHORTEST_STRETCH_M = 5.0
"""From stop to stop, straight on. A controller looks ahead some metres also at a crawl; on a way not much longer than
that, it sees nothing but the stop, and only creeps."""


def find_inapplicable(case: Case, wire: Wire, parts: frozenset[Part] | None = None) -> str:
    """Why a case does not apply to a vehicle; empty if it does. `parts` are the vehicle's, if known already."""
    if case.lacks:
        return case.lacks
    there = parts_of(wire) if parts is None else parts
    lacking = [part.value for part in case.about if part not in there]
    if lacking:
        return f"needs {' and '.join(lacking)}, which this vehicle does not have"
    if case.profile is not None:
        texts = wire.path.read_text(), wire.dbc.read_text(errors="replace")
        if case.profile(*texts) == texts:
            return "the vehicle's files have nothing that this case could spoil"
    return ""


def adapt(case: Case, wire: Wire) -> Case:
    """The case as it is driven with this vehicle; the reference vehicle drives it as it is written.

    A vehicle with odometry has lost its place when its state was stale: it stays stopped until it is armed again.
    """
    watched_s = float(wire.profile["timing"]["engage_timeout_s"]) + WATCHED_AFTER_S
    if case.for_s != watched_s and any(isinstance(one, GivesUp) for one in case.see):
        case = replace(case, for_s=watched_s)
    if wire.speed_share == wire.length_share == 1.0 and not any(wire.later_s.values()):
        return case
    length, share = _shares(case.route(), wire)
    slower = max(1.0, length / share)
    see = tuple(_give_time(one, slower) for one in case.see)
    lasts = slower if see != case.see else 1.0
    waited = [
        wire.later_s[one.waits_for] for one in case.see if isinstance(one, Stops | LetsGo | FallsSilent | WatchdogActs)
    ]
    then, needs = case.then, case.needs
    if wire.loses_its_place and then is Then.GOES_ON and any(STALE & set(_reasons(one)) for one in case.see):
        need_not_stop = any(isinstance(one, MomentaryAtMost) for one in case.see)
        then = Then.MAY_GO_ON if need_not_stop else Then.REARM
        needs = tuple(dict.fromkeys([*needs, Need.REARM]))
        see = tuple(replace(one, most_s=math.inf) if isinstance(one, MomentaryAtMost) else one for one in see)
    route = scale_for(case.route(), wire)
    error_m = case.max_path_error_m
    if error_m is not None:
        error_m *= max(LEAST_ERROR_SHARE, wire.length_share)
        error_m += ODOMETRY_SHARE * route.length_m() if wire.loses_its_place else 0.0
    return replace(
        case,
        route=_always(route),
        at_mps=case.at_mps * share if case.at_mps > 0.0 else case.at_mps,
        reach_s=case.reach_s * slower,
        see=see,
        for_s=case.for_s * lasts + max(waited, default=0.0),
        steps=tuple(replace(step, at_mps=None if step.at_mps is None else step.at_mps * share) for step in case.steps),
        max_path_error_m=error_m,
        then=then,
        needs=needs,
        setup={name: value * (wire.length_share if name == "y_m" else 1.0) for name, value in case.setup.items()},
    )


def scale_for(route: Route, wire: Wire) -> Route:
    """A route of the catalogue as this vehicle drives it."""
    length, speed = _shares(route, wire)
    return route if length == speed == 1.0 else routes.scale(route, length=length, speed=speed)


def _shares(route: Route, wire: Wire) -> tuple[float, float]:
    """By which lengths and speeds are multiplied: in curves by the turning radius, straight on by the acceleration."""
    fastest_mps = FASTEST_SHARE * float(wire.profile["limits"]["speed_max_mps"]) / max(map(abs, route.speed_mps))
    speed = min(wire.speed_share, fastest_mps)
    if not route.is_straight:
        return wire.length_share, speed
    shortest = min(1.0, SHORTEST_STRETCH_M / route.shortest_stretch_m())
    return max(shortest, min(wire.length_share, speed**2 / wire.along_mps2)), speed


def _give_time(expectation: Expectation, slower: float) -> Expectation:
    """What shows only as the vehicle moves shows later on a slower one."""
    if isinstance(expectation, Stops | Standstill) and expectation.within_s >= SHOWN_BY_MOTION_S:
        return replace(expectation, within_s=expectation.within_s * slower)
    return expectation


def _reasons(expectation: Expectation) -> tuple[str, ...]:
    return expectation.reasons if isinstance(expectation, Stops | MomentaryAtMost) else ()


def _always(route: Route) -> Callable[[], Route]:
    return lambda: route
