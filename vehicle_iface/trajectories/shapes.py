"""Built-in routes, by name.

A shape is first drawn as a dense curve, a point about each 2 mm, then cut into points of equal distance; the
speeds follow from the curvature. Straights and turns are integrated from their curvature, weaves are graphs
y(x), loops are parametric.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from vehicle_iface.errors import ConfigError
from vehicle_iface.trajectories import speed
from vehicle_iface.trajectories.route import Route, RouteConfig
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.value import Value

_DENSE_M = 0.01
_MAX_DENSE = 2_000_000

ISO_3888_1_SECTIONS_M = (15.0, 30.0, 25.0, 25.0, 15.0, 15.0)
"""Entry lane, transition, side lane, transition back, two sections of exit lane: 125 m (ISO 3888-1)."""
ISO_3888_1_OFFSET_M = 3.5
"""Offset of the side lane from the entry lane, between their right-hand edges."""


class _Curve(Value, frozen=True, kw_only=True, eq=False):
    """A densely drawn path; all arrays (m,)."""

    s_m: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    """Heading of the body, continuous."""
    curvature_per_m: FloatArray
    """Curvature by the wheels: change of heading per metre forward."""


def line(config: RouteConfig) -> Route:
    """Draw a straight line along +x."""
    return _build_open_route("line", config, [_straight(config.length_m)])


def circle(config: RouteConfig) -> Route:
    """Draw a circle to the left."""
    angle = _sample_densely(math.tau * config.radius_m) / config.radius_m
    curve = _Curve(
        s_m=angle * config.radius_m,
        x_m=config.radius_m * np.cos(angle),
        y_m=config.radius_m * np.sin(angle),
        heading_rad=angle + math.pi / 2.0,
        curvature_per_m=np.full_like(angle, 1.0 / config.radius_m),
    )
    return _build_closed_route("circle", config, curve)


def figure8(config: RouteConfig) -> Route:
    """Draw Bernoulli's lemniscate from its crossing on: one loop to the left first, then the other to the right.

    x = a·cos t / (1 + sin²t), y = x·sin t with a the half width; the curvature is smooth and largest, 3/a, at
    the far ends of the loops.
    """
    a = config.half_width_m
    t = np.linspace(-0.5 * math.pi, 1.5 * math.pi, len(_sample_densely(6.0 * a)))
    sin, cos = np.sin(t), np.cos(t)
    square = 1.0 + sin**2
    root = np.sqrt(square)
    x = a * cos / square
    dx_dt = -a * sin * (2.0 + cos**2) / square**2
    dy_dt = a * (1.0 - 3.0 * sin**2) / square**2
    curve = _Curve(
        s_m=_integrate(a / root, t),
        x_m=x,
        y_m=x * sin,
        heading_rad=np.unwrap(np.arctan2(dy_dt, dx_dt)),
        curvature_per_m=3.0 * cos / (a * root),
    )
    return _build_closed_route("figure8", config, curve)


def slalom(config: RouteConfig) -> Route:
    """Draw a slalom round cones in a row, passed left and right in turn at 0.6 m from the body."""
    cones_m = config.cone_spacing_m
    weave_m = (config.cone_count - 1) * cones_m
    # One spacing to swing out before the first cone, one to swing in after the last, straight ends around.
    x = _sample_densely(weave_m + 4.0 * cones_m) - 2.0 * cones_m
    amplitude_m = 0.5 * config.vehicle_width_m + 0.6
    swing = _smooth_step(x / cones_m + 1.0) * _smooth_step((weave_m - x) / cones_m + 1.0)
    curve = _build_graph(x - 0.5 * weave_m, amplitude_m * swing * np.cos(math.pi * x / cones_m))
    return _build_open_route("slalom", config, [curve])


def double_lane_change(config: RouteConfig) -> Route:
    """Draw the track of ISO 3888-1 along the middle of its lanes: to the left and back, y = 0 on the entry lane.

    `lane_widths_m` grow with the vehicle's width; entry and exit lanes have their right-hand edges in line.
    """
    entry, _, exit_ = widths = lane_widths_m(config.vehicle_width_m)
    side_y_m = ISO_3888_1_OFFSET_M + 0.5 * (widths[1] - entry)
    exit_y_m = 0.5 * (exit_ - entry)
    ends_m = np.cumsum(ISO_3888_1_SECTIONS_M)
    x = _sample_densely(float(ends_m[-1]))
    over = _smooth_step((x - ends_m[0]) / ISO_3888_1_SECTIONS_M[1])
    back = _smooth_step((x - ends_m[2]) / ISO_3888_1_SECTIONS_M[3])
    curve = _build_graph(x - 0.5 * ends_m[-1], side_y_m * over + (exit_y_m - side_y_m) * back)
    return _build_open_route("double_lane_change", config, [curve])


def lane_widths_m(vehicle_width_m: float) -> tuple[float, float, float]:
    """Return the widths of entry, side and exit lane in m (ISO 3888-1)."""
    return 1.1 * vehicle_width_m + 0.25, 1.2 * vehicle_width_m + 0.25, 1.3 * vehicle_width_m + 0.25


def stop_and_go(config: RouteConfig) -> Route:
    """Draw a straight line with a stop and dwell at each stop spacing."""
    count = max(1, round(config.length_m / config.stop_spacing_m))
    return _build_open_route("stop_and_go", config, [_straight(config.stop_spacing_m)] * count)


def u_turn(config: RouteConfig) -> Route:
    """Draw 15 m ahead, a U-turn to the left and the way back; the wheels turn in and out over 5 m each."""
    ramp_m, straight_m = 5.0, 15.0
    arc_m = _arc_length_m(math.pi, config.turn_radius_m, ramp_m)
    s = _sample_densely(2.0 * straight_m + arc_m)
    curvature = _turn(s - straight_m, arc_m, ramp_m) / config.turn_radius_m
    return _build_open_route("u_turn", config, [_integrate_path(s, curvature, direction=1.0)])


def three_point_turn(config: RouteConfig) -> Route:
    """Draw a three-point turn: ahead to the left, back to the right, ahead to the left, a third each.

    The wheels are straight at each change of direction, so nothing has to turn at standstill.
    """
    ramp_m, straight_m = 3.0, 6.0
    arc_m = _arc_length_m(math.pi / 3.0, config.three_point_radius_m, ramp_m)
    into, back, out = _sample_densely(straight_m + arc_m), _sample_densely(arc_m), _sample_densely(arc_m + straight_m)
    turn = 1.0 / config.three_point_radius_m
    legs = [
        _integrate_path(into, turn * _turn(into - straight_m, arc_m, ramp_m), direction=1.0),
        _integrate_path(back, -turn * _turn(back, arc_m, ramp_m), direction=-1.0),
        _integrate_path(out, turn * _turn(out, arc_m, ramp_m), direction=1.0),
    ]
    slow = min(config.speed_mps, config.manoeuvring_speed_mps)
    return _build_open_route("three_point_turn", config, legs, (1.0, -1.0, 1.0), slow)


ROUTES: Mapping[str, Callable[[RouteConfig], Route]] = MappingProxyType(
    {
        build.__name__: build
        for build in (
            line,
            circle,
            figure8,
            slalom,
            double_lane_change,
            stop_and_go,
            u_turn,
            three_point_turn,
        )
    }
)
"""The routes of `make_route`, by name."""


def make_route(name: str, config: RouteConfig | None = None) -> Route:
    """Make the route of this name, beginning at the origin along +x. Raises `ConfigError` for an unknown name."""
    build = ROUTES.get(name)
    if build is None:
        raise ConfigError(f"unknown route {name!r}: must be one of {', '.join(sorted(ROUTES))}")
    return build(config or RouteConfig())


def _sample_densely(length_m: float) -> FloatArray:
    """Return (m,) distances from 0 to the length, about 2 mm apart; farther apart on lengths of kilometres."""
    return np.linspace(0.0, length_m, min(math.ceil(length_m / _DENSE_M), _MAX_DENSE) + 1)


def _integrate(rate: FloatArray, over: FloatArray) -> FloatArray:
    """Return (m,) the running integral by trapezoids, from 0."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(over)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _smooth_step(t: FloatArray) -> FloatArray:
    """Rise from 0 at t ≤ 0 to 1 at t ≥ 1 by a quintic, flat and without curvature at both ends."""
    t = np.clip(t, 0.0, 1.0)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def _turn(s: FloatArray, arc_m: float, ramp_m: float) -> FloatArray:
    """Return the share of full curvature along an arc from s = 0 that turns in and out over `ramp_m`; 0 outside."""
    return _smooth_step(s / ramp_m) * _smooth_step((arc_m - s) / ramp_m)


