"""The profile's limits at the measured speed, for values and rates of every command."""

import math
from collections.abc import Iterable, Sequence

from vehicle_bus_contract.judge import JITTER_NS, SILENCE_NS, Pair, Record
from vehicle_bus_contract.reference import S

from hil_bench.by_speed import max_accel_mps2, max_wheel_rad
from hil_bench.judges.pace import ANSWERED_NS, Pace, Recent
from hil_bench.wire import Wire

STANDS_MPS = 0.05
LEAST_MPS = 0.1
"""Below this speed steering has no noticeable effect."""


def find_faults(wire: Wire, record: Record) -> Iterable[str]:
    """Everything in a record that breaks the profile's limits at the measured speed."""
    yield from beyond(wire, record)
    if wire.commands_angle:
        yield from swerving(wire, record)
        yield from led_away(wire, record)
    if wire.has_stop_signal and wire.commands_acceleration:
        yield from jerky(wire, record)
    else:
        yield from rising(wire, record)
    yield from rash(wire, record)


def beyond(wire: Wire, record: Record) -> Iterable[str]:
    """Steering, requested speed and acceleration beyond the profile's limits."""
    limits, behavior = wire.profile["limits"], wire.profile["behavior"]
    rear_rad = limits.get("rear_wheel_angle_rad", 0.0)
    speeds, wheels = recent_speeds(record), recent_wheels(wire, record)
    before: float | None = None
    braked = 0.0
    for pair, way in zip(record.pairs, _ways(record.pairs, record), strict=True):
        lately_mps, lately_rad = speeds.until(pair.stamp_ns), wheels.until(pair.stamp_ns)
        speed, slowest_mps = lately_mps[-1], _slowest_mps(lately_mps)
        if not pair.is_enabled:
            before = None
            continue
        at = _at(pair, record)
        angle = pair.steer["FRONT_WHEEL_ANGLE_REQUEST"]
        held_rad = max(map(abs, lately_rad)) if before is None else abs(before)
        if abs(angle) > max(held_rad, max_wheel_rad(wire, slowest_mps) + wire.wheel_count_rad):
            yield f"{at} {angle:.4f} rad at {speed:.2f} m/s"
        before = angle
        if abs(pair.steer.signals.get("REAR_WHEEL_ANGLE_REQUEST", 0.0)) > rear_rad + 1e-9:
            yield f"{at} {pair.steer['REAR_WHEEL_ANGLE_REQUEST']:.4f} rad of the rear wheels"
        if abs(pair.drive.signals.get("SPEED_REQUEST", 0.0)) > limits["speed_max_mps"] + 1e-9:
            yield f"{at} {pair.drive['SPEED_REQUEST']:.3f} m/s asked for"
        if not wire.commands_acceleration:
            continue
        strongest = max(behavior["safe_deceleration_mps2"], 0.0)
        accel = pair.drive["ACCEL_REQUEST"]
        most_mps2 = max_accel_mps2(wire, slowest_mps) + wire.accel_slack_mps2
        if accel * way > 0.0 and most_mps2 < abs(accel) >= abs(braked):
            yield f"{at} {accel:.3f} m/s² at {speed:.2f} m/s"
        if wire.has_stop_signal and pair.is_stop and abs(accel) > max(strongest, abs(braked)) + wire.accel_slack_mps2:
            yield f"{at} a stop with {accel:.3f} m/s²"
        braked = accel


def swerving(wire: Wire, record: Record) -> Iterable[str]:
    """Changes of curvature faster than the lateral jerk allows at the slowest recent speed: κ' ≤ jerk / v².

    After the speed has risen, wheels beyond the new limit may return to it at any rate.
    """
    limits, wheelbase_m = wire.profile["limits"], wire.profile["geometry"]["wheelbase_m"]
    speeds = recent_speeds(record)
    for stretch in _stretches(record):
        granted = before = 0.0
        before_ns = stretch[0].stamp_ns
        pace = Pace()
        for pair in stretch:
            lately_mps = speeds.until(pair.stamp_ns)
            per_s = limits["lateral_jerk_mps3"] / _slowest_mps(lately_mps) ** 2
            granted += per_s * (pair.stamp_ns - before_ns) / S
            angle = pair.steer["FRONT_WHEEL_ANGLE_REQUEST"]
            rear = pair.steer.signals.get("REAR_WHEEL_ANGLE_REQUEST", 0.0)
            per_m = (math.tan(angle) - math.tan(rear)) / wheelbase_m
            slack = per_s * (JITTER_NS / S + wire.wheel_hold_s) + wire.wheel_count_rad / wheelbase_m
            most = limits["lateral_accel_mps2"] / _fastest_mps(lately_mps) ** 2
            if abs(before) > most:
                pace.counts_from(math.copysign(most, before), granted, slack)
            if pace.is_broken(per_m, granted, slack):
                yield f"{_at(pair, record)} a swerve at {lately_mps[-1]:.2f} m/s, wheels to {angle:.4f} rad"
            before, before_ns = per_m, pair.stamp_ns


