"""Every message and field of the vehicle in turn, wrong while it is driven and wrong from the start.

Each message has one case, whose faults follow one another in one drive.
"""

from hil_bench.case import Case
from hil_bench.cases.thresholds.common import Numbers, sequence_case, straight
from hil_bench.expect import DrivesOn, Expectation, NeverDrives, Stops
from hil_bench.faults import frames, signals, vehicle
from hil_bench.faults.base import Injection
from hil_bench.faults.frames import Change
from hil_bench.steps import Step
from hil_bench.vocabulary import SIGNAL_NAMES, Wait
from hil_bench.wire import Wire

AT_MPS = 1.0
FROM_START_S = 1.2
"""A sound device would have engaged by then."""
MOST_DATA = 8
REASONS = ("STATE_STALE", "STATE_INVALID", "FRAME_MISMATCH", "VEHICLE_NOT_AUTONOMOUS", "VEHICLE_FAULT")
ENUMERATED = {"POSE_FRAME": 3, "GEAR": 7, "MODE": 7}
"""A number that has no name, where the vehicle has the signal so wide."""


def message_cases(wire: Wire) -> tuple[Case, ...]:
    """One for each message of the vehicle's sample and status, and one for the fields of each."""
    names = dict.fromkeys((*wire.sample, *wire.status))
    numbers = Numbers(wire)
    return (*(_message(numbers, name) for name in names), _fields(numbers), _starts(numbers))


def _message(numbers: Numbers, name: str) -> Case:
    wire = numbers.wire
    lost_s = find_loss_s(numbers, name)
    late = Stops(REASONS, within_s=lost_s, until_end=False, waits_for=Wait.NOTHING)
    steps = []
    for what, change in _frame_faults(wire, name):
        steps.append(
            Step(
                name=what,
                inject=frames.change_message(name, change),
                for_s=lost_s + 0.06,
                see=(late,),
                is_left_alone=wire.loses_its_place,
            )
        )
        if change in (frames.drop, frames.break_crc, frames.seal_as_another, frames.hold_counter):
            steps.append(from_start(numbers, f"{what}, from the start", frames.change_message(name, change)))
    if wire.protection_of(name).counters:
        once_more = frames.change_message(name, frames.repeat)
        steps.append(Step(name="each frame twice", inject=once_more, for_s=0.3, see=(DrivesOn(0.0),)))
    return sequence_case(
        name=f"message-{name.lower().replace('_', '-')}",
        fault=f"F1 F2 F3 F4 S1{'' if name in wire.sample else ' X2'}",
        tags=("messages", "frames", "state"),
        proves=f"Without intact frames of {name} the vehicle is stopped, and not driven in the first place.",
        injected=f"{name}: {', '.join(step.name for step in steps)}",
        route=straight(),
        at_mps=AT_MPS,
        steps=steps,
    )


def find_loss_s(numbers: Numbers, name: str) -> float:
    """From the first wrong frame of a message until the stop is on the bus."""
    wire = numbers.wire
    if name in wire.sample:
        lost_s = numbers.or_else("timing.state_stale_s", 0.05)
        if not wire.is_counted and name != wire.trigger:
            lost_s += wire.max_age_s(name) if hasattr(wire, "max_age_s") else 0.0
    else:
        lost_s = numbers.or_else("timing.status_stale_s", 0.1) + numbers.or_else("timing.status_period_s", 0.02)
    return float(lost_s + numbers.inferred_s + numbers.late_s + wire.period_s)


def _frame_faults(wire: Wire, name: str) -> list[tuple[str, Change]]:
    """What can be wrong with every frame of a message, so that none of them counts."""
    protection = wire.protection_of(name)
    found: list[tuple[str, Change]] = [("missing", frames.drop)]
    if protection.has_checksum:
        found.append(("checksum wrong", frames.break_crc))
    if protection.has_checksum and protection.covers_identity:
        found.append(("with the checksum of another message", frames.seal_as_another))
    if protection.counters:
        found.append(("counter frozen", frames.hold_counter))
    found += [("too short", frames.shorten), ("without data", frames.empty), ("a remote request", frames.make_remote)]
    if not wire.is_fd and wire.lengths[name] < MOST_DATA:
        found.append(("too long", frames.lengthen))
    if wire.ids[name] <= 0x7FF:
        found.append(("with an extended identifier", frames.make_extended))
    found.append(("of the other format", frames.swap_format))
    return found