def _arc_length_m(angle_rad: float, radius_m: float, ramp_m: float) -> float:
    """Return the length of an arc that turns by the angle; a ramp turns half as much as at full curvature."""
    arc_m = angle_rad * radius_m + ramp_m
    if arc_m < 2.0 * ramp_m:
        raise ConfigError(f"turn radius {radius_m} m: too tight, must be at least {ramp_m / angle_rad:.2f} m")
    return arc_m


def _straight(length_m: float) -> _Curve:
    s = _sample_densely(length_m)
    return _integrate_path(s, np.zeros_like(s), direction=1.0)


def _integrate_path(s: FloatArray, curvature: FloatArray, direction: float) -> _Curve:
    """Integrate the path with this curvature from the origin along +x; direction −1 reverses."""
    heading = _integrate(direction * curvature, s)
    return _Curve(
        s_m=s,
        x_m=_integrate(direction * np.cos(heading), s),
        y_m=_integrate(direction * np.sin(heading), s),
        heading_rad=heading,
        curvature_per_m=curvature,
    )


def _build_graph(x: FloatArray, y: FloatArray) -> _Curve:
    """Return the path along y(x) in the direction of +x."""
    slope = np.gradient(y, x, edge_order=2)
    stretch = np.sqrt(1.0 + slope**2)
    return _Curve(
        s_m=_integrate(stretch, x),
        x_m=x,
        y_m=y,
        heading_rad=np.arctan(slope),
        curvature_per_m=np.gradient(slope, x, edge_order=2) / stretch**3,
    )


