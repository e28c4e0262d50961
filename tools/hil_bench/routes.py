"""Where the cases drive: trajectories made of straights and arcs, written as the CSV that a device loads.

The times are generous: a controller that tracks well reaches the end in space before it reaches it in time. The
exception is a hurried route, whose time ends first.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

SPACING_M = 0.25
GENTLE_MPS2 = 1.0
SLACK = 2.0
"""Factor on the time that the speeds take; `BEGINNING_S` is added."""
BEGINNING_S = 6.0
DWELL_S = 1.0

Segment = tuple[float, float]
"""Length, m, negative in reverse; curvature, 1/m, positive to the left when driving forward."""


@dataclass(frozen=True, slots=True)
class Route:
    """Points of a trajectory: positions of the rear axle's centre, headings of the body, signed speeds."""

    name: str
    time_s: Sequence[float]
    x_m: Sequence[float]
    y_m: Sequence[float]
    heading_rad: Sequence[float]
    speed_mps: Sequence[float]
    is_hurried: bool = False
    """Its time ends long before a vehicle can reach its end in space."""

    @property
    def is_straight(self) -> bool:
        """True if it leads straight on."""
        return len(set(self.heading_rad)) == 1

    def length_m(self) -> float:
        """The way along it, backwards as well as forwards."""
        steps = itertools.pairwise(zip(self.x_m, self.y_m, strict=True))
        return sum(math.dist(a, b) for a, b in steps)

    def shortest_stretch_m(self) -> float:
        """Shortest distance between two stops, the start and the end included."""
        steps = itertools.pairwise(zip(self.x_m, self.y_m, strict=True))
        along_m = [0.0, *itertools.accumulate(math.dist(a, b) for a, b in steps)]
        inner = zip(along_m[1:-1], self.speed_mps[1:-1], strict=True)
        stops_m = [0.0, *(done_m for done_m, v in inner if v == 0.0), along_m[-1]]
        return min(b - a for a, b in itertools.pairwise(stops_m) if b > a)

    def dwells(self) -> list[int]:
        """The last point of each dwell: of points in a row at one place, with speed 0."""
        places = list(zip(self.x_m, self.y_m, self.speed_mps, strict=True))
        stays = [i for i, (a, b) in enumerate(itertools.pairwise(places), 1) if a == b and b[2] == 0.0]
        return [i for i in stays if i + 1 not in stays]

    def write(self, path: Path, frame_id: str = "map") -> Path:
        """Write the CSV file; returns its path."""
        rows = zip(self.time_s, self.x_m, self.y_m, self.heading_rad, self.speed_mps, strict=True)
        lines = [f"# frame_id: {frame_id}", "time_s,x_m,y_m,heading_rad,speed_mps"]
        lines += [f"{t:.3f},{x:.4f},{y:.4f},{heading:.5f},{v:.3f}" for t, x, y, heading, v in rows]
        path.write_text("\n".join(lines) + "\n")
        return path


def scale(one: Route, *, length: float, speed: float) -> Route:
    """The same route for another vehicle, smaller and slower: with at least as much time, unless it is hurried."""
    slower = length / speed if one.is_hurried else max(1.0, length / speed)
    return replace(
        one,
        time_s=[t * slower for t in one.time_s],
        x_m=[x * length for x in one.x_m],
        y_m=[y * length for y in one.y_m],
        speed_mps=[v * speed for v in one.speed_mps],
    )


def route(
    name: str,
    segments: Sequence[Segment],
    speed_mps: float,
    *,
    slack: float = SLACK,
    stops_at_end: bool = True,
    spacing_m: float = SPACING_M,
) -> Route:
    """A route along segments: from standstill, with a gentle stop at every change of direction and at the end.

    `slack`: factor on the time that the speeds take; below 1 the route is hurried.
    """
    x, y, heading = 0.0, 0.0, 0.0
    points: list[tuple[float, float, float, float]] = []
    runs: list[list[int]] = []
    for length_m, curvature in segments:
        way = math.copysign(1.0, length_m)
        if not runs or points[runs[-1][-1]][3] != way:
            if points:
                points[-1] = (x, y, heading, points[-1][3])
            runs.append([len(points)])
            points.append((x, y, heading, way))
        steps = max(1, round(abs(length_m) / spacing_m))
        step = length_m / steps
        for _ in range(steps):
            turn = curvature * step
            x += step * math.cos(heading + turn / 2.0)
            y += step * math.sin(heading + turn / 2.0)
            heading = math.remainder(heading + turn, math.tau)
            runs[-1].append(len(points))
            points.append((x, y, heading, way))
    speeds = [0.0] * len(points)
    for number, run in enumerate(runs):
        is_last = number == len(runs) - 1
        along = [0.0]
        for before, here in itertools.pairwise(run):
            along.append(
                along[-1] + math.hypot(points[here][0] - points[before][0], points[here][1] - points[before][1])
            )
        for index, done_m in zip(run, along, strict=True):
            left_m = along[-1] - done_m if stops_at_end or not is_last else math.inf
            top = min(speed_mps, math.sqrt(2 * GENTLE_MPS2 * max(done_m, 0.3)), math.sqrt(2 * GENTLE_MPS2 * left_m))
            speeds[index] = math.copysign(top, points[index][3])
    times = [0.0]
    for before, here in itertools.pairwise(range(len(points))):
        way_m = math.hypot(points[here][0] - points[before][0], points[here][1] - points[before][1])
        mean = max(0.2, (abs(speeds[before]) + abs(speeds[here])) / 2.0)
        times.append(times[-1] + max(0.001, slack * way_m / mean))
    is_hurried = slack < 1.0
    late_s = 0.0 if is_hurried else BEGINNING_S
    times = [t + late_s * min(1.0, i / 10) for i, t in enumerate(times)]
    xs, ys, headings, _ = zip(*points, strict=True)
    return Route(name, times, xs, ys, headings, speeds, is_hurried)


