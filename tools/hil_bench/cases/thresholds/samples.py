"""Between two samples: how far values may change, how long they may be frozen, how many may be lost."""

import math

from hil_bench.case import Case
from hil_bench.cases.thresholds.common import USUAL_MPS, Numbers, sequence_case, straight
from hil_bench.expect.limit import Limit
from hil_bench.expect.stop_thresholds import StopAfter
from hil_bench.expect.thresholds import FirstDropped
from hil_bench.faults import growing, signals
from hil_bench.steps import Step
from hil_bench.wire import Protection, Wire

EVERY = 25
"""Samples between two changed ones: so many sound ones that single glitches do not persist."""
LEAST_EVERY = 3
"""Frames of a slow message."""
COUNT = 12
"""Sizes that are tried; the threshold lies in their middle."""
NO_PLACE = "the vehicle has no position on its bus"


def sample_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    return (_jumps(numbers), _frozen(numbers), _counters(numbers))


def _jumps(numbers: Numbers) -> Case:
    wire = numbers.wire
    moved_m = numbers.true_mps(USUAL_MPS, USUAL_MPS) * wire.period_s
    # Of the samples that one command may answer, the last is compared with the one before the first.
    grows_mps = numbers.or_else("plausibility.accel_mps2", 0.0) * numbers.period_s
    turned_rad = 0.1 * wire.period_s
    found = (
        ("plausibility.position_tolerance_m", "jump of the position", "m", moved_m, ("POS_Y",)),
        ("plausibility.speed_tolerance_mps", "jump of the speed", "m/s", grows_mps, ("SPEED",)),
        ("plausibility.heading_tolerance_rad", "jump of the heading", "rad", turned_rad, ("HEADING",)),
        ("plausibility.accel_mps2", "acceleration that no vehicle has", "m/s²", 1.0, ("ACCEL",)),
        (
            "plausibility.yaw_rate_tolerance_radps", "yaw rate beside that of speed and wheels", "rad/s", 0.05,
            ("YAW_RATE", "FRONT_WHEEL_ANGLE"),
        ),
    )  # fmt: skip
    steps = []
    for key, name, unit, more, names in found:
        stated = numbers.find(key)
        placed = wire.loses_its_place and names[0] in ("POS_Y", "HEADING")
        if stated is None or not all(map(wire.has, names)) or placed or not _can_carry(wire, names[0], stated + more):
            continue
        for side, way in (("upwards", 1.0), ("downwards", -1.0)):
            step = way * 1.6 * (stated + more) / COUNT
            message = wire.part_of(names[0])
            period_s = getattr(wire, "periods_s", {}).get(message, wire.period_s)
            every = max(LEAST_EVERY, math.ceil(EVERY * wire.period_s / period_s))
            # All samples are changed that one command may answer; a slow message's value stays for several anyway.
            in_a_row = max(1, round(wire.command_period_s / period_s))
            limit = Limit(
                key=key, name=name, unit=unit, profile=stated, lowest=stated - abs(step) * 1.1,
                highest=stated + more + abs(step) * 1.1, place=side,
            )  # fmt: skip
            steps.append(
                Step(
                    name=f"{name}, {side}",
                    inject=growing.offset_each(every, step, names[0], in_a_row=in_a_row),
                    for_s=(COUNT + 1) * every * period_s,
                    measure=(FirstDropped(limit=limit, every=every, step=abs(step), message=message),),
                    is_left_alone=True,
                )
            )
    return sequence_case(
        name="threshold-jumps",
        fault="S3 X1",
        tags=("thresholds", "plausibility"),
        proves="A sample whose values have changed by more than the profile allows, or cannot be true, is dropped.",
        injected=f"one sample of {EVERY} is changed, each time by more",
        route=straight(speed_mps=USUAL_MPS + 0.3),
        steps=steps,
        lacks="" if steps else "the profile has no [plausibility] for a value on its bus",
    )


def _can_carry(wire: Wire, signal: str, value: float) -> bool:
    """Whether the signal's range is wide enough for a value beyond this one."""
    if signal not in ("ACCEL", "YAW_RATE"):
        return True
    return wire.greatest(signal)[0] > 1.2 * value


def _frozen(numbers: Numbers) -> Case:
    keys = ("plausibility.frozen_time_s", "plausibility.frozen_distance_m", "plausibility.frozen_min_speed_mps")
    lacks = numbers.lacks(*keys)
    time_s, way_m = numbers.or_else(keys[0], 0.1), numbers.or_else(keys[1], 0.5)
    steps = []
    for at_mps in (USUAL_MPS, 8.0):
        true_mps = numbers.true_mps(at_mps, 9.0)
        stated_s = min(time_s, way_m / true_mps)
        persists_s = 4.0 * numbers.wire.period_s
        limit = Limit(
            key=keys[0] if stated_s == time_s else keys[1], name="frozen values", unit="s", profile=stated_s,
            lowest=stated_s - 2.0 * numbers.wire.period_s,
            highest=stated_s + persists_s + numbers.late_s + numbers.inferred_s, place=f"at {true_mps:.3g} m/s",
        )  # fmt: skip
        steps.append(
            Step(
                name=f"frozen at {at_mps:g} m/s",
                inject=signals.freeze_sample(),
                for_s=stated_s + 0.6,
                at_mps=at_mps,
                measure=(StopAfter(limit=limit, is_from_injection=True),),
                is_left_alone=True,
            )
        )
    return sequence_case(
        name="threshold-frozen",
        fault="S4",
        tags=("thresholds", "plausibility"),
        proves="A vehicle whose position is frozen, while its speed is not zero, is stopped in the profile's time.",
        injected="all values of the sample are frozen, under a live counter",
        route=straight(speed_mps=9.0),
        steps=steps,
        lacks=lacks or (NO_PLACE if numbers.wire.loses_its_place else ""),
    )


def step_counters(numbers: Numbers) -> Step:
    """Counter steps that grow."""
    most = _greatest_step(numbers)
    limit = Limit(
        key="e2e.max_counter_step", name="greatest counter step that is accepted", unit="", profile=float(most),
        lowest=float(most), highest=float(most),
    )  # fmt: skip
    return Step(
        name="counter steps that grow",
        inject=growing.skip_each(EVERY),
        for_s=(most + 3) * EVERY * numbers.wire.period_s,
        measure=(FirstDropped(limit=limit, every=EVERY, step=1.0),),
    )


def _greatest_step(numbers: Numbers) -> int:
    """That the profile allows in every message of a sample; 0 where none has a counter."""
    return min((one.max_step for one in _protections(numbers) if one.counters), default=0)


def why_counters_cannot_step(numbers: Numbers) -> str:
    """Why `step_counters` does not apply; empty where it does."""
    counters = [one.counters for one in _protections(numbers)]
    if not counters or not all(counters):
        return "no counter in every message of its samples"
    if min(counters) <= _greatest_step(numbers) + 2:
        return "its counters have so few values that every step is allowed"
    return ""


def _protections(numbers: Numbers) -> list[Protection]:
    return [numbers.wire.protection_of(name) for name in numbers.wire.sample]


def _counters(numbers: Numbers) -> Case:
    return sequence_case(
        name="threshold-counter-step",
        fault="F3",
        tags=("thresholds", "frames", "e2e"),
        proves="A sample whose counter steps further than the profile allows is no sample; one step less is accepted.",
        injected=f"before one sample of {EVERY} the counter skips, each time one value more",
        route=straight(),
        steps=(step_counters(numbers),),
        lacks=why_counters_cannot_step(numbers),
    )
