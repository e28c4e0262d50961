"""Limits of the profile that depend on the speed."""

import math
from collections.abc import Sequence
from itertools import pairwise

from hil_bench.wire import Wire


def interpolate(table: Sequence[Sequence[float]], at: float) -> float:
    """Interpolate linearly between a table's rows; constant outside."""
    if at <= table[0][0]:
        return table[0][1]
    for (x0, y0), (x1, y1) in pairwise(table):
        if at <= x1:
            return y0 + (y1 - y0) * (at - x0) / (x1 - x0)
    return table[-1][1]


def max_wheel_rad(wire: Wire, speed_mps: float) -> float:
    """Maximum angle of the front wheels at a speed above 0, to either side."""
    limits = wire.profile["limits"]
    table = limits.get("front_wheel_angle_by_speed") or [[0.0, limits["front_wheel_angle_rad"]]]
    sideways = limits["lateral_accel_mps2"] * wire.profile["geometry"]["wheelbase_m"] / speed_mps**2
    return min(interpolate(table, speed_mps), math.atan(sideways))


def max_accel_mps2(wire: Wire, speed_mps: float) -> float:
    """Maximum acceleration along the motion at a speed."""
    limits = wire.profile["limits"]
    table: Sequence[Sequence[float]] = limits.get("accel_max_by_speed") or [[0.0, limits["accel_max_mps2"]]]
    return interpolate(table, speed_mps)
