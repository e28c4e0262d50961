"""How a stop brakes and steers, how it is held, and how a run ends."""

import math
import signal
from collections.abc import Callable

from vehicle_bus_contract.judge import Pair

from hil_bench.case import Case, Need, Then
from hil_bench.cases.thresholds.common import ANYTHING, FAST_MPS, USUAL_MPS, Numbers, bend, sequence_case, straight
from hil_bench.expect import Ends, EndsOrderly
from hil_bench.expect.limit import Limit
from hil_bench.expect.stop_thresholds import BRAKES_FROM, BRAKES_UNTIL, AtRest, Brakes, BrakesWithin, StopWay
from hil_bench.expect.thresholds import ReleasedAfter, ReleasedAt
from hil_bench.faults import base, frames, process, vehicle
from hil_bench.faults.base import Injection
from hil_bench.routes import Route
from hil_bench.steps import Step
from hil_bench.wire import Wire

BFAST_MPS, CURVATURE_PER_M = 6.0, 1.0 / 25.0
ENDS_MPS = 9.0
LAG_S = 0.08
"""Of the simulated brake."""
FULL = 0.95
DECEL_SHARE = 0.06
WAY_SHARE = 0.1
NEVER_RESTS_MPS2 = 4.5
STRAIGHT_RAD = 0.02
NO_ACCEL = "its commands are no accelerations: how it brakes is up to the vehicle"


def stop_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    return (_brakes(numbers), _steers(numbers), _ends(numbers), _never_rests(numbers))


def _invalid(numbers: Numbers) -> Injection:
    """What stops the vehicle, and lets the state go on, if the vehicle has that."""
    if numbers.wire.has("POSE_VALID"):
        return vehicle.change_vehicle(pose_valid=False)
    return frames.change_frames(frames.drop, of_status=bool(numbers.wire.status))


def _brakes(numbers: Numbers) -> Case:
    key = "behavior.safe_deceleration_mps2"
    safe_mps2 = numbers[key]
    build_s = safe_mps2 / numbers.or_else("behavior.stop_jerk_mps3", math.inf)
    exact = numbers.wire.accel_slack_mps2
    begins_s = numbers.late_s + numbers.inferred_s
    # Without a signal for the pose, a missing status stops the vehicle, which drives on until the status is stale.
    drives_s = 0.0 if numbers.wire.has("POSE_VALID") else numbers.or_else("timing.status_stale_s", 0.0)
    steps = []
    for at_mps in (FAST_MPS, USUAL_MPS * 2.0):
        true_mps = numbers.true_mps(at_mps, FAST_MPS + 1.0)
        place = f"from {true_mps:.3g} m/s"
        way_m = true_mps**2 / (2.0 * safe_mps2) + true_mps * (drives_s + begins_s / 2.0 + build_s / 2.0 + LAG_S)
        slack = DECEL_SHARE * safe_mps2 + exact
        steps.append(
            Step(
                name=place,
                inject=_invalid(numbers),
                for_s=drives_s + true_mps / safe_mps2 + 2.5,
                at_mps=at_mps,
                measure=(
                    Brakes(
                        limit=Limit(
                            key=key, name="deceleration of a stop", unit="m/s²", profile=safe_mps2, place=place,
                            lowest=_least_mps2(safe_mps2, build_s, true_mps) - slack, highest=safe_mps2 + slack,
                        )
                    ),
                    StopWay(
                        limit=Limit(
                            key=key, name="way to standstill", unit="m", profile=way_m, place=place,
                            lowest=None, highest=way_m * (1.0 + WAY_SHARE) + 0.3,
                        )
                    ),
                    BrakesWithin(
                        limit=Limit(
                            key="behavior.stop_jerk_mps3", name="full brake after the first stop", unit="s",
                            profile=build_s, place=place, lowest=None, highest=build_s + 2.0 * numbers.period_s + 0.01,
                        ),
                        decel_mps2=FULL * safe_mps2 - exact,
                    ),
                    AtRest(
                        limit=Limit(
                            key="behavior.hold_deceleration_mps2", name="brake at standstill", unit="m/s²",
                            profile=numbers.or_else("behavior.hold_deceleration_mps2", 0.0), place=place,
                            lowest=numbers.or_else("behavior.hold_deceleration_mps2", 0.0) - 0.05 - exact,
                            highest=numbers.or_else("behavior.hold_deceleration_mps2", 0.0) + 0.05 + exact,
                        ),
                        of=lambda pair: abs(pair.drive["ACCEL_REQUEST"]),
                    ),
                ),
                is_left_alone=True,
            )
        )  # fmt: skip
    return _case(
        "threshold-stop",
        "S5 X11",
        "A stop brakes as the profile says, builds up as fast as it says, and holds the vehicle as it says.",
        "what stops the vehicle stays until it has stood for a while",
        route=straight(900.0, FAST_MPS + 1.0),
        steps=tuple(steps[::-1]),
        lacks="" if numbers.wire.commands_acceleration else NO_ACCEL,
    )


def _least_mps2(safe_mps2: float, build_s: float, begin_mps: float) -> float:
    """The mean of a stop from a low speed, of which the brake's build-up and lag take a large part."""
    missing_mps = max(0.0, safe_mps2 * (LAG_S + build_s / 2.0) - (1.0 - BRAKES_FROM) * begin_mps)
    judged_mps = (BRAKES_FROM - BRAKES_UNTIL) * begin_mps
    return safe_mps2 * judged_mps / (judged_mps + missing_mps)