def lane_change(offset_m: float, length_m: float) -> list[Segment]:
    """Two opposite arcs that lead `offset_m` to the left over about `length_m` (small angles)."""
    curvature = 4.0 * offset_m / length_m**2
    return [(length_m / 2.0, curvature), (length_m / 2.0, -curvature)]


def straight(length_m: float = 400.0, speed_mps: float = 5.0) -> Route:
    """Along +x."""
    return route(f"straight-{length_m:.0f}-m-at-{speed_mps:.0f}", [(length_m, 0.0)], speed_mps)


def brisk() -> Route:
    """Along +x, from the beginning with an acceleration of 2.6 m/s²."""
    return scale(route("brisk", [(40.0, 0.0)], 5.0), length=1.0, speed=1.6)


def step(speed_mps: float = 5.0) -> Route:
    """A lane's width to the left within 12 m, then straight on."""
    return route("step", [(20.0, 0.0), *lane_change(2.5, 16.0), (30.0, 0.0)], speed_mps)


def slalom(speed_mps: float = 5.0) -> Route:
    """Four gates, alternately."""
    bends = [(18.0, 0.04), (18.0, -0.04)]
    return route("slalom", [(15.0, 0.0), (9.0, 0.04), *bends[1:], *bends, (9.0, -0.04), (20.0, 0.0)], speed_mps)


def double_lane_change(speed_mps: float = 8.0) -> Route:
    """Around an obstacle in the lane and back, in the manner of ISO 3888-1, at a car park's speed."""
    swerve, back = lane_change(3.0, 30.0), lane_change(-3.0, 25.0)
    return route("double-lane-change", [(25.0, 0.0), *swerve, (20.0, 0.0), *back, (30.0, 0.0)], speed_mps)


def stop_and_go(speed_mps: float = 4.0) -> Route:
    """Three stretches, with a dwell between them: two points at one place, `DWELL_S` apart, with speed 0."""
    one = route("one", [(16.0, 0.0)], speed_mps)
    times, xs, speeds = list(one.time_s), list(one.x_m), list(one.speed_mps)
    for _ in range(2):
        begin_s, begin_m = times[-1] + DWELL_S, xs[-1]
        times += [begin_s + t - BEGINNING_S * min(1.0, i / 10) for i, t in enumerate(one.time_s)]
        xs += [begin_m + x for x in one.x_m]
        speeds += [0.0, *one.speed_mps[1:]]
    nothing = [0.0] * len(xs)
    return Route("stop-and-go", times, xs, nothing, nothing, speeds)


def reverse_bay() -> Route:
    """Forward past a bay, then in reverse into it."""
    quarter_m = math.pi / 2.0 * 7.0
    return route("reverse-bay", [(16.0, 0.0), (-quarter_m, -1.0 / 7.0), (-4.0, 0.0)], 2.0)


def u_turn(speed_mps: float = 3.0) -> Route:
    """A half circle of 7 m radius."""
    return route("u-turn", [(5.0, 0.0), (math.pi * 7.0, 1.0 / 7.0), (6.0, 0.0)], speed_mps)


def bend(speed_mps: float = 7.0) -> Route:
    """A wide bend of 25 m radius."""
    return route("bend", [(110.0, 1.0 / 25.0)], speed_mps)


def circle(speed_mps: float = 4.0) -> Route:
    """A full circle of 12 m radius."""
    return route("circle", [(6.0, 0.0), (math.tau * 12.0, 1.0 / 12.0), (6.0, 0.0)], speed_mps)


def figure_eight(speed_mps: float = 4.0) -> Route:
    """A circle to the left, then one to the right."""
    round_m = math.tau * 12.0
    return route("figure-eight", [(5.0, 0.0), (round_m, 1 / 12.0), (round_m, -1 / 12.0), (5.0, 0.0)], speed_mps)