def from_start(numbers: Numbers, name: str, inject: Injection) -> Step:
    for_s = FROM_START_S + numbers.or_else("timing.engage_settle_s", 0.5) + 4.0 * numbers.period_s
    never: tuple[Expectation, ...] = (NeverDrives(),)
    return Step(name=name, inject=inject, for_s=for_s, is_from_start=True, see=never, is_left_alone=True)


def _fields(numbers: Numbers) -> Case:
    """Values beyond their range, and numbers without a name, while the vehicle is driven."""
    wire = numbers.wire
    steps = []
    for signal in (*SIGNAL_NAMES["state"].values(), *SIGNAL_NAMES["status"].values()):
        inject = make_impossible(wire, signal)
        if inject is None:
            continue
        name = wire.part_of(signal)
        lost_s = find_loss_s(numbers, name)
        late = Stops(REASONS, within_s=lost_s + numbers.late_s, until_end=False, waits_for=Wait.NOTHING)
        steps.append(
            Step(name=f"{signal} impossible", inject=inject, for_s=lost_s + 0.1, see=(late,), is_left_alone=True)
        )
        steps.append(from_start(numbers, f"{signal} impossible from the start", inject))
    return sequence_case(
        name="fields-impossible",
        fault="F5",
        tags=("messages", "values", "frames"),
        proves="A frame with an impossible value is no state, whichever field it is in.",
        injected=f"a value beyond the range or a number without a name: {', '.join(step.name for step in steps)}",
        route=straight(),
        at_mps=AT_MPS,
        steps=steps,
        lacks="" if steps else "no field of the vehicle can carry an impossible value",
    )


def make_impossible(wire: Wire, signal: str) -> Injection | None:
    """A value that the signal's bits can carry, and the DBC does not allow."""
    if not wire.has(signal) or (signal in ("POS_X", "POS_Y") and wire.loses_its_place):
        return None
    if signal in ENUMERATED:
        is_spare = signal in ("MODE", "POSE_FRAME", "GEAR") and _has_spare(wire, signal, ENUMERATED[signal])
        return signals.set_signals(**{signal: float(ENUMERATED[signal])}) if is_spare else None
    if signal not in SIGNAL_NAMES["state"].values() or signal in ("POSE_VALID", "REAR_WHEEL_ANGLE"):
        return None
    try:
        most, most_of_bits = wire.greatest(signal)
    except (KeyError, IndexError):
        return None
    return signals.exceed_range(signal) if most_of_bits > most else None


def _has_spare(wire: Wire, signal: str, number: int) -> bool:
    try:
        return wire.has_spare(signal, number)
    except (KeyError, IndexError):
        return False


def _starts(numbers: Numbers) -> Case:
    """What must keep a device from driving off, although nothing has changed since it was started."""
    wire = numbers.wire
    found: list[tuple[str, str, Injection]] = [
        ("another frame of reference", "POSE_FRAME", vehicle.change_vehicle(pose_frame="ODOM")),
        ("an invalid pose", "POSE_VALID", vehicle.change_vehicle(pose_valid=False)),
        ("the driver brakes", "DRIVER_BRAKE", vehicle.change_until_ready(driver_brake=True)),
        ("the driver accelerates", "DRIVER_THROTTLE", vehicle.change_until_ready(driver_throttle=True)),
        ("the driver steers to the left", "DRIVER_STEER_TORQUE", vehicle.change_until_ready(driver_torque_nm=5.0)),
        ("the driver steers to the right", "DRIVER_STEER_TORQUE", vehicle.change_until_ready(driver_torque_nm=-5.0)),
        ("a fault of the vehicle", "FAULT_CODE", vehicle.change_until_ready(fault_code=5)),
    ]
    steps = tuple(from_start(numbers, name, inject) for name, signal, inject in found if wire.has(signal))
    return sequence_case(
        name="wrong-from-the-start",
        fault="S5 V1 V2",
        tags=("messages", "state", "driver", "engagement"),
        proves="What must stop a drive must also keep it from beginning.",
        injected=f"while the device is armed: {', '.join(step.name for step in steps)}",
        route=straight(),
        at_mps=0.0,
        steps=steps,
        lacks="" if steps else "the vehicle's bus has neither a frame, a validity, a driver nor a fault",
    )
