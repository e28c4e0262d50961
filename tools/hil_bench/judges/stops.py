"""How a stop brakes and steers, and that nobody but the driver gets a moving vehicle: by the profile."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from vehicle_bus_contract.judge import SILENCE_NS, Pair, Record
from vehicle_bus_contract.reference import AUTONOMOUS, FAULT, MANUAL, S

from hil_bench.by_speed import max_wheel_rad
from hil_bench.judges.dynamics import recent_speeds, recent_wheels
from hil_bench.vehicle import Instant
from hil_bench.wire import Wire

LEAST_SHARE = 0.9
"""Of the deceleration that the profile asks of a stop."""
RISE_SHARE, TURN_SHARE = 0.8, 0.5
"""Of the rates at which the brake rises and the wheels turn."""
BEGINS_S = 0.05
"""Until a stop shows: of its own, and two periods of the commands."""
SLOW_MPS, MOVES_MPS = 1.0, 0.3
"""Below these speeds the brake may be released, and the wheels may stay where they are."""
HELD_RAD = 0.02
SETTLED_S = 0.5
"""After the vehicle has left AUTONOMOUS every command knows it."""
TO_OTHERS = ("DRIVER_OVERRIDE", "VEHICLE_FAULT", "VEHICLE_NOT_AUTONOMOUS", "LINK_DOWN", "DUPLICATE_COMMANDER")
"""Reasons for which a moving vehicle is released: it has a driver, or brakes by itself."""
TRACKED = ("STATE_STALE", "STATE_INVALID")
"""Reasons for which a stop goes straight where it otherwise follows the path."""


def find_weak_brakes(wire: Wire, record: Record, history: Sequence[Instant]) -> Iterable[str]:
    """Stops of a moving vehicle with less than 90 % of the brake that the profile asks for, or that rises late."""
    behavior = wire.profile["behavior"]
    safe_mps2, jerk_mps3 = behavior["safe_deceleration_mps2"], behavior["stop_jerk_mps3"]
    release_s = max(behavior.get("stop_release_time_constant_s", 0.0), behavior.get("time_step_s", 0.0), 1e-3)
    speeds = _Newest([(instant.at_ns, instant.speed_mps) for instant in history])
    for stop in _stops(record):
        begun: tuple[int, float, float] | None = None
        for pair in stop:
            speed = speeds.at(pair.stamp_ns)
            brake_mps2 = -math.copysign(1.0, speed) * pair.drive["ACCEL_REQUEST"]
            if abs(speed) <= SLOW_MPS or (begun and begun[2] * speed <= 0.0):
                begun = None
                continue
            begun = begun or (pair.stamp_ns, max(0.0, brake_mps2), speed)
            since_s = (pair.stamp_ns - begun[0]) / S - _begins_s(wire)
            due_mps2 = LEAST_SHARE * min(safe_mps2, abs(speed) / release_s) - wire.accel_slack_mps2
            risen_mps2 = begun[1] + RISE_SHARE * jerk_mps3 * since_s
            if since_s > 0.0 and brake_mps2 < min(due_mps2, risen_mps2):
                late = ", later than its jerk allows" if risen_mps2 < due_mps2 else ""
                yield (
                    f"{_at(pair, record)} a stop with {pair.reason} brakes with {brake_mps2:.2f} m/s² "
                    f"at {speed:.2f} m/s, where {due_mps2:.2f} are due{late}"
                )


def find_wrong_steering(wire: Wire, record: Record) -> Iterable[str]:
    """Stops that do not turn the wheels straight, or do not hold them, as the profile says, while the vehicle moves."""
    if not wire.commands_angle:
        return
    policy = wire.profile["behavior"].get("stop_steering", "straight")
    speeds, wheels = recent_speeds(record), recent_wheels(wire, record)
    for stop in _stops(record):
        first_rad, left_rad, before_ns = _angle(stop[0]), abs(_angle(stop[0])), stop[0].stamp_ns
        for pair in stop[1:]:
            lately_mps, lately_rad = speeds.until(pair.stamp_ns), wheels.until(pair.stamp_ns)
            fastest_mps, angle = max(0.1, *map(abs, lately_mps)), _angle(pair)
            if (pair.stamp_ns - stop[0].stamp_ns) / S > _begins_s(wire):
                left_rad = max(0.0, left_rad - _turn_rad(wire, fastest_mps, left_rad, pair.stamp_ns - before_ns))
            before_ns = pair.stamp_ns
            if abs(lately_mps[-1]) < MOVES_MPS or _is_held_back(wire, angle, lately_rad):
                continue
            if policy == "hold":
                is_forced = abs(angle) < abs(first_rad) and abs(first_rad) > max_wheel_rad(wire, fastest_mps) - HELD_RAD
                is_wrong = abs(angle - first_rad) > HELD_RAD + wire.wheel_count_rad and not is_forced
            else:
                is_judged = policy == "straight" or pair.reason in TRACKED
                is_wrong = is_judged and abs(angle) > left_rad + HELD_RAD + wire.wheel_count_rad
            if is_wrong:
                yield (
                    f"{_at(pair, record)} a stop with {pair.reason} has the wheels at {angle:.4f} rad "
                    f"at {lately_mps[-1]:.2f} m/s, where the profile has them {policy}"
                )


def find_released(wire: Wire, record: Record, history: Sequence[Instant]) -> Iterable[str]:
    """ENABLE = 0 for a vehicle that moves and is AUTONOMOUS, for a reason that gives it to nobody."""
    if not (wire.tells_enable and wire.tells_reasons):
        return
    speeds = _Newest([(instant.at_ns, instant.speed_mps if instant.mode == AUTONOMOUS else 0.0) for instant in history])
    was_enabled = False
    for pair in record.pairs:
        speed = speeds.at(pair.stamp_ns)
        if was_enabled and not pair.is_enabled and abs(speed) > MOVES_MPS and pair.reason not in TO_OTHERS:
            yield f"{_at(pair, record)} ENABLE 0 with {pair.reason} at {speed:.2f} m/s"
        was_enabled = pair.is_enabled


def find_unarmed(
    record: Record, history: Sequence[Instant], armed_ns: Sequence[int], later_s: float = 0.0
) -> Iterable[str]:
    """ENABLE = 1 after the vehicle has gone from AUTONOMOUS to its driver or to a fault, before somebody has armed.

    One command is allowed after silence: the device may have been stopped between reading and sending.
    """
    left_ns = _find_left(history)
    arming = [*armed_ns, *(pair.stamp_ns for pair in record.pairs[-1:]), *(i.at_ns for i in history[-1:])]
    for begin_ns in left_ns:
        end_ns = min((one for one in armed_ns if one >= begin_ns), default=max(arming, default=begin_ns) + 1)
        for before, pair in pairwise(record.pairs):
            is_first = pair.stamp_ns - before.stamp_ns > SILENCE_NS
            if begin_ns + (SETTLED_S + later_s) * S < pair.stamp_ns < end_ns and pair.is_enabled and not is_first:
                since_s = (pair.stamp_ns - begin_ns) / S
                yield f"{_at(pair, record)} ENABLE 1 with {pair.reason}, {since_s:.1f} s after it ended, not armed"


def _find_left(history: Sequence[Instant]) -> list[int]:
    """When the vehicle left AUTONOMOUS for its driver or a fault."""
    modes = [(instant.at_ns, instant.mode) for instant in history]
    return [
        at_ns
        for (_, before), (at_ns, mode) in pairwise(modes)
        if before == AUTONOMOUS and (mode == MANUAL or mode >= FAULT)
    ]


def _stops(record: Record) -> Iterable[list[Pair]]:
    """Stretches of enabled stops without a gap."""
    stop: list[Pair] = []
    for pair in record.pairs:
        is_on = pair.is_enabled and pair.is_stop
        if stop and (not is_on or pair.stamp_ns - stop[-1].stamp_ns > SILENCE_NS):
            yield stop
            stop = []
        if is_on:
            stop.append(pair)
    if stop:
        yield stop


def _turn_rad(wire: Wire, speed_mps: float, angle_rad: float, past_ns: int) -> float:
    """By how much the wheels must have turned back: half of what rate and lateral jerk allow."""
    limits = wire.profile["limits"]
    by_jerk = limits["lateral_jerk_mps3"] * wire.profile["geometry"]["wheelbase_m"] / speed_mps**2
    rate_radps = min(limits["front_wheel_rate_radps"], by_jerk * math.cos(angle_rad) ** 2)
    return float(TURN_SHARE * rate_radps * past_ns / S)


def _is_held_back(wire: Wire, angle_rad: float, measured_rad: Sequence[float]) -> bool:
    """True if the wheels hang: the command may not lead further away from where they are measured."""
    if not wire.measures_wheels:
        return False
    apart_rad = wire.profile["limits"]["front_wheel_deviation_rad"] - HELD_RAD - wire.wheel_count_rad
    return any(abs(angle_rad - one) >= apart_rad for one in measured_rad)


def _begins_s(wire: Wire) -> float:
    return BEGINS_S + 2.0 * wire.command_period_s


def _angle(pair: Pair) -> float:
    return pair.steer["FRONT_WHEEL_ANGLE_REQUEST"]


def _at(pair: Pair, record: Record) -> str:
    return f"{(pair.stamp_ns - record.begin_ns) / S:.3f} s:"


class _Newest:
    """The newest of the values that were known at a time, asked for in the order of time."""

    def __init__(self, told: Sequence[tuple[int, float]]) -> None:
        self._told, self._place, self._value = told, 0, 0.0

    def at(self, stamp_ns: int) -> float:
        while self._place < len(self._told) and self._told[self._place][0] <= stamp_ns:
            self._value, self._place = self._told[self._place][1], self._place + 1
        return self._value
