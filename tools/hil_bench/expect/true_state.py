"""Quantities of the vehicle's true state, as the plant has them."""

import math
from collections.abc import Callable
from itertools import pairwise

from hil_bench.expect.base import Observation
from hil_bench.vehicle import Instant

Quantity = Callable[[Observation, Instant], float]


def instant_before(observed: Observation, stamp_ns: int) -> Instant | None:
    """The vehicle's true state in the sample that a command at this time answers."""
    before = [instant for instant in observed.history if instant.at_ns <= stamp_ns]
    return before[-1] if before else None


def distance_m(observed: Observation, instant: Instant) -> float:
    """From the route."""
    route = observed.route
    points = list(zip(route.x_m, route.y_m, strict=True))
    return min(_segment_distance_m(instant, a, b) for a, b in pairwise(points))


def heading_error_rad(observed: Observation, instant: Instant) -> float:
    """From the heading of the route's nearest point, without sign."""
    route = observed.route
    nearest = min(
        range(len(route.x_m)), key=lambda i: math.hypot(route.x_m[i] - instant.x_m, route.y_m[i] - instant.y_m)
    )
    return abs(math.remainder(instant.heading_rad - route.heading_rad[nearest], math.tau))


def speed_mps(_observed: Observation, instant: Instant) -> float:
    """Without sign."""
    return abs(instant.speed_mps)


def _segment_distance_m(instant: Instant, a: tuple[float, float], b: tuple[float, float]) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    px, py = instant.x_m - a[0], instant.y_m - a[1]
    square = dx * dx + dy * dy
    share = min(1.0, max(0.0, (px * dx + py * dy) / square)) if square else 0.0
    return math.hypot(px - share * dx, py - share * dy)