def led_away(wire: Wire, record: Record) -> Iterable[str]:
    """Wheels commanded further away from where they are measured than the profile has it, and led on from there.

    The first command begins where they are. Wheels that are beyond what the speed allows go back, wherever that leads.
    """
    if not wire.measures_wheels:
        return
    limits = wire.profile["limits"]
    begins_rad = limits["while_engaging"]["front_wheel_rate_radps"] * ANSWERED_NS / S + wire.wheel_count_rad
    apart_rad = limits["front_wheel_deviation_rad"] + wire.wheel_count_rad
    speeds, wheels = recent_speeds(record), recent_wheels(wire, record)
    before: float | None = None
    for pair in record.pairs:
        fastest_mps, lately_rad = _fastest_mps(speeds.until(pair.stamp_ns)), wheels.until(pair.stamp_ns)
        if not pair.is_enabled:
            before = None
            continue
        angle = pair.steer["FRONT_WHEEL_ANGLE_REQUEST"]
        if before is None:
            is_away = all(abs(angle - rad) > begins_rad for rad in lately_rad)
        else:
            goes_back = abs(angle) < abs(before) and abs(before) > max_wheel_rad(wire, fastest_mps)
            is_away = not goes_back and all(abs(angle - rad) > max(apart_rad, abs(before - rad)) for rad in lately_rad)
        if is_away:
            yield f"{_at(pair, record)} {angle:.4f} rad, where {lately_rad[-1]:.4f} is measured"
        before = angle


def jerky(wire: Wire, record: Record) -> Iterable[str]:
    """Accelerations that change faster than the profile has it: while it drives both ways, in a stop the brake's rise.

    A stop may drop at once what drives, and what brakes harder than it does.
    """
    drives_mps3, brakes_mps3 = wire.profile["limits"]["accel_rate_mps3"], wire.profile["behavior"]["stop_jerk_mps3"]
    for stretch in _stretches(record):
        last = stretch[0]
        for is_stop, part in _parts(stretch):
            if is_stop:
                first = next((pair for pair in part if pair.drive["ACCEL_REQUEST"]), last)
                braked = abs(last.drive["ACCEL_REQUEST"]) if _pulls_alike(last, first) else 0.0
                values = [braked, *(abs(pair.drive["ACCEL_REQUEST"]) for pair in part)]
                yield from _faster([last, *part], values, brakes_mps3, "m/s³", record, falls_freely=True)
            else:
                values = [pair.drive["ACCEL_REQUEST"] for pair in part]
                yield from _faster(part, values, drives_mps3, "m/s³", record)
            last = part[-1]


def rising(wire: Wire, record: Record) -> Iterable[str]:
    """What drives rises faster than the profile has it; where a speed is commanded, that speed itself."""
    limits = wire.profile["limits"]
    rate, unit = (
        (limits["accel_rate_mps3"], "m/s³") if wire.commands_acceleration else (limits["accel_max_mps2"], "m/s²")
    )
    for stretch in _stretches(record):
        if wire.commands_acceleration:
            ways = _ways(stretch, record)
            values = [max(0.0, way * pair.drive["ACCEL_REQUEST"]) for pair, way in zip(stretch, ways, strict=True)]
        else:
            values = [abs(pair.drive["SPEED_REQUEST"]) for pair in stretch]
        slack = wire.accel_slack_mps2 if wire.commands_acceleration else wire.speed_slack_mps
        yield from _faster(stretch, values, rate, unit, record, falls_freely=True, more=slack)


