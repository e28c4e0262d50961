"""The driver's signals, each without a change of mode by the vehicle, and how long an override lasts."""

from hil_bench.case import Case, Need, Then
from hil_bench.cases.thresholds.common import SLOW_MPS, USUAL_MPS, Numbers, sequence_case, straight
from hil_bench.expect import LetsGo, StaysOut
from hil_bench.expect.limit import Limit
from hil_bench.expect.thresholds import ReleaseAt
from hil_bench.faults import growing, vehicle
from hil_bench.steps import Step
from hil_bench.vehicle import DRIVER_TORQUE_NM
from hil_bench.wire import Wire

RELEASES_S = 0.03
"""After the status that has the driver's action."""
GROWS = 0.6
"""The torque grows by this share of the threshold in a second."""
OVERRIDE = ("DRIVER_OVERRIDE",)
JUST_OVERRIDES_NM = 3.2
"""Of the reference vehicle's 3.0."""
RELEASED = (LetsGo(("DRIVER_OVERRIDE", "NOT_ENGAGED"), within_s=0.06), StaysOut())


def driver_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    return (_alone(numbers), _torque(numbers), *_latched(numbers))


def act_alone(numbers: Numbers) -> tuple[Step, ...]:
    """Each action of the driver, while the vehicle keeps its mode."""
    wire = numbers.wire
    status_s = numbers.or_else("timing.status_period_s", 0.02)
    actions = (
        ("the driver brakes", "DRIVER_BRAKE", {"driver_brake": True}),
        ("the driver accelerates", "DRIVER_THROTTLE", {"driver_throttle": True}),
        ("the driver steers to the left", "DRIVER_STEER_TORQUE", {"driver_torque_nm": JUST_OVERRIDES_NM}),
        ("the driver steers to the right", "DRIVER_STEER_TORQUE", {"driver_torque_nm": -JUST_OVERRIDES_NM}),
    )
    return tuple(
        Step(
            name=name,
            inject=growing.act_without_the_vehicle(**changed),
            for_s=0.3,
            at_mps=at_mps,
            see=(LetsGo(OVERRIDE, within_s=RELEASES_S + status_s), StaysOut()),
            after_s=0.3,
            is_left_alone=True,
        )
        for name, signal, changed in actions
        for at_mps in (USUAL_MPS,)
        if wire.has(signal)
    )


def override_and_wait(numbers: Numbers, watched_s: float) -> Step | None:
    """An override, then a vehicle that is READY for a while; None without a pedal on the bus."""
    pedal = _pedal(numbers)
    if not pedal:
        return None
    return Step(
        name=f"an override, then READY for {watched_s:g} s",
        inject=vehicle.change_and_make_ready(**{pedal: True}),
        for_s=0.2,
        at_mps=SLOW_MPS,
        see=RELEASED,
        after_s=watched_s,
        is_left_alone=True,
    )


def _alone(numbers: Numbers) -> Case:
    steps = act_alone(numbers)
    return sequence_case(
        name="driver-signals-alone",
        fault="V1",
        tags=("thresholds", "driver"),
        proves="Each action of the driver releases the vehicle, although the vehicle does not change its mode itself.",
        injected="the driver brakes, accelerates and steers to either side; the mode stays AUTONOMOUS",
        route=straight(),
        steps=steps,
        lacks="" if steps else "the vehicle's bus has no signal of the driver",
    )


def _torque(numbers: Numbers) -> Case:
    key = "limits.driver_steer_torque_nm"
    stated_nm = numbers.or_else(key, DRIVER_TORQUE_NM)
    is_told = "driver_steer_torque_nm" in numbers.wire.profile.get("status", {}).get("signals", {})
    per_s = GROWS * stated_nm
    late_nm = per_s * (2.0 * numbers.or_else("timing.status_period_s", 0.02) + 2.0 * numbers.period_s)
    steps = []
    for side, way in (("left", 1.0), ("right", -1.0)):
        ends = sorted((way * 0.96 * stated_nm, way * (1.02 * stated_nm + late_nm)))
        limit = Limit(
            key=key, name="driver's torque", unit="N·m", profile=way * stated_nm, lowest=ends[0], highest=ends[1],
            place=f"to the {side}",
        )  # fmt: skip
        share = DRIVER_TORQUE_NM / stated_nm if numbers.wire.name != "reference" else 1.0
        steps.append(
            Step(
                name=f"torque to the {side}",
                inject=growing.let_grow("driver_torque_nm", way * 0.7 * stated_nm * share, way * per_s * share),
                for_s=1.2,
                measure=(ReleaseAt(limit=limit, signal=_name_of_torque(numbers.wire)),),
                is_left_alone=True,
            )
        )
    lacks = "" if is_told else "the vehicle's bus has no torque of the driver"
    return sequence_case(
        name="threshold-driver-torque",
        fault="V1",
        tags=("thresholds", "driver"),
        proves="A torque of the driver as great as the profile says releases the vehicle, to either side.",
        injected="a torque that grows until the device releases the vehicle; the mode stays AUTONOMOUS",
        route=straight(),
        steps=steps,
        lacks=numbers.lacks(key) or lacks,
    )


def _name_of_torque(wire: Wire) -> str:
    """As decoded frames name it."""
    dotted = str(wire.profile.get("status", {}).get("signals", {}).get("driver_steer_torque_nm", ""))
    return dotted if hasattr(wire, "layout") else "DRIVER_STEER_TORQUE"


def _pedal(numbers: Numbers) -> str:
    """By which the driver overrides; empty without one on the bus."""
    signals = {"DRIVER_BRAKE": "driver_brake", "DRIVER_THROTTLE": "driver_throttle"}
    return next((attribute for signal, attribute in signals.items() if numbers.wire.has(signal)), "")


def _latched(numbers: Numbers) -> tuple[Case, ...]:
    pedal = _pedal(numbers)
    return tuple(
        Case(
            name=name,
            fault="V1",
            tags=tags,
            proves="After an override nothing but the operator's action makes the device drive again.",
            injected=f"an override of 0.2 s, then the vehicle is READY for {watched_s:g} s, and nobody arms the device",
            inject=vehicle.change_and_make_ready(**{pedal or "driver_brake": True}),
            for_s=0.2,
            after_s=watched_s,
            at_mps=SLOW_MPS,
            route=straight(),
            see=RELEASED,
            lacks="" if pedal else "the vehicle's bus has no pedal of the driver",
            then=Then.REARM,
            needs=(Need.REARM,),
            answers_in_time=False,
        )
        for name, tags, watched_s in (
            ("override-lasts", ("thresholds", "driver"), 5.0),
            ("override-lasts-a-minute", ("thresholds", "driver", "slow"), 62.0),
        )
    )
