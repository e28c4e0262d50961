"""A route in pieces: when each is due, where it begins and ends, and that a vehicle can live on them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface.errors import InvalidValueError
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectories import ROUTES, RecedingRoute, Route, RouteConfig, TrajectorySource, make_route
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import NS_PER_S

WHEELBASE_M = 2.7
TICK_NS = 10_000_000
MS = 1_000_000


def at(route: Route, s_m: float, *, speed_mps: float = 0.0, left_m: float = 0.0, stamp_ns: int = 0) -> VehicleState:
    """A vehicle at `s_m` along the route, `left_m` beside it."""
    x_m, y_m, heading_rad = (
        float(np.interp(s_m, route.s_m, values)) for values in (route.x_m, route.y_m, route.heading_rad)
    )
    return VehicleState(
        stamp_ns=stamp_ns,
        x_m=x_m - left_m * math.sin(heading_rad),
        y_m=y_m + left_m * math.cos(heading_rad),
        heading_rad=math.remainder(heading_rad, math.tau),
        speed_mps=speed_mps,
    )


def given_by(source: TrajectorySource, now_ns: int, state: VehicleState) -> Trajectory:
    trajectory = source.next(now_ns, state)
    assert trajectory is not None
    return trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    now_ns: int
    state: VehicleState
    trajectory: Trajectory
    fresh: bool
    within: bool
    """Neither past its end in time nor in space."""


@dataclass(slots=True)
class Drive:
    """A bicycle without lags that steers at a point ahead on its trajectory and keeps to its speeds."""

    route: Route
    source: RecedingRoute
    state: VehicleState
    now_ns: int = 0
    lookahead_m: float = 3.0

    def ticks(self, duration_s: float) -> Iterator[Tick]:
        trajectory: Trajectory | None = None
        for _ in range(round(duration_s * NS_PER_S / TICK_NS)):
            fresh = self.source.next(self.now_ns, self.state)
            trajectory = fresh or trajectory
            assert trajectory is not None
            within = self._within(trajectory)
            yield Tick(
                now_ns=self.now_ns, state=self.state, trajectory=trajectory, fresh=fresh is not None, within=within
            )
            self._step(*(self._followed(trajectory) if within else self._stopped()))

    def _within(self, trajectory: Trajectory) -> bool:
        past_ns = self.now_ns - trajectory.stamp_ns
        dx = self.state.x_m - trajectory.x_m[-1]
        dy = self.state.y_m - trajectory.y_m[-1]
        heading = trajectory.heading_rad[-1]
        ahead_m = (dx * math.cos(heading) + dy * math.sin(heading)) * direction_of(trajectory)
        return bool(past_ns < trajectory.time_from_start_ns[-1] and (ahead_m < 0.0 or self._far(trajectory)))

    def _far(self, trajectory: Trajectory) -> bool:
        """Whether the end is not near yet, where its plane says nothing."""
        return math.hypot(self.state.x_m - trajectory.x_m[-1], self.state.y_m - trajectory.y_m[-1]) > 2.0

    def _followed(self, trajectory: Trajectory) -> tuple[float, float]:
        dx, dy = trajectory.x_m - self.state.x_m, trajectory.y_m - self.state.y_m
        far = np.flatnonzero(np.hypot(dx, dy) >= self.lookahead_m)
        i = int(far[0]) if far.size else len(trajectory) - 1
        heading = self.state.heading_rad
        left_m = -math.sin(heading) * dx[i] + math.cos(heading) * dy[i]
        squared = max(float(dx[i] ** 2 + dy[i] ** 2), 0.01)
        wheel_rad = math.atan(2.0 * left_m * WHEELBASE_M / squared) if squared > 0.25 else 0.0
        accel = (trajectory.speed_mps[i] ** 2 - self.state.speed_mps**2) / (2.0 * math.sqrt(squared))
        return float(accel) * direction_of(trajectory), max(-0.6, min(0.6, wheel_rad))

    def _stopped(self) -> tuple[float, float]:
        dt_s = TICK_NS / NS_PER_S
        return math.copysign(min(3.0, abs(self.state.speed_mps) / dt_s), -self.state.speed_mps), 0.0

    def _step(self, accel_mps2: float, wheel_rad: float) -> None:
        dt_s, state = TICK_NS / NS_PER_S, self.state
        speed_mps = state.speed_mps + accel_mps2 * dt_s
        moved_m = 0.5 * (speed_mps + state.speed_mps) * dt_s
        turn = moved_m * math.tan(wheel_rad) / WHEELBASE_M
        course = state.heading_rad + 0.5 * turn
        self.now_ns += TICK_NS
        self.state = replace(
            state,
            stamp_ns=self.now_ns,
            x_m=state.x_m + moved_m * math.cos(course),
            y_m=state.y_m + moved_m * math.sin(course),
            heading_rad=state.heading_rad + turn,
            speed_mps=speed_mps,
        )


def direction_of(trajectory: Trajectory) -> float:
    return -1.0 if trajectory.speed_mps[0] < 0.0 else 1.0


def drive_of(name: str, config: RouteConfig | None = None) -> Drive:
    route = make_route(name, config)
    return Drive(route, RecedingRoute(route), at(route, 0.0))


def test_it_is_a_trajectory_source() -> None:
    source: TrajectorySource = RecedingRoute(make_route("line"), frame_id="odom")
    trajectory = given_by(source, 123, at(make_route("line"), 0.0))
    assert (trajectory.stamp_ns, trajectory.frame_id) == (123, "odom")


def test_pieces_come_on_an_absolute_grid_and_missed_ones_are_not_made_up_for() -> None:
    route = make_route("circle")
    source = RecedingRoute(route, period_s=0.1)
    asked_ms = [1000, 1001, 1099, 1100, 1101, 1150, 1199, 1207, 1299, 1300, 1555, 1556, 1599, 1600]
    came = [ms for ms in asked_ms if source.next(ms * MS, at(route, 0.0)) is not None]
    assert came == [1000, 1100, 1207, 1300, 1555, 1600]


@pytest.mark.parametrize("left_m", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("s_m", [0.05, 7.3, 40.0, 141.4])
def test_the_first_point_is_the_vehicles_own_place_at_its_own_speed(s_m: float, left_m: float) -> None:
    route = make_route("figure8")
    trajectory = given_by(RecedingRoute(route), 0, at(route, s_m, speed_mps=2.0, left_m=left_m))
    place = at(route, s_m)
    assert trajectory.time_from_start_ns[0] == 0
    assert trajectory.x_m[0] == pytest.approx(place.x_m, abs=0.03)
    assert trajectory.y_m[0] == pytest.approx(place.y_m, abs=0.03)
    assert trajectory.heading_rad[0] == pytest.approx(place.heading_rad, abs=0.01)
    assert trajectory.speed_mps[0] == pytest.approx(2.0)


@pytest.mark.parametrize("name", sorted(ROUTES))
@given(share=st.floats(0.0, 0.9), speed_mps=st.floats(0.0, 8.0))
@settings(max_examples=30, deadline=None)
def test_each_piece_reaches_the_horizon_or_ends_in_a_stop(name: str, share: float, speed_mps: float) -> None:
    route = make_route(name)
    trajectory = RecedingRoute(route).next(0, at(route, share * route.length_m, speed_mps=speed_mps))
    if trajectory is None:
        return
    reached = trajectory.time_from_start_ns[-1] >= 8 * NS_PER_S
    assert reached or trajectory.speed_mps[-1] == 0.0
    assert reached or not route.closed
    assert 2 <= len(trajectory) <= 256
    assert np.all(np.diff(trajectory.time_from_start_ns) > 0)


@pytest.mark.parametrize("name", sorted(ROUTES))
@given(share=st.floats(0.0, 0.9), speed_mps=st.floats(0.0, 8.0))
@settings(max_examples=30, deadline=None)
def test_each_piece_agrees_with_itself_and_keeps_the_limits(name: str, share: float, speed_mps: float) -> None:
    route = make_route(name)
    trajectory = RecedingRoute(route).next(0, at(route, share * route.length_m, speed_mps=speed_mps))
    if trajectory is None:
        return
    dt_s = np.diff(trajectory.time_from_start_ns) * 1e-9
    v0, v1 = trajectory.speed_mps[:-1], trajectory.speed_mps[1:]
    chords = np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m))
    forward = trajectory.accel_mps2[:-1] * direction_of(trajectory)
    assert np.abs(v0 + v1) * 0.5 * dt_s == pytest.approx(chords, abs=2e-3)
    assert trajectory.accel_mps2[:-1] * dt_s == pytest.approx(v1 - v0, abs=1e-6)
    assert forward.max() <= 1.0 + 1e-6
    assert forward.min() >= -1.5 - 1e-6
    # Between two points of the route v² and curvature are each linear: their product bulges a little over both ends.
    assert np.abs(trajectory.speed_mps * trajectory.yaw_rate_radps).max() <= 1.5 * 1.01
    assert trajectory.yaw_rate_radps == pytest.approx(
        trajectory.speed_mps * np.tan(trajectory.front_wheel_angle_rad) / WHEELBASE_M, abs=1e-3
    )
    assert np.all(np.abs(np.diff(trajectory.heading_rad)) < 0.2)


def test_from_standstill_speeds_rise_with_the_routes_acceleration() -> None:
    route = make_route("circle")
    trajectory = given_by(RecedingRoute(route), 0, at(route, 0.0))
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m)))])
    expected = np.minimum(np.sqrt(0.3**2 + 2.0 * driven_m), math.sqrt(1.5 * 15.0))
    assert trajectory.speed_mps == pytest.approx(expected, abs=1e-3)


def test_a_vehicle_that_is_too_fast_is_given_the_routes_speeds() -> None:
    route = make_route("circle")
    trajectory = given_by(RecedingRoute(route), 0, at(route, 0.0, speed_mps=9.0))
    assert trajectory.speed_mps == pytest.approx(math.sqrt(1.5 * 15.0))


def test_after_many_laps_headings_are_still_small() -> None:
    route = make_route("circle")
    source = RecedingRoute(route)
    for n in range(400):
        s_m = 2.0 * n % route.length_m
        trajectory = given_by(source, n * 100 * MS, at(route, s_m, speed_mps=4.0))
        assert abs(trajectory.heading_rad[0]) <= math.pi + 1e-9
    assert source.laps == int(2.0 * 399 / route.length_m)
    assert source.progress_m == pytest.approx(2.0 * 399 % route.length_m, abs=0.01)


def test_fast_routes_are_thinned_to_a_bounded_number_of_points_and_still_reach_the_horizon() -> None:
    config = RouteConfig(speed_mps=30.0, lateral_accel_mps2=9.0, length_m=2000.0, point_spacing_m=0.1, accel_mps2=5.0)
    route = make_route("line", config)
    trajectory = given_by(RecedingRoute(route), 0, at(route, 500.0, speed_mps=30.0))
    assert len(trajectory) <= 256
    assert trajectory.time_from_start_ns[-1] >= 8 * NS_PER_S
    assert np.all(np.isin(trajectory.x_m[1:], route.x_m))


def test_a_lap_shorter_than_the_horizon_is_gone_round_more_than_once() -> None:
    route = make_route("circle", RouteConfig(radius_m=5.0, lateral_accel_mps2=5.0))
    trajectory = given_by(RecedingRoute(route), 0, at(route, 31.0, speed_mps=5.0))
    assert trajectory.time_from_start_ns[-1] >= 8 * NS_PER_S
    assert np.ptp(trajectory.heading_rad) > math.tau
    assert np.hypot(trajectory.x_m, trajectory.y_m - 5.0) == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize("half", [0.0, 0.5])
def test_on_the_crossing_the_branch_is_the_one_that_the_vehicle_heads_along(half: float) -> None:
    route = make_route("figure8")
    source = RecedingRoute(route)
    trajectory = given_by(source, 0, at(route, half * route.length_m + 1e-6, speed_mps=3.0))
    heading = float(np.interp(half * route.length_m, route.s_m, route.heading_rad))
    assert math.cos(trajectory.heading_rad[0] - heading) > 0.999
    assert source.progress_m == pytest.approx(half * route.length_m, abs=0.01)


def test_a_vehicle_put_a_hair_behind_the_beginning_has_not_driven_a_lap_when_it_passes_it() -> None:
    route = make_route("circle")
    source = RecedingRoute(route)
    for n in range(10):
        given_by(source, n * 100 * MS, at(route, (route.length_m - 0.05 + 0.3 * n) % route.length_m, speed_mps=3.0))
    assert source.laps == 0
    assert source.progress_m == pytest.approx(2.65, abs=0.01)


def test_a_vehicle_that_jumps_is_looked_for_on_the_whole_route_and_found() -> None:
    route = make_route("figure8")
    source = RecedingRoute(route)
    given_by(source, 0, at(route, 10.0, speed_mps=3.0))
    trajectory = given_by(source, 100 * MS, at(route, 100.0, speed_mps=3.0, left_m=0.5))
    assert source.progress_m == pytest.approx(100.0, abs=0.1)
    assert trajectory.x_m[0] == pytest.approx(at(route, 100.0).x_m, abs=0.1)


def test_a_vehicle_that_rolls_back_a_little_does_not_take_progress_with_it() -> None:
    route = make_route("figure8")
    source = RecedingRoute(route)
    given_by(source, 0, at(route, 30.0))
    given_by(source, 100 * MS, at(route, 29.0))
    assert source.progress_m == pytest.approx(30.0, abs=0.01)


def test_restart_forgets_grid_place_and_laps() -> None:
    route = make_route("circle")
    source = RecedingRoute(route)
    for n in range(60):
        source.next(n * 100 * MS, at(route, 2.0 * n % route.length_m, speed_mps=5.0))
    assert source.laps == 1
    source.restart()
    assert (source.laps, source.progress_m) == (0, 0.0)
    trajectory = given_by(source, 5_955 * MS, at(route, 50.0, speed_mps=5.0))
    assert trajectory.stamp_ns == 5_955 * MS
    assert source.progress_m == pytest.approx(50.0, abs=0.01)


def test_three_laps_of_the_figure_of_eight_never_swap_branches_and_never_run_out() -> None:
    drive = drive_of("figure8")
    travelled_m, before_m, fresh = 0.0, 0.0, 0
    for tick in drive.ticks(115.0):
        assert tick.within
        total_m = drive.source.laps * drive.route.length_m + drive.source.progress_m
        assert total_m >= before_m
        assert total_m == pytest.approx(travelled_m, abs=1.0)
        place = at(drive.route, drive.source.progress_m)
        assert math.cos(place.heading_rad - tick.state.heading_rad) > 0.9
        assert math.hypot(place.x_m - tick.state.x_m, place.y_m - tick.state.y_m) < 0.8
        before_m, fresh = total_m, fresh + tick.fresh
        travelled_m += tick.state.speed_mps * TICK_NS / NS_PER_S
    assert drive.source.laps == 3
    assert fresh == 1150


@pytest.mark.parametrize("name", sorted(set(ROUTES) - {"circle", "figure8"}))
def test_an_open_route_is_driven_to_its_end_and_its_last_trajectory_is_left_to_run_out(name: str) -> None:
    drive = drive_of(name)
    ticks = list(drive.ticks(60.0))
    last = ticks[-1]
    end = at(drive.route, drive.route.length_m)
    assert drive.source.finished
    assert abs(last.state.speed_mps) < 1e-6
    assert not last.within
    assert not last.fresh
    assert last.trajectory.speed_mps[-1] == 0.0
    assert math.hypot(last.state.x_m - end.x_m, last.state.y_m - end.y_m) < 0.5
    assert drive.source.next(last.now_ns + NS_PER_S, last.state) is None


def standstills_s(ticks: list[Tick]) -> list[float]:
    """How long each standstill on the way lasts."""
    standing = [abs(tick.state.speed_mps) < 0.1 for tick in ticks]
    edges = np.flatnonzero(np.diff(np.array([False, *standing, False]).astype(int)))
    return [float(end - begin) * TICK_NS / NS_PER_S for begin, end in zip(edges[::2], edges[1::2], strict=True)]


@pytest.mark.parametrize("dwell_s", [0.5, 2.0])
def test_at_each_stop_the_vehicle_stands_for_the_dwell_time_and_goes_on(dwell_s: float) -> None:
    drive = drive_of("stop_and_go", RouteConfig(dwell_s=dwell_s))
    _, *stops, _ = standstills_s(list(drive.ticks(45.0 + 2.0 * dwell_s)))
    assert stops == pytest.approx([dwell_s, dwell_s], abs=0.35)
    assert drive.source.finished


def test_no_piece_goes_past_a_stop_before_the_vehicle_has_stood_there() -> None:
    drive = drive_of("three_point_turn")
    changes_m = [float(drive.route.s_m[last]) for _, last, _ in drive.route.legs()]
    for tick in drive.ticks(45.0):
        assert np.all(tick.trajectory.speed_mps * direction_of(tick.trajectory) >= 0.0)
        if tick.fresh:
            ahead_m = min(change for change in changes_m if change > drive.source.progress_m)
            left_m = np.hypot(np.diff(tick.trajectory.x_m), np.diff(tick.trajectory.y_m)).sum()
            assert drive.source.progress_m + left_m <= ahead_m + 0.01
    assert drive.source.finished


def test_a_reversing_piece_has_negative_speeds_from_its_first_point_on() -> None:
    route = make_route("three_point_turn")
    source = RecedingRoute(route)
    change_m = float(route.s_m[route.legs()[0][1]])
    assert source.next(0, at(route, change_m)) is None
    waited = [source.next(n * 100 * MS, at(route, change_m)) for n in range(1, 21)]
    assert waited[:-1] == [None] * 19
    assert waited[-1] is not None
    assert waited[-1].speed_mps[0] == pytest.approx(-0.3)
    assert np.all(waited[-1].speed_mps[:-1] < 0.0)
    assert waited[-1].accel_mps2[0] < 0.0


def test_a_vehicle_that_overshoots_a_stop_waits_for_the_dwell_and_then_goes_on_from_it() -> None:
    route = make_route("stop_and_go")
    source = RecedingRoute(route)
    given_by(source, 0, at(route, 24.0, speed_mps=3.0))
    beyond = at(route, 25.6, speed_mps=0.0)
    assert [source.next(n * 100 * MS, beyond) for n in range(1, 21)] == [None] * 20
    trajectory = given_by(source, 2_100 * MS, beyond)
    assert trajectory.x_m[0] == pytest.approx(beyond.x_m, abs=0.7)
    assert trajectory.speed_mps[0] >= 0.3


def test_a_vehicle_that_stops_short_of_a_stop_counts_as_having_stopped_there() -> None:
    route = make_route("stop_and_go", RouteConfig(dwell_s=0.1))
    source = RecedingRoute(route)
    given_by(source, 0, at(route, 20.0, speed_mps=3.0))
    assert source.next(100 * MS, at(route, 23.1)) is None
    trajectory = given_by(source, 200 * MS, at(route, 23.1))
    assert trajectory.x_m[0] == pytest.approx(route.x_m[0] + 25.0)


@pytest.mark.parametrize("argument", ["horizon_s", "period_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_horizon_or_period_without_sense_is_refused_by_name(argument: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=argument):
        RecedingRoute(make_route("line"), **{argument: value})  # type: ignore[arg-type]


def test_a_period_below_a_nanosecond_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="period_s"):
        RecedingRoute(make_route("line"), period_s=1e-10)