def rash(wire: Wire, record: Record) -> Iterable[str]:
    """Commands beyond the stricter limits while engaging; harder braking is allowed."""
    limits = wire.profile["limits"]["while_engaging"]
    modes, place, mode = record.of("VEHICLE_STATUS"), 0, -1.0
    speeds = recent_speeds(record)
    autonomous = wire.number("MODE", "AUTONOMOUS")
    for stretch in _stretches(record):
        engaging: list[Pair] = []
        for pair in stretch:
            while place < len(modes) and modes[place].stamp_ns <= pair.stamp_ns:
                mode, place = modes[place]["MODE"], place + 1
            if mode == autonomous:
                break
            engaging.append(pair)
        for pair in engaging if wire.commands_acceleration else ():
            accel = pair.drive["ACCEL_REQUEST"]
            speed = speeds.until(pair.stamp_ns)[-1]
            way = speed if abs(speed) > STANDS_MPS else pair.drive.signals.get("SPEED_REQUEST", 0.0)
            if (
                accel * way > 0.0
                and not pair.is_stop
                and abs(accel) > limits["accel_max_mps2"] + wire.engaging_slack_mps2
            ):
                yield f"{_at(pair, record)} {accel:.3f} m/s² while it engages"
        if not wire.commands_angle:
            continue
        angles = [pair.steer["FRONT_WHEEL_ANGLE_REQUEST"] for pair in engaging]
        rate = limits["front_wheel_rate_radps"]
        yield from _faster(engaging, angles, rate, "rad/s while it engages", record, more=rate * wire.wheel_hold_s)


def recent_speeds(record: Record) -> Recent:
    """The speeds of the samples, m/s."""
    return Recent((sample.stamp_ns, sample.speed_mps) for sample in record.samples)


def recent_wheels(wire: Wire, record: Record) -> Recent:
    """The measured front wheels, rad; 0 where they are not measured. A frame may say that they are not available."""
    if not wire.measures_wheels:
        return Recent(())
    name = "FRONT_WHEEL_ANGLE"
    return Recent((told.stamp_ns, told[name]) for told in record.of(wire.part_of(name)) if name in told.signals)


def _ways(pairs: Sequence[Pair], record: Record) -> list[float]:
    """The direction of travel at each command: 1 or -1.

    At rest the measured sign is noise: a stop belongs to the motion before it, what drives to the motion after it.
    """
    speeds = recent_speeds(record)
    measured_mps = [speeds.until(pair.stamp_ns)[-1] for pair in pairs]
    ways = [math.copysign(1.0, speed_mps) for speed_mps in measured_mps]
    stands = [abs(speed_mps) < STANDS_MPS for speed_mps in measured_mps]
    for place in range(1, len(pairs)):
        if stands[place] and pairs[place].is_stop:
            ways[place] = ways[place - 1]
    for place in reversed(range(len(pairs) - 1)):
        if stands[place] and not pairs[place].is_stop:
            ways[place] = ways[place + 1]
    return ways


def _slowest_mps(speeds: Iterable[float]) -> float:
    return max(LEAST_MPS, min(map(abs, speeds)))


def _fastest_mps(speeds: Iterable[float]) -> float:
    return max(LEAST_MPS, *map(abs, speeds))


def _stretches(record: Record) -> Iterable[list[Pair]]:
    """Stretches of enabled commands without a gap."""
    stretch: list[Pair] = []
    for pair in record.pairs:
        if stretch and (not pair.is_enabled or pair.stamp_ns - stretch[-1].stamp_ns > SILENCE_NS):
            yield stretch
            stretch = []
        if pair.is_enabled:
            stretch.append(pair)
    if stretch:
        yield stretch


def _parts(stretch: Sequence[Pair]) -> Iterable[tuple[bool, list[Pair]]]:
    """Split a stretch into drive and stop."""
    part: list[Pair] = []
    for pair in stretch:
        if part and pair.is_stop != part[-1].is_stop:
            yield part[-1].is_stop, part
            part = []
        part.append(pair)
    yield part[-1].is_stop, part


def _pulls_alike(a: Pair, b: Pair) -> bool:
    return a.drive["ACCEL_REQUEST"] * b.drive["ACCEL_REQUEST"] > 0.0


def _faster(
    pairs: Sequence[Pair],
    values: Sequence[float],
    rate: float,
    unit: str,
    record: Record,
    *,
    falls_freely: bool = False,
    more: float = 0.0,
) -> Iterable[str]:
    """Times at which a value has changed faster than the rate allows, over any interval."""
    slack, pace = rate * JITTER_NS / S + 0.001 + more, Pace(falls_freely=falls_freely)
    for pair, value in zip(pairs, values, strict=True):
        if pace.is_broken(value, rate * (pair.stamp_ns - record.begin_ns) / S, slack):
            yield f"{_at(pair, record)} faster than {rate:g} {unit}, to {value:.3f}"


def _at(pair: Pair, record: Record) -> str:
    return f"{(pair.stamp_ns - record.begin_ns) / S:.3f} s:"