def _steers(numbers: Numbers) -> Case:
    policy = numbers.wire.profile["behavior"].get("stop_steering", "straight")
    in_bend_rad = math.atan(numbers["geometry.wheelbase_m"] * CURVATURE_PER_M / numbers.wire.length_share)
    is_held = policy == "hold"
    limit = Limit(
        key="behavior.stop_steering",
        name=f"wheels at the end of a stop ({policy})",
        unit="rad",
        profile=in_bend_rad if is_held else 0.0,
        lowest=0.7 * in_bend_rad if is_held else None,
        highest=1.3 * in_bend_rad if is_held else STRAIGHT_RAD + numbers.wire.wheel_count_rad,
        place="in a bend",
    )
    step = Step(
        name="in a bend",
        inject=_invalid(numbers),
        for_s=numbers.true_mps(BFAST_MPS, BFAST_MPS + 0.7) / numbers["behavior.safe_deceleration_mps2"] + 1.5,
        at_mps=BFAST_MPS,
        measure=(AtRest(limit=limit, of=_wheel_rad),),
        is_left_alone=True,
    )
    return _case(
        "threshold-stop-steering",
        "S5 X12",
        "A stop in a bend steers as the profile says.",
        "what stops the vehicle, in a bend",
        route=bend(CURVATURE_PER_M, BFAST_MPS + 0.7),
        steps=(step,),
        lacks="" if numbers.wire.commands_angle else "its commands are no wheel angles",
    )


def _ends(numbers: Numbers) -> Case:
    place = f"from {numbers.true_mps(ENDS_MPS, ENDS_MPS + 1.0):.3g} m/s"
    safe_mps2 = numbers["behavior.safe_deceleration_mps2"]
    limit = Limit(
        key="timing.shutdown_s", name="speed at the release at the end of a run", unit="m/s", profile=0.0,
        lowest=None, highest=0.1, place=place,
    )  # fmt: skip
    slack = DECEL_SHARE * safe_mps2 + numbers.wire.accel_slack_mps2
    brakes = Limit(
        key="behavior.safe_deceleration_mps2", name="deceleration at the end of a run", unit="m/s²",
        profile=safe_mps2, lowest=safe_mps2 - slack, highest=safe_mps2 + slack, place=place,
    )  # fmt: skip
    return Case(
        name="threshold-end-of-run",
        fault="P2",
        tags=("thresholds", "process", "quick"),
        proves="At the end of a run the vehicle is braked to standstill, and only then released.",
        injected=f"the run is ended, {place}",
        route=straight(900.0, ENDS_MPS + 1.0),
        at_mps=ENDS_MPS,
        inject=process.send_signals(signal.SIGINT),
        for_s=0.05,
        see=(Ends((0,), 12.0), EndsOrderly()),
        measure=(ReleasedAt(limit=limit), *((Brakes(limit=brakes),) if numbers.wire.commands_acceleration else ())),
        then=Then.ENDED,
        needs=(Need.OWN_PROCESS,),
        allow=frozenset({"unanswered", "silence"}),
        answers_in_time=False,
    )


def _never_rests(numbers: Numbers) -> Case:
    key = "timing.shutdown_s"
    longest_s = numbers.or_else(key, 10.0)
    limit = Limit(
        key=key, name="release of a vehicle that does not come to rest", unit="s", profile=longest_s,
        lowest=longest_s - 0.3, highest=longest_s + 0.3 + numbers.late_s,
    )  # fmt: skip
    push = base.combine(_push_on(), process.send_signals(signal.SIGINT))
    return Case(
        name="threshold-shutdown",
        fault="P2",
        tags=("thresholds", "process", "slow"),
        proves="At the end of a run a vehicle that does not come to rest is released after the profile's time.",
        injected="the run is ended while a slope pushes the vehicle on",
        route=straight(900.0, 5.0),
        at_mps=4.0,
        inject=push,
        for_s=longest_s + 1.0,
        see=(Ends((0, 4), longest_s + 3.0),),
        measure=(ReleasedAfter(limit=limit),),
        lacks=numbers.lacks(key),
        then=Then.ENDED,
        needs=(Need.OWN_PROCESS,),
        allow=ANYTHING | {"release"},
        answers_in_time=False,
    )


def _push_on() -> Injection:
    """As hard as the stop brakes, so that the speed stays about the same."""
    return lambda rig: vehicle.change_vehicle(
        plant_push_mps2=float(rig.wire.profile["behavior"]["safe_deceleration_mps2"]) * 1.02
    )(rig)


def _wheel_rad(pair: Pair) -> float:
    return abs(pair.steer["FRONT_WHEEL_ANGLE_REQUEST"])


def _case(
    name: str,
    fault: str,
    proves: str,
    injected: str,
    *,
    route: Callable[[], Route],
    steps: tuple[Step, ...],
    lacks: str,
) -> Case:
    return sequence_case(
        name=name,
        fault=fault,
        tags=("thresholds", "state", "limits"),
        proves=proves,
        injected=injected,
        route=route,
        steps=steps,
        lacks=lacks,
        allow=ANYTHING - {"dynamics"},
    )
