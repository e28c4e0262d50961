"""Fields of the state that are wrong, and whether the profile's tolerances show it."""

import math
from collections.abc import Sequence

from hil_bench import routes
from hil_bench.case import Case, Need, Then
from hil_bench.cases.common import ANY, INVALID
from hil_bench.cases.thresholds.common import ANYTHING, Numbers, sequence_case
from hil_bench.contradictions import OPPONENTS, Tolerances
from hil_bench.expect import DoesNoHarm, Expectation, StaysNear, Stops, StopsOnContradiction
from hil_bench.faults import base, growing, signals, vehicle
from hil_bench.parts import Part
from hil_bench.routes import Route
from hil_bench.steps import Step
from hil_bench.wire import Wire
from hil_bench.wrong_fields import WrongFields, frozen, scaled, swapped

HEADING_SHARE = 0.95
"""Of what one sample may be off."""
AT_MPS, TOP_MPS = 4.0, 5.0
WATCH_S, WINDOW_S = 3.0, 2.0
SLIP_SHARE = 0.06
"""A vehicle may slip to the side by this share of its way (FAILURES.md, S7)."""
TOLD_S, ENGAGES_S = 3.5, 1.5
SCALES = {"POS_X": 0.4, "POS_Y": 0.4, "HEADING": 0.4, "SPEED": 0.4}
"""The others have the wrong sign."""
SCALE = 1.25
PAIRS = (
    ("POS_X", "POS_Y"),
    ("HEADING", "YAW_RATE"),
    ("SPEED", "LATERAL_SPEED"),
    ("SPEED", "ACCEL"),
    ("FRONT_WHEEL_ANGLE", "REAR_WHEEL_ANGLE"),
)
CONSTANT = ("REAR_WHEEL_ANGLE",)
"""The bench's vehicle does not steer its rear wheels: frozen or scaled, their angle is right."""
DRIFT_MPS = 0.8
"""The vehicle truly moves to the left, where the lateral speed is wrong."""
WRONG = frozenset({*ANYTHING, "stop_steering", "report"})
CLEAR = 1.1
"""A contradiction must be greater than the tolerances by this factor before a stop is required."""


def field_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    may = Tolerances.of(wire)
    compared = [name for name in OPPONENTS if may.is_compared(name)]
    found = {
        "frozen": [frozen(name) for name in compared if name not in CONSTANT],
        "scaled": [scaled(name, SCALES.get(name, -1.0)) for name in compared if name not in CONSTANT],
        "swapped": [swapped(*pair) for pair in PAIRS if set(pair) <= may.has and set(pair) & set(compared)],
    }
    alone = ", ".join(sorted(may.has - set(compared)))
    left_out = f"; nothing on this vehicle's bus contradicts {alone}" if alone else ""
    return (
        _position_scaled(),
        _heading_off(numbers),
        *(_wrong(numbers, how, faults, left_out) for how, faults in found.items()),
    )


def _wrong(numbers: Numbers, how: str, faults: Sequence[WrongFields], left_out: str) -> Case:
    """Each in motion and from the start: a stop as soon as it shows; until then it may do no harm."""
    steps, names = [], ", ".join(wrong.name for wrong in faults)
    for wrong in faults:
        inject = signals.tell_wrong(wrong)
        if "LATERAL_SPEED" in wrong.fields:
            inject = base.combine(inject, base.a_tick_later(vehicle.change_vehicle(plant_drift_mps=DRIFT_MPS)))
        inject = growing.begin_again(inject) if numbers.wire.loses_its_place else growing.take_back(inject)
        steps += [
            Step(
                name=wrong.name,
                inject=inject,
                for_s=TOLD_S,
                see=(StopsOnContradiction(wrong=wrong), DoesNoHarm()),
                ends_with_stop=True,
            ),
            Step(
                name=f"{wrong.name}, from the start",
                inject=inject,
                for_s=TOLD_S + ENGAGES_S + numbers.or_else("timing.engage_settle_s", 0.5),
                see=(StopsOnContradiction(wrong=wrong, is_from_start=True), DoesNoHarm()),
                is_from_start=True,
                ends_with_stop=True,
            ),
        ]
    return sequence_case(
        name=f"fields-{how}",
        fault="S7",
        tags=("messages", "values", "plausibility"),
        proves=f"A field that is {how} stops the vehicle where it contradicts the others, and does no harm anyway.",
        injected=f"while the vehicle is driven, and from the start: {names}{left_out}",
        route=_slalom,
        at_mps=1.0,
        steps=steps,
        lacks="" if steps else "no field of the vehicle can contradict another",
        allow=WRONG,
    )


def _slalom() -> Route:
    """Bends to either side, so that every field of the state changes."""
    return routes.route("patient-slalom", [(3.0, 0.0), *[(7.0, 1.0 / 9.0), (7.0, -1.0 / 9.0)] * 12], 3.5, slack=12.0)


def _position_scaled() -> Case:
    """At the origin, so that the position does not jump when it begins."""
    return Case(
        name="sensor-position-scaled",
        fault="S7",
        tags=("state", "plausibility"),
        proves="A position that contradicts the speed stops the vehicle as soon as the tolerances show it.",
        injected=f"POS_X is scaled by {SCALE:g}",
        route=routes.straight,
        at_mps=1.0,
        inject=signals.scale_signals(POS_X=SCALE),
        for_s=6.0,
        about=(Part.POSITION,),
        see=(StopsOnContradiction(wrong=scaled("POS_X", SCALE)), DoesNoHarm()),
        after_s=0.5,
        then=Then.MAY_GO_ON,
        needs=(Need.REARM,),
        exit_status=(0, 4),
        allow=WRONG,
        answers_in_time=False,
    )


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
