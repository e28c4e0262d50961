"""The lines that the driver socket accepts: a table of words and actions.

    brake 0|1 · throttle 0|1 · steer N·m · gear NAME · ready · reset · fault CODE · emergency_stop
    pose_valid 0|1 · frame ODOM|MAP · mute WHAT on|off · corrupt WHAT N · skip_counter WHAT N
    sensor FIELD FAULT AMOUNT · freeze on|off · jump DX_M DY_M · status · help

WHAT is a message of the vehicle, STATE for those of one sample, or ALL. FIELD is a number of the state, such as
`speed_mps`; FAULT is `good`, `frozen` (AMOUNT 0), `scaled` (AMOUNT is the factor), `offset` (in the field's unit) or
`late` (s). Every answer is one line: `ok`, an `error: …` that names what is allowed, or the status as JSON.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.sim.signal_faults import FIELDS, SignalFault, delayed, frozen, offset, scaled
from vehicle_iface.sim.vehicle import SimulatedVehicle
from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_S

MOST_FRAMES = 100_000
"""Maximum number of frames that one line corrupts."""
MOST_STEPS = 15
"""Maximum number of counter steps of one line: a full cycle is enough, and a line must not delay a tick."""
_T = TypeVar("_T")
_SWITCH = {"0": False, "1": True, "off": False, "on": True}
_GEARS = {gear.name: gear for gear in (Gear.PARK, Gear.REVERSE, Gear.NEUTRAL, Gear.DRIVE)}

Words = Sequence[str]


def execute(vehicle: SimulatedVehicle, line: str) -> str:
    """Execute one line; return the answer, one line without its end. Never raises."""
    words = line.split()
    if not words or words[0] not in COMMANDS:
        return f"error: {line.strip()[:40]!r}: must be one of {', '.join(COMMANDS)}"
    usage, action = COMMANDS[words[0]]
    if len(words) != len(usage.split()):
        return f"error: {line.strip()[:40]!r}: must be '{usage}'"
    try:
        return action(vehicle, words[1:])
    except InvalidValueError as error:
        return f"error: {words[0]}: {error}"


def status_of(vehicle: SimulatedVehicle) -> dict[str, object]:
    """Return the vehicle's true state, for people and tests."""
    s, d = vehicle.state, vehicle.driver
    return {
        "mode": vehicle.mode.name,
        "gear": vehicle.gear.name,
        "fault_code": vehicle.fault_code,
        "frame_id": vehicle.frame_id,
        "pose_valid": vehicle.pose_valid,
        "x_m": s.x_m,
        "y_m": s.y_m,
        "heading_rad": s.heading_rad,
        "speed_mps": s.speed_mps,
        "accel_mps2": s.accel_mps2,
        "yaw_rate_radps": s.yaw_rate_radps,
        "front_wheel_angle_rad": s.front_wheel_angle_rad,
        "rear_wheel_angle_rad": s.rear_wheel_angle_rad,
        "driver_brake": d.brake,
        "driver_throttle": d.throttle,
        "driver_steer_torque_nm": d.steer_torque_nm,
        "pairs": vehicle.pairs,
        "muted": sorted(vehicle.frame_faults.muted),
        "frozen": vehicle.frozen,
        "wrong_sensors": sorted(vehicle.signal_faults),
        "counters": dict(vehicle.counters),
    }


def _brake(vehicle: SimulatedVehicle, words: Words) -> str:
    vehicle.set_driver(replace(vehicle.driver, brake=_switch(words[0])))
    return "ok"


def _throttle(vehicle: SimulatedVehicle, words: Words) -> str:
    vehicle.set_driver(replace(vehicle.driver, throttle=_switch(words[0])))
    return "ok"


def _steer(vehicle: SimulatedVehicle, words: Words) -> str:
    vehicle.set_driver(replace(vehicle.driver, steer_torque_nm=_number(words[0])))
    return "ok"


def _gear(vehicle: SimulatedVehicle, words: Words) -> str:
    if vehicle.shift(_one_of(words[0], _GEARS)):
        return "ok"
    limit_mps = vehicle.parameters.gear_change_speed_mps
    return f"error: gear: only up to {limit_mps} m/s, not at {vehicle.state.speed_mps:.2f} m/s"


def _ready(vehicle: SimulatedVehicle, _: Words) -> str:
    if vehicle.request_ready():
        return "ok"
    return f"error: ready: only from MANUAL with feet and hands off; mode is {vehicle.mode.name}"


def _reset(vehicle: SimulatedVehicle, _: Words) -> str:
    if vehicle.reset():
        return "ok"
    return f"error: reset: only from FAULT or EMERGENCY_STOP; mode is {vehicle.mode.name}"


def _fault(vehicle: SimulatedVehicle, words: Words) -> str:
    vehicle.raise_fault(_whole(words[0], 1, 255))
    return "ok"


def _emergency_stop(vehicle: SimulatedVehicle, _: Words) -> str:
    vehicle.press_emergency_stop()
    return "ok"


