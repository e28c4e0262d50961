"""Up to which speed another gear is requested."""

from hil_bench.case import Case
from hil_bench.cases.thresholds.common import USUAL_MPS, Numbers, sequence_case, straight
from hil_bench.expect.limit import Limit
from hil_bench.expect.thresholds import GearRequestedAt
from hil_bench.faults import signals
from hil_bench.profile import ProfileError
from hil_bench.steps import Step
from hil_bench.wire import Wire

KEY = "limits.gear_change_speed_mps"
GEARS = ("NEUTRAL", "REVERSE")


def gear_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    stated_mps = numbers.or_else(KEY, 0.5)
    limit = Limit(
        key=KEY, name="greatest speed at which a gear is requested", unit="m/s", profile=stated_mps, lowest=None,
        highest=1.02 * stated_mps, place="the reported gear does not fit",
    )  # fmt: skip
    named = [gear for gear in GEARS if wire.has("GEAR") and _has_gear(wire, gear)]
    steps = tuple(
        Step(
            name=f"the vehicle reports {gear}",
            inject=signals.name_value("GEAR", gear),
            for_s=0.4,
            at_mps=USUAL_MPS,
            measure=(GearRequestedAt(limit=limit),),
            is_left_alone=True,
        )
        for gear in named
    )
    lacks = "" if steps else "the vehicle's bus has no gear"
    return (
        sequence_case(
            name="threshold-gear-change",
            fault="S9",
            tags=("thresholds", "driver"),
            proves="Another gear is requested only below the profile's speed.",
            injected="the vehicle reports a gear that does not fit, while it drives",
            route=straight(),
            steps=steps,
            lacks=numbers.lacks(KEY) or lacks or ("" if wire.has("GEAR_REQUEST") else "no gear is requested of it"),
        ),
    )


def _has_gear(wire: Wire, gear: str) -> bool:
    try:
        wire.number("GEAR", gear)
    except ProfileError:
        return False
    return True
