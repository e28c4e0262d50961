"""Fields of the state that are wrong, and whether the profile's tolerances show it."""

import math

from hil_bench.case import Case, Need, Then
from hil_bench.cases.common import ANY, INVALID
from hil_bench.cases.thresholds.common import Numbers
from hil_bench.expect import Expectation, StaysNear, Stops
from hil_bench.faults import signals
from hil_bench.parts import Part
from hil_bench.wire import Wire

HEADING_SHARE = 0.95
"""Of what one sample may be off."""
AT_MPS, TOP_MPS = 4.0, 5.0
WATCH_S, WINDOW_S = 3.0, 2.0
SLIP_SHARE = 0.06
"""A vehicle may slip to the side by this share of its way (FAILURES.md, S7)."""
CLEAR = 1.1
"""A contradiction must be greater than the tolerances by this factor before a stop is required."""


def field_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    return (_heading_off(Numbers(wire)),)


def _heading_off(numbers: Numbers) -> Case:
    """The position moves to the side of the heading: by how much in the time for which sources are compared?"""
    off_rad = HEADING_SHARE * numbers.or_else("plausibility.heading_tolerance_rad", 0.0)
    way_m = WINDOW_S * numbers.true_mps(AT_MPS, TOP_MPS)
    tolerance_m = numbers.or_else("plausibility.position_tolerance_m", 0.0) + SLIP_SHARE * way_m
    is_shown = way_m * math.sin(off_rad) > CLEAR * tolerance_m
    stays = StaysNear(numbers.or_else("deviation.lateral_stop_m", math.inf))
    stops: tuple[Expectation, ...] = (Stops(INVALID, within_s=2.5, until_end=False),) if is_shown else ()
    return Case(
        name="sensor-heading-off",
        fault="S7",
        tags=("state", "plausibility"),
        proves="A heading that contradicts the position stops the vehicle; what no tolerance shows takes it nowhere.",
        injected=f"HEADING is off by {off_rad:.3g} rad, 95 % of what one sample may be off",
        at_mps=AT_MPS,
        inject=signals.offset_signals(HEADING=off_rad),
        for_s=WATCH_S,
        about=(Part.POSITION,),
        see=(*stops, stays),
        after_s=0.5,
        then=Then.HOLDS if is_shown else Then.MAY_GO_ON,
        needs=() if is_shown else (Need.REARM,),
        exit_status=(4,) if is_shown else (0,),
        allow=frozenset({*ANY, "command", "dynamics", "brakes", "stop_steering", "report"}),
    )
