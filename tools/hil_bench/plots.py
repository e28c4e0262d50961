"""What the report draws over time: the vehicle's motion, its commands, their limits and the reference."""

from collections.abc import Callable, Iterable
from itertools import pairwise

from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import AUTONOMOUS

from hil_bench.along_route import follow_route
from hil_bench.by_speed import max_accel_mps2, max_wheel_rad
from hil_bench.expect import Observation
from hil_bench.result import Plot, Series, Strip
from hil_bench.thinning import thin_series
from hil_bench.vehicle import MODES, Instant
from hil_bench.wire import Wire

PLACES = 600
"""At most this many places along the route are sought."""
LEAST_MPS = 0.1
"""Limits below this speed are those at this speed."""
SILENT_S = 0.1
"""Commands further apart than this are not connected by a line."""
SPEED_MPS, ACCEL_MPS2, WHEELS_RAD, LATERAL_M = 0.005, 0.01, 0.0005, 0.003
"""Tolerance of each quantity's curves."""


def draw_plots(wire: Wire, observed: Observation, max_path_error_m: float | None = None) -> list[Plot]:
    """Speed, acceleration, front wheels and lateral error, with the limits at the vehicle's speed."""
    history = observed.history
    driven_s = [observed.at_s(instant.at_ns) for instant in history]
    command_s, pairs = _spaced(observed)

    def vehicle(value: Callable[[Instant], float], tolerance: float) -> Series:
        return thin_series("vehicle", driven_s, [value(instant) for instant in history], tolerance)

    def commanded(part: str, signal: str, tolerance: float) -> list[Series]:
        values = [None if pair is None else getattr(pair, part).signals.get(signal) for pair in pairs]
        return [thin_series("commanded", command_s, values, tolerance)] if any(v is not None for v in values) else []

    def limit(at_speed: Callable[[Wire, float], float], sign: float, tolerance: float) -> Series | None:
        values = [sign * at_speed(wire, max(LEAST_MPS, abs(instant.speed_mps))) for instant in history]
        return thin_series("limit", driven_s, values, tolerance) if values else None

    stride = max(1, len(history) // PLACES)
    few, few_s = history[::stride], driven_s[::stride]
    places = follow_route(observed.route, few)
    is_driven = [instant.mode == AUTONOMOUS for instant in few]
    reference = [place.speed_mps if driven else None for place, driven in zip(places, is_driven, strict=True)]
    return [
        Plot(
            title="Speed",
            unit="m/s",
            series=[
                vehicle(lambda instant: instant.speed_mps, SPEED_MPS),
                thin_series("reference", few_s, reference, SPEED_MPS),
                *([] if wire.commands_acceleration else commanded("drive", "SPEED_REQUEST", SPEED_MPS)),
            ],
        ),
        Plot(
            title="Acceleration",
            unit="m/s²",
            lowest=wire.limits.accel_range_mps2[0],
            highest_at=limit(max_accel_mps2, 1.0, ACCEL_MPS2),
            series=[
                vehicle(lambda instant: instant.accel_mps2, ACCEL_MPS2),
                *commanded("drive", "ACCEL_REQUEST", ACCEL_MPS2),
            ],
        ),
        Plot(
            title="Front wheels",
            unit="rad",
            lowest_at=limit(max_wheel_rad, -1.0, WHEELS_RAD),
            highest_at=limit(max_wheel_rad, 1.0, WHEELS_RAD),
            series=[
                vehicle(lambda instant: instant.wheel_rad, WHEELS_RAD),
                *commanded("steer", "FRONT_WHEEL_ANGLE_REQUEST", WHEELS_RAD),
            ],
        ),
        Plot(
            title="Lateral error",
            unit="m",
            lowest=None if max_path_error_m is None else -max_path_error_m,
            highest=max_path_error_m,
            series=[thin_series("vehicle", few_s, [place.lateral_m for place in places], LATERAL_M)],
        ),
    ]


def draw_strips(wire: Wire, observed: Observation) -> list[Strip]:
    """The vehicle's mode, and what the device's commands say; empty where there were no commands."""
    modes = [(observed.at_s(instant.at_ns), MODES[instant.mode]) for instant in observed.history]
    at_s, pairs = _spaced(observed)

    def of_commands(name: str, value: Callable[[Pair], str]) -> Strip:
        return _strip(name, zip(at_s, ("" if pair is None else value(pair) for pair in pairs), strict=True))

    return [
        _strip("MODE", modes),
        of_commands("ENABLE", lambda pair: f"{pair.is_enabled:d}"),
        of_commands("SAFE_STOP", lambda pair: f"{pair.is_stop:d}"),
        *([of_commands("REASON", lambda pair: pair.reason)] if wire.tells_reasons else []),
    ]


def _spaced(observed: Observation) -> tuple[list[float], list[Pair | None]]:
    """The commands and their times, with a None where the device was silent."""
    at_s: list[float] = []
    pairs: list[Pair | None] = []
    for before, pair in pairwise([None, *observed.pairs]):
        now_s = observed.at_s(pair.stamp_ns) if pair else 0.0
        if before is not None and now_s - at_s[-1] > SILENT_S:
            at_s.append(at_s[-1] + SILENT_S)
            pairs.append(None)
        at_s.append(now_s)
        pairs.append(pair)
    return at_s, pairs


def _strip(name: str, values: Iterable[tuple[float, str]]) -> Strip:
    """Only the changes, and the end."""
    found: list[tuple[float, str]] = []
    last_s = 0.0
    for last_s, value in values:
        if not found or found[-1][1] != value:
            found.append((round(last_s, 3), value))
    if found and found[-1][1]:
        found.append((round(last_s, 3), ""))
    return Strip(name=name, at_s=[at_s for at_s, _ in found], values=[value for _, value in found])
