"""How far a vehicle may leave its path, its heading and its speed."""

import math
from collections.abc import Callable

from hil_bench.case import Case
from hil_bench.cases.thresholds.common import (
    BEND_M,
    FAST_MPS,
    SLOW_MPS,
    USUAL_MPS,
    Numbers,
    backwards,
    bend,
    sequence_case,
    straight,
)
from hil_bench.expect.limit import Limit
from hil_bench.expect.stop_thresholds import StopAt
from hil_bench.expect.true_state import Quantity, distance_m, heading_error_rad, speed_mps
from hil_bench.faults import growing, vehicle
from hil_bench.faults.base import Injection
from hil_bench.routes import Route
from hil_bench.steps import Step
from hil_bench.wire import Wire

SAMPLES = 3.0
"""The value may go on for this many samples until the stop is on the bus."""
DRIFT_MPS, DRIFT_SHARE = 4.0, 2.0 / 3.0
TURN_SHARE = 0.9
"""Of the greatest wheel angle."""
TURN_MPS = 2.0
LATERAL, HEADING = "deviation.lateral_stop_m", "deviation.heading_stop_rad"
TURNED_SHARE = 0.6
"""Of the greatest heading error, when a vehicle that turns off is as far from its path as the profile allows."""
ACROSS_MPS2 = 2.0
"""Lateral acceleration of a vehicle that turns off."""
ROLLBACK, ROLL_MPS2 = "deviation.rollback_mps", 7.0
NOISE = 0.02
NO_STOP = "no signal says that a command is a stop, and the vehicle is braked for its speed anyway"


def deviation_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    lost = "" if not wire.loses_its_place else "the vehicle has no position on its bus: where it drifts cannot be seen"
    no_way_back = "" if wire.can_reverse else "the vehicle has no command to drive backwards"
    fast_mps = numbers.true_mps(FAST_MPS, FAST_MPS + 1.0)
    usual_mps = numbers.true_mps(USUAL_MPS, USUAL_MPS + 1.0)
    beside = [
        ("straight", "forwards", straight(), USUAL_MPS, usual_mps, lost),
        ("bend", "in a bend of 25 m", bend(), USUAL_MPS, usual_mps, lost),
        ("fast", f"at {fast_mps:.3g} m/s", straight(900.0, FAST_MPS + 1.0), FAST_MPS, fast_mps, lost),
        ("backwards", "backwards", backwards(), 0.6 * USUAL_MPS, 0.6 * usual_mps, lost or no_way_back),
    ]
    cases = [
        _case(
            f"threshold-lateral-{name}",
            "C2",
            "A vehicle that leaves its path is stopped at the profile's distance, to either side.",
            route,
            at_mps,
            [
                leave_path(numbers, way, f"to the {side}, {where}", true_mps=true_mps, limit_s=2.0)
                for side, way in (("left", 1.0), ("right", -1.0))
            ],
            numbers.lacks(LATERAL) or lacks or _turns_too_wide(numbers),
        )
        for name, where, route, at_mps, true_mps, lacks in beside
    ]  # fmt: skip
    cases.append(_heading(numbers, lost))
    return (*cases, *_along(numbers, no_way_back))


def leave_path(numbers: Numbers, way: float, place: str, *, true_mps: float, limit_s: float) -> Step:
    """The vehicle leaves its path to the left (`way` = 1) or right (−1) until it is stopped, and is taken back.

    It drifts sideways; where no signal has the lateral speed, it turns off: a drift would contradict its heading.
    """
    if numbers.wire.has("LATERAL_SPEED"):
        grows_mps = max(DRIFT_MPS, DRIFT_SHARE * true_mps)
        inject = growing.take_back(vehicle.change_vehicle(plant_drift_mps=way * grows_mps))
    else:
        radius_m, lateral_m = _turn_off_radius_m(numbers, true_mps), numbers.or_else(LATERAL, 1.0)
        turned_rad = math.acos(max(0.0, 1.0 - lateral_m / radius_m))
        grows_mps = true_mps * math.sin(turned_rad)
        limit_s = 2.0 * radius_m * turned_rad / true_mps + 1.5
        inject = growing.turn_off(way / radius_m, numbers["limits.front_wheel_rate_radps"])
    return _step(numbers, LATERAL, "distance from the path", "m", distance_m, grows_mps, place, inject, limit_s=limit_s)


def _turn_off_radius_m(numbers: Numbers, true_mps: float) -> float:
    """Of a turn that leads away from the path before it is a heading error."""
    turned_rad = TURNED_SHARE * numbers.or_else(HEADING, 0.8)
    return max(numbers.or_else(LATERAL, 1.0) / (1.0 - math.cos(turned_rad)), true_mps**2 / ACROSS_MPS2)


def _turns_too_wide(numbers: Numbers) -> str:
    if numbers.wire.has("LATERAL_SPEED"):
        return ""
    bent_per_m = 1.0 / _turn_off_radius_m(numbers, 0.0) + 1.0 / (BEND_M * numbers.wire.length_share)
    is_tight = bent_per_m * numbers["geometry.wheelbase_m"] > math.tan(_wheel_rad(numbers))
    return "the vehicle turns so wide that it is stopped for its heading first" if is_tight else ""


