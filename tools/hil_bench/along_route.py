"""Where a vehicle is along its route: the reference speed there, and the lateral error."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hil_bench.routes import Route
from hil_bench.vehicle import Instant

BEHIND, AHEAD = 8, 40
"""Points around the last place in which the next one is sought, so that a crossing misleads nobody."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """The nearest place of a route."""

    lateral_m: float
    """Of the vehicle, positive to the left of the route."""
    speed_mps: float
    """Signed, as the route has it."""


def follow_route(route: Route, instants: Iterable[Instant]) -> list[Place]:
    """The place of each instant, in order of time."""
    found: list[Place] = []
    last = len(route.x_m) - 2
    candidates: Sequence[int] = range(last + 1)
    for instant in instants:
        place = min(candidates, key=lambda i: abs(_offset(route, i, instant)[0]) + _detour(route, i, instant, found))
        lateral_m, share = _offset(route, place, instant)
        before, after = route.speed_mps[place], route.speed_mps[place + 1]
        found.append(Place(lateral_m=lateral_m, speed_mps=before + share * (after - before)))
        candidates = range(max(0, place - BEHIND), min(last, place + AHEAD) + 1)
    return found


def _offset(route: Route, i: int, instant: Instant) -> tuple[float, float]:
    """Distance from segment i, positive to its left, and the share of the segment at which it is nearest."""
    dx, dy = route.x_m[i + 1] - route.x_m[i], route.y_m[i + 1] - route.y_m[i]
    px, py = instant.x_m - route.x_m[i], instant.y_m - route.y_m[i]
    square = dx * dx + dy * dy
    share = min(1.0, max(0.0, (px * dx + py * dy) / square)) if square else 0.0
    heading_rad = route.heading_rad[i]
    is_left = math.cos(heading_rad) * py - math.sin(heading_rad) * px >= 0.0
    return math.copysign(math.hypot(px - share * dx, py - share * dy), 1.0 if is_left else -1.0), share


def _detour(route: Route, i: int, instant: Instant, found: Sequence[Place]) -> float:
    """Of several places the first one is that whose heading fits."""
    return 0.0 if found else abs(math.remainder(route.heading_rad[i] - instant.heading_rad, math.tau))
