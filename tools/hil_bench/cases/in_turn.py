"""Much of the catalogue in four short drives: one fault after the other, each only until it must show.

They are what the quick run has instead of a case for each fault.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

from hil_bench import routes
from hil_bench.case import Case
from hil_bench.cases.common import ANY, DROPPED, INVALID, STALE
from hil_bench.cases.messages import REASONS, find_loss_s, from_start, make_impossible
from hil_bench.cases.thresholds.common import Numbers, backwards, sequence_case, straight
from hil_bench.cases.thresholds.deviation import DRIFT_MPS, LATERAL, TURN_MPS, leave_path, roll_back, turn_away
from hil_bench.cases.thresholds.driver import act_alone, override_and_wait
from hil_bench.cases.thresholds.samples import step_counters, why_counters_cannot_step
from hil_bench.expect import Expectation, FallsSilent, HazardLights, LetsGo, Standstill, StaysOut, Stops
from hil_bench.faults import frames, growing, signals, traffic, vehicle
from hil_bench.faults.base import Injection
from hil_bench.parts import Part, parts_of
from hil_bench.steps import Step
from hil_bench.vocabulary import SIGNAL_NAMES, Wait
from hil_bench.wire import Wire

SLOW_MPS, USUAL_MPS, BEND_MPS = 1.0, 2.5, 5.0
MISMATCH = ("FRAME_MISMATCH",)
ENGAGES_S = 0.9
"""A device that is still armed engages a vehicle that has been READY for this long."""
WATCHED_S = 5.0
"""After an override."""


@dataclass(frozen=True)
class _Damage:
    """A fault of a message."""

    name: str
    inject: Injection
    lost_s: float
    """Until the stop is on the bus."""
    is_of_status: bool
    """The vehicle gives up meanwhile: the device must be armed again."""


def in_turn_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    return (_messages(numbers), _state(numbers), _reverse(numbers), _vehicle(numbers))


def _messages(numbers: Numbers) -> Case:
    wire, parts = numbers.wire, parts_of(numbers.wire)
    found: list[_Damage] = []

    def damage(name: str, inject: Injection, message: str, more_s: float = 0.0) -> None:
        found.append(_Damage(name, inject, find_loss_s(numbers, message) + more_s, message in wire.status))

    for name in dict.fromkeys((*wire.sample, *wire.status)):
        if wire.protection_of(name).has_checksum:
            damage(f"{name}, checksum wrong", frames.change_message(name, frames.break_crc), name)
    first, last = wire.sample[0], (*wire.sample, *wire.status)[-1]
    if wire.protection_of(last).counters:
        damage(f"{last}, counter frozen", frames.change_message(last, frames.hold_counter), last)
    if Part.SHORT_ID in parts:
        damage(f"{first}, identifier extended", frames.change_message(first, frames.make_extended), first)
    if Part.SHARED_COUNTER in parts:
        damage("messages of different cycles", frames.mix_cycles(), first)
    for signal, inject in _find_impossible(wire):
        damage(f"{signal} impossible", inject, wire.part_of(signal))
    if Part.CHECKSUM in parts:
        damage("damaged frames beside the sound ones", traffic.flood(traffic.damaged_sample, 10), first, 0.1)
    steps = [
        Step(
            name=one.name,
            inject=one.inject,
            for_s=one.lost_s + 0.1,
            see=(Stops(REASONS, within_s=one.lost_s + numbers.late_s, until_end=False, waits_for=Wait.NOTHING),),
            is_left_alone=wire.loses_its_place or one.is_of_status,
        )
        for one in found
    ]
    steps += [] if why_counters_cannot_step(numbers) else [step_counters(numbers)]
    return sequence_case(
        name="messages-in-turn",
        fault="F1 F2 F3 F5 B12",
        tags=("messages", "frames", "quick"),
        proves="A damaged message is no state, whichever it is and however it is damaged.",
        injected=", ".join(step.name for step in steps),
        route=straight(),
        at_mps=SLOW_MPS,
        steps=steps,
        lacks="" if steps else "no message of the vehicle is protected",
    )


def _find_impossible(wire: Wire) -> Iterator[tuple[str, Injection]]:
    """One of the status, and one of the state that contradicts another field only after a while."""
    for names in (SIGNAL_NAMES["status"].values(), ("LATERAL_SPEED", *SIGNAL_NAMES["state"].values())):
        found = ((signal, make_impossible(wire, signal)) for signal in names)
        yield from islice(((signal, inject) for signal, inject in found if inject is not None), 1)


def _state(numbers: Numbers) -> Case:
    """The first step is in a bend and fast: the wheels must return slowly."""
    wire, parts = numbers.wire, parts_of(numbers.wire)
    steps = list(_find_state_steps(wire))
    if wire.has("LATERAL_SPEED") and Part.POSITION in parts and not numbers.lacks(LATERAL):
        drifts = leave_path(numbers, 1.0, "to the left, in turn", true_mps=SLOW_MPS, limit_s=2.4)
        and_back = growing.take_back(growing.drift_and_return(DRIFT_MPS, 0.95))
        stays = Stops(("DEVIATION",), within_s=1.4)
        steps.append(replace(drifts, at_mps=SLOW_MPS, inject=and_back, see=(stays,)))
        steps += [
            replace(step, at_mps=at_mps, see=(Stops(("DEVIATION",), within_s=step.for_s, until_end=False),))
            for step, at_mps in ((turn_away(numbers, 1.0, limit_s=2.4), TURN_MPS), (roll_back(numbers), SLOW_MPS))
        ]
    if Part.POSE_FRAME in parts:
        elsewhere = vehicle.change_vehicle(pose_frame="ODOM")
        steps.append(from_start(numbers, "pose in another frame from the start", elsewhere))
    return sequence_case(
        name="state-in-turn",
        fault="S3 S4 S5 S7 S8 S9 S10",
        tags=("state", "plausibility", "limits", "quick"),
        proves="State that is invalid, implausible or old stops the vehicle, and a stop is one of the profile.",
        injected=", ".join(step.name for step in steps),
        route=lambda: routes.route("long-bend", [(600.0, 1.0 / 25.0)], BEND_MPS + 0.5, slack=6.0),
        steps=steps,
        lacks="" if steps else "no field of the vehicle can be wrong so that it shows",
        allow=ANY | DROPPED | {"burst"},
    )


def _find_state_steps(wire: Wire) -> Iterator[Step]:
    """Those that need no more than a field of the state and a fault of it."""
    parts, either = parts_of(wire), (*INVALID, *STALE)

    def step(name: str, inject: Injection, for_s: float, *see: Expectation, at_mps: float = USUAL_MPS) -> Step:
        return Step(name=name, inject=inject, for_s=for_s, see=see, at_mps=at_mps)

    if Part.POSE_VALID in parts:
        invalid = vehicle.change_vehicle(pose_valid=False)
        yield step("POSE_VALID = 0 in a bend", invalid, 0.5, Stops(INVALID), HazardLights(), at_mps=BEND_MPS)
    if Part.POSE_FRAME in parts:
        yield step("pose in another frame", vehicle.change_vehicle(pose_frame="ODOM"), 0.2, Stops(MISMATCH))
    if Part.POSE_VALID in parts:
        flaps = signals.alternate_signals(2, POSE_VALID=0.0)
        yield step("POSE_VALID = 0 in every second sample", flaps, 0.5, Stops(INVALID))
    if Part.GEAR in parts and Part.REVERSE in parts:
        reverse = signals.name_value("GEAR", "REVERSE")
        yield step("GEAR = REVERSE", reverse, 0.5, Stops(INVALID, within_s=0.35, until_end=False))
    if Part.POSITION in parts:
        swing = signals.swing_signals(POS_Y=30.0)
        yield step("positions to the left and to the right", swing, 0.3, Stops(either, until_end=False))
        frozen = Stops(either, within_s=0.3, until_end=False)
        yield step("frozen values", signals.freeze_sample(), 0.4, frozen)
    if not wire.loses_its_place:
        held_up = frames.delay_in_gateway(0.3)
        yield step("samples held up, then sent at once", held_up, 0.5, Stops(STALE, until_end=False))
    if Part.POSITION in parts:
        slower = signals.offset_signals(SPEED=-0.68)
        yield step("SPEED 0.7 m/s too low", slower, 2.5, Stops(INVALID, within_s=2.5, until_end=False))


def _reverse(numbers: Numbers) -> Case:
    wire = numbers.wire
    step = Step(
        name="POSE_VALID = 0 in reverse",
        inject=vehicle.change_vehicle(pose_valid=False),
        for_s=1.6,
        at_mps=USUAL_MPS,
        see=(Stops(INVALID), Standstill(2.0)),
    )
    has_pose = Part.POSE_VALID in parts_of(wire)
    return sequence_case(
        name="reverse-in-turn",
        fault="S5",
        tags=("state", "limits", "quick"),
        proves="In reverse the vehicle is driven and stopped with the other sign.",
        injected=step.name,
        route=backwards(speed_mps=USUAL_MPS + 0.5),
        at_mps=USUAL_MPS,
        steps=(step,),
        lacks="" if has_pose and wire.can_reverse else "the vehicle cannot be driven and made invalid in reverse",
        allow=ANY | DROPPED,
    )


def _vehicle(numbers: Numbers) -> Case:
    parts = parts_of(numbers.wire)
    steps: list[Step] = []

    def release(name: str, inject: Injection, *reasons: str) -> None:
        see = (LetsGo(reasons), StaysOut())
        steps.append(Step(name=name, inject=inject, for_s=0.25, after_s=ENGAGES_S, see=see, is_left_alone=True))

    if Part.FAULT in parts:
        release("a fault of the vehicle", vehicle.change_and_make_ready(fault_code=5), "VEHICLE_FAULT")
    if Part.EMERGENCY_STOP in parts:
        stop = vehicle.change_and_make_ready(mode=4)
        release("its emergency stop", stop, "VEHICLE_FAULT", "VEHICLE_NOT_AUTONOMOUS")
    rival = traffic.flood(traffic.rival_command, 2)
    steps.append(
        Step(
            name="another commander",
            inject=rival,
            for_s=0.3,
            after_s=ENGAGES_S,
            see=(FallsSilent(0.05), StaysOut()),
            is_left_alone=True,
        )
    )
    lasts = override_and_wait(numbers, WATCHED_S)
    steps += [*act_alone(numbers), *([lasts] if lasts is not None else [])]
    return sequence_case(
        name="releases-in-turn",
        fault="V1 V4 B15",
        tags=("driver", "engagement", "quick"),
        proves="After a fault, the driver's or another node's action only the operator makes the device drive.",
        injected=", ".join(step.name for step in steps),
        route=straight(),
        at_mps=SLOW_MPS,
        steps=steps,
    )