def _pose_valid(vehicle: SimulatedVehicle, words: Words) -> str:
    vehicle.pose_valid = _switch(words[0])
    return "ok"


def _frame(vehicle: SimulatedVehicle, words: Words) -> str:
    vehicle.frame_id = _one_of(words[0], {name.upper(): name for name in vehicle.frame_ids})
    return "ok"


def _mute(vehicle: SimulatedVehicle, words: Words) -> str:
    messages = _messages(vehicle, words[0])
    if _switch(words[1]):
        vehicle.frame_faults.muted.update(messages)
    else:
        vehicle.frame_faults.muted.difference_update(messages)
    return "ok"


def _corrupt(vehicle: SimulatedVehicle, words: Words) -> str:
    messages, frames = _messages(vehicle, words[0]), _whole(words[1], 0, MOST_FRAMES)
    for message in messages:
        vehicle.frame_faults.corrupt[message] = frames
    return "ok"


def _skip_counter(vehicle: SimulatedVehicle, words: Words) -> str:
    messages, steps = _messages(vehicle, words[0]), _whole(words[1], 1, MOST_STEPS)
    for message in messages:
        vehicle.skip_counter(message, steps)
    return "ok"


def _sensor(vehicle: SimulatedVehicle, words: Words) -> str:
    field, make = _one_of(words[0], {name: name for name in FIELDS}), _one_of(words[1], SENSOR_FAULTS)
    fault = make(vehicle, _number(words[2]))
    if fault is None:
        vehicle.signal_faults.pop(field, None)
    else:
        vehicle.signal_faults[field] = fault
    return "ok"


def _late(vehicle: SimulatedVehicle, seconds: float) -> SignalFault:
    return delayed(round(seconds * NS_PER_S / vehicle.parameters.shortest_period_ns))


SENSOR_FAULTS: dict[str, Callable[[SimulatedVehicle, float], SignalFault | None]] = {
    "good": lambda _vehicle, _amount: None,
    "frozen": lambda _vehicle, _amount: frozen(),
    "scaled": lambda _vehicle, amount: scaled(amount),
    "offset": lambda _vehicle, amount: offset(amount),
    "late": _late,
}
"""Name → function that makes the fault from vehicle and amount; None for no fault."""


def _freeze(vehicle: SimulatedVehicle, words: Words) -> str:
    vehicle.frozen = _switch(words[0])
    return "ok"


def _jump(vehicle: SimulatedVehicle, words: Words) -> str:
    vehicle.jump(_number(words[0]), _number(words[1]))
    return "ok"


def _status(vehicle: SimulatedVehicle, _: Words) -> str:
    return json.dumps(status_of(vehicle))


def _help(_: SimulatedVehicle, __: Words) -> str:
    return " · ".join(usage for usage, _ in COMMANDS.values())


COMMANDS: dict[str, tuple[str, Callable[[SimulatedVehicle, Words], str]]] = {
    "brake": ("brake 0|1", _brake),
    "throttle": ("throttle 0|1", _throttle),
    "steer": ("steer NEWTON_METRES", _steer),
    "gear": ("gear PARK|REVERSE|NEUTRAL|DRIVE", _gear),
    "ready": ("ready", _ready),
    "reset": ("reset", _reset),
    "fault": ("fault CODE", _fault),
    "emergency_stop": ("emergency_stop", _emergency_stop),
    "pose_valid": ("pose_valid 0|1", _pose_valid),
    "frame": ("frame ODOM|MAP", _frame),
    "mute": ("mute MESSAGE|STATE|ALL on|off", _mute),
    "corrupt": ("corrupt MESSAGE|STATE|ALL FRAMES", _corrupt),
    "skip_counter": ("skip_counter MESSAGE|STATE|ALL STEPS", _skip_counter),
    "sensor": ("sensor FIELD FAULT AMOUNT", _sensor),
    "freeze": ("freeze on|off", _freeze),
    "jump": ("jump DX_M DY_M", _jump),
    "status": ("status", _status),
    "help": ("help", _help),
}
"""First word → usage and action."""


def _switch(word: str) -> bool:
    return _one_of(word, _SWITCH)


def _one_of(word: str, allowed: Mapping[str, _T]) -> _T:
    if word not in allowed:
        raise InvalidValueError(f"{word[:40]!r}: must be one of {', '.join(allowed)}")
    return allowed[word]


def _messages(vehicle: SimulatedVehicle, word: str) -> tuple[str, ...]:
    groups = {message: (message,) for message in vehicle.messages}
    return _one_of(word, groups | {"STATE": vehicle.sample, "ALL": vehicle.messages})


def _number(word: str) -> float:
    return checks.finite(word[:40], _parsed(float, word))


def _whole(word: str, least: int, most: int) -> int:
    number = _parsed(int, word)
    if not least <= number <= most:
        raise InvalidValueError(f"{number}: must be {least}..{most}")
    return number


def _parsed(kind: Callable[[str], _T], word: str) -> _T:
    try:
        return kind(word)
    except ValueError:
        raise InvalidValueError(f"{word[:40]!r}: must be a number") from None
