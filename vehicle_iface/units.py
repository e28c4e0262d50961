"""Conversions of units; inside the program everything is SI."""

import math

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000


def ns_from_s(duration_s: float) -> int:
    """Seconds as integer nanoseconds, rounded to the nearest."""
    return round(duration_s * NS_PER_S)


def s_from_ns(duration_ns: int) -> float:
    """Integer nanoseconds as seconds."""
    return duration_ns / NS_PER_S


def wrapped_rad(angle_rad: float) -> float:
    """The same direction in [−π, π]; exact for angles that are already there."""
    if -math.pi <= angle_rad <= math.pi:
        return angle_rad
    return math.remainder(angle_rad, math.tau)
