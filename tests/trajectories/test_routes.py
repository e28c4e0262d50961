"""Every route: its geometry agrees with itself, its speeds keep the limits, its times agree with its speeds."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.route_names import ROUTE_NAMES
from vehicle_iface.trajectories import ROUTES, Route, RouteConfig, make_route
from vehicle_iface.trajectories.shapes import ISO_3888_1_SECTIONS_M, lane_widths_m
from vehicle_iface.trajectory import FloatArray

CONFIG = RouteConfig()
FAST = RouteConfig(speed_mps=12.0, lateral_accel_mps2=3.0, accel_mps2=2.0, decel_mps2=1.0, point_spacing_m=0.5)
CLOSED = ("circle", "figure8")

every_route = pytest.mark.parametrize("name", sorted(ROUTES))
every_config = pytest.mark.parametrize("config", [CONFIG, FAST], ids=["usual", "fast"])


def directions(route: Route) -> FloatArray:
    """(n − 1,) of the stretches between points."""
    return np.concatenate([np.full(last - first, direction) for first, last, direction in route.legs()])


@every_route
@every_config
def test_points_are_evenly_spaced_and_their_distances_add_up(name: str, config: RouteConfig) -> None:
    route = make_route(name, config)
    spacing = np.diff(route.s_m)
    chords = np.hypot(np.diff(route.x_m), np.diff(route.y_m))
    assert np.all(np.abs(spacing / config.point_spacing_m - 1.0) < 0.05)
    # A chord is shorter than its arc by κ²·s³/24.
    assert chords == pytest.approx(spacing, abs=1e-3 * config.point_spacing_m)
    assert route.length_m == route.s_m[-1]


@every_route
@every_config
def test_headings_point_along_the_path_and_backwards_when_reversing(name: str, config: RouteConfig) -> None:
    route = make_route(name, config)
    course = np.arctan2(np.diff(route.y_m), np.diff(route.x_m))
    middle = 0.5 * (route.heading_rad[1:] + route.heading_rad[:-1])
    along = np.cos(course - middle) * directions(route)
    assert np.all(along > math.cos(0.05 * config.point_spacing_m**2))
    assert np.all(np.abs(np.diff(route.heading_rad)) < 0.2)


@every_route
@every_config
def test_curvature_is_the_turn_per_metre_forward(name: str, config: RouteConfig) -> None:
    route = make_route(name, config)
    turn = np.diff(route.heading_rad) / np.diff(route.s_m) * directions(route)
    middle = 0.5 * (route.curvature_per_m[1:] + route.curvature_per_m[:-1])
    assert turn == pytest.approx(middle, abs=0.05 * config.point_spacing_m**2)


@every_route
def test_curvature_is_smooth_so_that_wheels_can_follow(name: str) -> None:
    route = make_route(name)
    wheel_rad = route.front_wheel_angle_rad
    speeds = np.abs(route.speed_mps)
    rates = np.abs(np.diff(wheel_rad)) / np.diff(route.s_m) * np.maximum(speeds[1:], speeds[:-1])
    assert rates.max() < 0.6
    assert np.abs(wheel_rad).max() < 0.6
    assert wheel_rad == pytest.approx(np.arctan(2.7 * route.curvature_per_m))


@every_route
@every_config
def test_speeds_keep_the_limits_everywhere(name: str, config: RouteConfig) -> None:
    route = make_route(name, config)
    accel = np.diff(route.speed_mps**2) / (2.0 * np.diff(route.s_m))
    assert np.all(np.abs(route.speed_mps) <= config.speed_mps)
    assert np.all(route.speed_mps**2 * np.abs(route.curvature_per_m) <= config.lateral_accel_mps2 + 1e-9)
    assert accel.max() <= config.accel_mps2 + 1e-9
    assert accel.min() >= -config.decel_mps2 - 1e-9


@every_route
def test_only_a_closed_route_ends_where_it_begins_and_at_speed(name: str) -> None:
    route = make_route(name)
    gap = math.hypot(route.x_m[-1] - route.x_m[0], route.y_m[-1] - route.y_m[0])
    assert route.closed == (name in CLOSED)
    if route.closed:
        assert gap < 1e-9
        assert math.remainder(route.heading_rad[-1] - route.heading_rad[0], math.tau) == pytest.approx(0.0, abs=1e-9)
        assert route.speed_mps[-1] == pytest.approx(route.speed_mps[0])
        assert np.all(route.speed_mps > 0.0)
    else:
        assert gap > 1.0 or name == "three_point_turn"  # which leaves where it came from
        assert route.speed_mps[0] == route.speed_mps[-1] == 0.0


@every_route
@every_config
def test_a_route_begins_at_the_origin_along_x(name: str, config: RouteConfig) -> None:
    route = make_route(name, config)
    assert route.start == (0.0, 0.0, 0.0)
    assert math.atan2(route.y_m[1], route.x_m[1]) == pytest.approx(0.0, abs=0.02)


@every_route
@every_config
def test_as_a_trajectory_times_speeds_and_places_agree_exactly(name: str, config: RouteConfig) -> None:
    route = make_route(name, config)
    trajectory = route.to_trajectory(stamp_ns=11, frame_id="odom")
    dt_s = np.diff(trajectory.time_from_start_ns) * 1e-9
    v0, v1 = trajectory.speed_mps[:-1], trajectory.speed_mps[1:]
    moved = np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m)) > 0.0
    driven = np.sum(np.abs(v0 + v1) * 0.5 * dt_s)
    assert (trajectory.stamp_ns, trajectory.frame_id, trajectory.time_from_start_ns[0]) == (11, "odom", 0)
    assert driven == pytest.approx(route.length_m, abs=1e-5)
    assert np.abs(v0 + v1)[moved] * 0.5 * dt_s[moved] == pytest.approx(np.diff(route.s_m), abs=1e-7)
    assert (v1 - v0)[moved] == pytest.approx(trajectory.accel_mps2[:-1][moved] * dt_s[moved], abs=1e-6)
    assert np.all(dt_s > 0.0)
    assert v0[0] == v1[-1] == 0.0


@every_route
@every_config
def test_as_a_trajectory_the_limits_hold_and_turns_agree_with_speeds(name: str, config: RouteConfig) -> None:
    route = make_route(name, config)
    trajectory = route.to_trajectory()
    forward = trajectory.accel_mps2[trajectory.speed_mps > 0.0]
    assert forward.max() <= config.accel_mps2 + 1e-9
    assert forward.min() >= -config.decel_mps2 - 1e-9
    lateral = np.abs(trajectory.yaw_rate_radps * trajectory.speed_mps)
    assert lateral.max() <= config.lateral_accel_mps2 + 1e-9
    curvature = np.tan(trajectory.front_wheel_angle_rad) / config.wheelbase_m
    assert trajectory.yaw_rate_radps == pytest.approx(curvature * trajectory.speed_mps)


def test_stops_are_waited_at_for_the_dwell_time() -> None:
    trajectory = make_route("stop_and_go", replace(CONFIG, dwell_s=3.25)).to_trajectory()
    dt_s = np.diff(trajectory.time_from_start_ns) * 1e-9
    waits = (trajectory.speed_mps[:-1] == 0.0) & (trajectory.speed_mps[1:] == 0.0)
    assert dt_s[waits].tolist() == pytest.approx([3.25, 3.25])
    assert trajectory.accel_mps2[:-1][waits].tolist() == [0.0, 0.0]
    assert np.diff(trajectory.x_m)[waits].tolist() == [0.0, 0.0]


def test_without_dwell_no_point_is_doubled() -> None:
    route = make_route("stop_and_go", replace(CONFIG, dwell_s=0.0))
    assert len(route.to_trajectory()) == len(route)


def test_the_figure_of_eight_is_drivable_and_takes_half_a_minute() -> None:
    for speed_mps in (5.0, 6.0):
        route = make_route("figure8", replace(CONFIG, speed_mps=speed_mps))
        lap_s = float(np.sum(2.0 * np.diff(route.s_m) / (route.speed_mps[1:] + route.speed_mps[:-1])))
        assert 30.0 <= lap_s <= 45.0
        assert 1.0 / np.abs(route.curvature_per_m).max() == pytest.approx(9.0, rel=1e-3)
        assert route.curvature_per_m.max() == pytest.approx(-route.curvature_per_m.min(), rel=1e-3)


def test_the_circle_turns_left_once_around_a_place_to_the_left() -> None:
    route = make_route("circle")
    assert np.hypot(route.x_m, route.y_m - 15.0) == pytest.approx(15.0, abs=1e-6)
    assert route.heading_rad[-1] - route.heading_rad[0] == pytest.approx(math.tau)
    assert np.all(route.speed_mps == pytest.approx(math.sqrt(1.5 * 15.0)))


def test_the_slalom_passes_every_cone_beside_the_body_and_in_turn() -> None:
    config = replace(CONFIG, cone_count=5, vehicle_width_m=2.0)
    route = make_route("slalom", config)
    cones_x_m = (np.arange(5) + 2.0) * 18.0
    beside_m = np.interp(cones_x_m, route.x_m, route.y_m)
    assert beside_m == pytest.approx([1.6, -1.6, 1.6, -1.6, 1.6], abs=1e-3)


@pytest.mark.parametrize("width_m", [1.6, 1.9, 2.2])
def test_the_double_lane_change_has_the_sections_of_iso_3888_1(width_m: float) -> None:
    route = make_route("double_lane_change", replace(CONFIG, vehicle_width_m=width_m))
    x_m, y_m = route.x_m - route.x_m[0], route.y_m
    entry_m, side_m, exit_m = lane_widths_m(width_m)
    assert (entry_m, side_m, exit_m) == pytest.approx(
        (1.1 * width_m + 0.25, 1.2 * width_m + 0.25, 1.3 * width_m + 0.25)
    )
    assert ISO_3888_1_SECTIONS_M == (15.0, 30.0, 25.0, 25.0, 15.0, 15.0)
    assert x_m[-1] == pytest.approx(125.0)
    right_m = -0.5 * entry_m
    lanes = [(0.0, 15.0, entry_m, right_m), (45.0, 70.0, side_m, right_m + 3.5), (95.0, 125.0, exit_m, right_m)]
    for from_m, to_m, lane_m, right_edge_m in lanes:
        inside = y_m[(x_m >= from_m) & (x_m <= to_m)]
        assert inside == pytest.approx(right_edge_m + 0.5 * lane_m, abs=1e-6)


@pytest.mark.parametrize(("name", "out_m"), [("u_turn", 15.0), ("three_point_turn", 6.0)])
def test_turns_come_back_the_other_way(name: str, out_m: float) -> None:
    route = make_route(name)
    assert route.heading_rad[-1] - route.heading_rad[0] == pytest.approx(math.pi, abs=1e-6)
    assert np.ptp(route.x_m) > out_m


def test_the_three_point_turn_reverses_once_with_straight_wheels_at_both_changes() -> None:
    route = make_route("three_point_turn")
    assert [direction for _, _, direction in route.legs()] == [1.0, -1.0, 1.0]
    changes = [last for _, last, _ in route.legs()][:-1]
    assert route.curvature_per_m[changes] == pytest.approx(0.0, abs=1e-9)
    assert route.speed_mps[changes].tolist() == [0.0, 0.0]
    assert np.abs(route.speed_mps).max() == 1.5
    assert np.all(np.diff(route.heading_rad) >= 0.0)


def test_an_unknown_route_is_refused_with_the_known_names() -> None:
    with pytest.raises(ConfigError, match=r"'figure9'.*circle.*figure8.*u_turn"):
        make_route("figure9")


@pytest.mark.parametrize("field", ["speed_mps", "lateral_accel_mps2", "point_spacing_m", "radius_m", "cone_count"])
@pytest.mark.parametrize("value", [0, -1, math.nan, math.inf, "5"])
def test_a_config_without_sense_is_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(InvalidValueError, match=field):
        RouteConfig(**{field: value})  # type: ignore[arg-type]


def test_a_turn_too_tight_for_its_ramps_is_refused() -> None:
    with pytest.raises(ConfigError, match="too tight"):
        make_route("three_point_turn", replace(CONFIG, three_point_radius_m=1.0))


def test_a_route_is_locked() -> None:
    with pytest.raises(ValueError, match="read-only"):
        make_route("line").x_m[0] = 1.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"s_m": [0.0, 2.0, 1.0]}, "must rise"),
        ({"s_m": [1.0, 2.0, 3.0]}, "must rise from 0"),
        ({"x_m": [0.0, 1.0]}, "x_m of shape"),
        ({"y_m": [0.0, math.nan, 0.0]}, "y_m"),
        ({"speed_mps": [0.0, 1.0, 1.0]}, "open route"),
        ({"closed": True}, "closed route"),
    ],
)
def test_arrays_that_are_no_route_are_refused(changes: dict[str, object], said: str) -> None:
    zeros = [0.0, 0.0, 0.0]
    arrays: dict[str, object] = {
        "s_m": [0.0, 1.0, 2.0],
        "x_m": [0.0, 1.0, 2.0],
        "y_m": zeros,
        "heading_rad": zeros,
        "curvature_per_m": zeros,
        "speed_mps": [0.0, 1.0, 0.0],
        "dwell_s": zeros,
    }
    with pytest.raises(InvalidValueError, match=said):
        Route(name="r", config=CONFIG, **(arrays | changes))  # type: ignore[arg-type]


def test_the_command_line_names_the_routes_that_there_are() -> None:
    assert set(ROUTE_NAMES) == set(ROUTES)