def _resample(curve: _Curve, spacing_m: float) -> _Curve:
    """Sample the curve at equal distances, including both ends."""
    length_m = float(curve.s_m[-1])
    s = np.linspace(0.0, length_m, max(2, round(length_m / spacing_m)) + 1)
    return _Curve(
        s_m=s,
        x_m=np.interp(s, curve.s_m, curve.x_m),
        y_m=np.interp(s, curve.s_m, curve.y_m),
        heading_rad=np.interp(s, curve.s_m, curve.heading_rad),
        curvature_per_m=np.interp(s, curve.s_m, curve.curvature_per_m),
    )


def _append(before: _Curve, leg: _Curve) -> _Curve:
    """Append `leg`, moved and turned to begin where `before` ends; keep their common point once."""
    turn = before.heading_rad[-1] - leg.heading_rad[0]
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = leg.x_m - leg.x_m[0], leg.y_m - leg.y_m[0]
    return _Curve(
        s_m=np.concatenate([before.s_m, before.s_m[-1] + leg.s_m[1:]]),
        x_m=np.concatenate([before.x_m, before.x_m[-1] + (cos * x - sin * y)[1:]]),
        y_m=np.concatenate([before.y_m, before.y_m[-1] + (sin * x + cos * y)[1:]]),
        heading_rad=np.concatenate([before.heading_rad, (leg.heading_rad + turn)[1:]]),
        curvature_per_m=np.concatenate([before.curvature_per_m, leg.curvature_per_m[1:]]),
    )


def _build_open_route(
    name: str,
    config: RouteConfig,
    legs: list[_Curve],
    directions: tuple[float, ...] = (),
    speed_mps: float | None = None,
) -> Route:
    """Build a route of legs with a stop after each; `directions` are ±1 for each leg, all +1 when empty."""
    cut = [_resample(leg, config.point_spacing_m) for leg in legs]
    path = cut[0]
    for leg in cut[1:]:
        path = _append(path, leg)
    stops = np.concatenate([[0], np.cumsum([len(leg.s_m) - 1 for leg in cut])])
    limit_mps = _limit_mps(config, path, speed_mps)
    limit_mps[stops] = 0.0
    dwell_s = np.zeros_like(path.s_m)
    dwell_s[stops[1:-1]] = config.dwell_s
    direction = np.repeat(directions or (1.0,) * len(cut), np.diff(stops))
    reached_mps = speed.reachable_mps(path.s_m, limit_mps, accel_mps2=config.accel_mps2, decel_mps2=config.decel_mps2)
    signed_mps = np.append(direction, 1.0) * reached_mps
    return _build_route(name, config, path, signed_mps, dwell_s, closed=False)


def _build_closed_route(name: str, config: RouteConfig, curve: _Curve) -> Route:
    """Build a route of laps, which passes its beginning at speed."""
    path = _resample(curve, config.point_spacing_m)
    speed_mps = speed.reachable_cyclic_mps(
        path.s_m, _limit_mps(config, path), accel_mps2=config.accel_mps2, decel_mps2=config.decel_mps2
    )
    return _build_route(name, config, path, speed_mps, np.zeros_like(path.s_m), closed=True)


def _limit_mps(config: RouteConfig, path: _Curve, speed_mps: float | None = None) -> FloatArray:
    return speed.lateral_limit_mps(
        path.curvature_per_m,
        speed_mps=speed_mps or config.speed_mps,
        lateral_accel_mps2=config.lateral_accel_mps2,
    )


def _build_route(
    name: str,
    config: RouteConfig,
    path: _Curve,
    speed_mps: FloatArray,
    dwell_s: FloatArray,
    *,
    closed: bool,
) -> Route:
    """Build the route, moved and turned to begin at the origin along +x: the default pose of a vehicle."""
    heading_rad = path.heading_rad - path.heading_rad[0]
    x_m, y_m = path.x_m - path.x_m[0], path.y_m - path.y_m[0]
    cos, sin = math.cos(path.heading_rad[0]), math.sin(path.heading_rad[0])
    return Route(
        name=name,
        config=config,
        closed=closed,
        s_m=path.s_m,
        x_m=cos * x_m + sin * y_m,
        y_m=cos * y_m - sin * x_m,
        heading_rad=heading_rad,
        curvature_per_m=path.curvature_per_m,
        speed_mps=speed_mps,
        dwell_s=dwell_s,
    )