def _heading(numbers: Numbers, lost: str) -> Case:
    radius_m = _tightest_m(numbers)
    beside_m = radius_m * (1.0 - math.cos(numbers.or_else(HEADING, 0.8)))
    if beside_m > TURN_SHARE * numbers.or_else(LATERAL, math.inf):
        lost = lost or "the vehicle turns so wide that it is stopped for its distance from the path first"
    limit_s = 4.0 * max(1.0, radius_m / 4.0)
    steps = [turn_away(numbers, way, limit_s=limit_s) for way in (1.0, -1.0)]
    proves = "A vehicle that turns away from its path is stopped at the profile's angle, to either side."
    lacks = numbers.lacks(HEADING) or lost
    return _case("threshold-heading", "C9", proves, straight(speed_mps=TURN_MPS + 0.5), TURN_MPS, steps, lacks)


def turn_away(numbers: Numbers, way: float, *, limit_s: float) -> Step:
    """The vehicle turns away from its path to the left (`way` = 1) or right (−1) until it is stopped."""
    wheel_rad, rate_radps = _wheel_rad(numbers), numbers["limits.front_wheel_rate_radps"]
    place = "to the left" if way > 0.0 else "to the right"
    grows_radps = TURN_MPS / _tightest_m(numbers)
    inject = growing.turn_away(way * wheel_rad, rate_radps)
    return _step(
        numbers, HEADING, "heading error", "rad", heading_error_rad, grows_radps, place, inject, limit_s=limit_s
    )


def _wheel_rad(numbers: Numbers) -> float:
    return TURN_SHARE * numbers["limits.front_wheel_angle_rad"]


def _tightest_m(numbers: Numbers) -> float:
    return numbers["geometry.wheelbase_m"] / math.tan(_wheel_rad(numbers))


def roll_back(numbers: Numbers, place: str = "forwards") -> Step:
    """The vehicle is pushed against its direction of travel until it is stopped."""
    push = growing.push_against_travel(ROLL_MPS2)
    name = "speed against the direction of travel"
    return _step(numbers, ROLLBACK, name, "m/s", speed_mps, ROLL_MPS2, place, push, limit_s=1.5)


def _along(numbers: Numbers, no_way_back: str) -> list[Case]:
    """Too fast, and against the direction of travel."""
    wire = numbers.wire
    over = "deviation.overspeed_mps"
    most_mps = numbers["limits.speed_max_mps"] + numbers.or_else(over, 0.0)
    no_stop = "" if wire.has_stop_signal else NO_STOP
    no_sign = "" if wire.measures_backwards else "the vehicle's measured speed has no sign"
    cases = []
    for name, where, slow, fast, lacks in (
        ("forwards", "forwards", straight(), straight(1200.0, 8.0), ""),
        ("backwards", "backwards", backwards(), backwards(900.0, 6.0), no_way_back),
    ):
        too_fast = _step(
            numbers, over, "speed", "m/s", speed_mps, wire.tow_mps2, where, growing.tow_along(), limit_s=3.0,
            stated=most_mps,
        )  # fmt: skip
        lacks = no_stop or lacks
        proves = "A vehicle that is too fast for the profile is stopped."
        cases.append(
            _case(f"threshold-overspeed-{name}", "C7", proves, fast, 4.0, [too_fast], numbers.lacks(over) or lacks)
        )
        proves = "A vehicle that rolls against its direction of travel as fast as the profile says is stopped."
        lacks = numbers.lacks(ROLLBACK) or no_sign or lacks
        cases.append(
            _case(f"threshold-rollback-{name}", "C8", proves, slow, SLOW_MPS, [roll_back(numbers, where)], lacks)
        )
    return cases


def _step(
    numbers: Numbers,
    key: str,
    name: str,
    unit: str,
    of: Quantity,
    per_s: float,
    place: str,
    inject: Injection,
    *,
    limit_s: float,
    stated: float | None = None,
) -> Step:
    """`per_s`: how fast the quantity grows."""
    profile = numbers.or_else(key, 0.0) if stated is None else stated
    late = per_s * (SAMPLES * numbers.wire.period_s + numbers.inferred_s)
    limit = Limit(
        key=key,
        name=name,
        unit=unit,
        profile=profile,
        lowest=profile - NOISE - 0.02 * profile,
        highest=profile + NOISE + 0.02 * profile + late,
        place=place,
    )
    return Step(name=place, inject=inject, for_s=limit_s, measure=(StopAt(limit=limit, of=of),), is_left_alone=True)


def _case(
    name: str,
    fault: str,
    proves: str,
    route: Callable[[], Route],
    at_mps: float,
    steps: list[Step],
    lacks: str,
) -> Case:
    return sequence_case(
        name=name,
        fault=fault,
        tags=("thresholds", "deviation"),
        proves=proves,
        injected=f"the vehicle leaves {'its path' if 'lateral' in name else 'what was asked'} further and further",
        route=route,
        at_mps=at_mps,
        steps=steps,
        lacks=lacks,
    )
