"""Pure pursuit: what it aims at, how it steers and accelerates, and driving it to the end."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.narrowing import at_present
from vehicle_iface.command import Command
from vehicle_iface.control import (
    BehaviorConfig,
    ControllerBase,
    ControlReference,
    PurePursuit,
    PurePursuitConfig,
    StopSteering,
)
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.reason import Reason
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import NS_PER_S

from . import plant, strategies
from .contract import ControllerContract, along_x, assert_plain, at

CONFIG = PurePursuitConfig(wheelbase_m=2.7, min_lookahead_m=2.0, max_lookahead_m=20.0, lookahead_time_s=1.0)


def following(
    trajectory: Trajectory, config: PurePursuitConfig = CONFIG, behavior: BehaviorConfig | None = None
) -> PurePursuit:
    controller = PurePursuit(config, behavior=behavior)
    controller.set_trajectory(trajectory)
    return controller


class TestPurePursuit(ControllerContract):
    def controller(self, behavior: BehaviorConfig | None = None) -> ControllerBase:
        return PurePursuit(CONFIG, behavior=behavior)


class TestPurePursuitWithPrediction(ControllerContract):
    def controller(self, behavior: BehaviorConfig | None = None) -> ControllerBase:
        return PurePursuit(
            replace(CONFIG, delay_compensation=True, interpolate=False), behavior=behavior, clock=lambda: 0
        )


# ── the target ──


@pytest.mark.parametrize(("speed_mps", "lookahead_m"), [(0.0, 2.0), (-1.0, 2.0), (3.5, 3.5), (50.0, 20.0)])
def test_the_lookahead_grows_with_speed_between_its_bounds(speed_mps: float, lookahead_m: float) -> None:
    controller = following(along_x(40))
    controller.compute_command(at(2.25, 0.5, speed_mps=speed_mps))
    assert controller.lookahead_point is not None
    x_m, y_m = controller.lookahead_point
    assert math.hypot(x_m - 2.25, y_m - 0.5) == pytest.approx(lookahead_m, abs=1e-12)
    assert y_m == pytest.approx(0.0, abs=1e-12)
    assert x_m > 2.25


def test_without_interpolation_it_aims_at_the_first_point_that_is_far_enough() -> None:
    controller = following(along_x(40), replace(CONFIG, interpolate=False))
    controller.compute_command(at(2.25, speed_mps=2.5))
    assert controller.lookahead_point == (5.0, 0.0)


def test_near_the_end_it_aims_at_the_farthest_point() -> None:
    controller = following(along_x())
    controller.compute_command(at(9.5))
    assert controller.lookahead_point == (10.0, 0.0)


def test_before_the_beginning_it_aims_at_the_circle_on_the_way_to_it() -> None:
    controller = following(along_x())
    controller.compute_command(at(-8.0, 6.0))
    assert controller.lookahead_point == pytest.approx((-8.0 + 1.6, 6.0 - 1.2))


def test_backwards_it_aims_behind_itself() -> None:
    trajectory = replace(along_x(20, speed_mps=-2.0), x_m=np.array([-float(i) for i in range(20)]))
    controller = following(trajectory)
    command = controller.compute_command(at(-3.5, speed_mps=-1.0))
    assert controller.lookahead_point == pytest.approx((-5.5, 0.0))
    assert command.accel_mps2 == pytest.approx(-(4.0 - 1.0) / 4.0)
    assert command.speed_mps == -2.0


def test_with_everything_behind_it_stops() -> None:
    controller = following(along_x())
    command = controller.compute_command(replace(at(-3.0), heading_rad=math.pi))
    assert command.reason is Reason.DEVIATION
    assert controller.lookahead_point is None


def test_a_stop_has_no_lookahead_point() -> None:
    controller = following(along_x())
    assert at_present(controller.lookahead_point) is None
    controller.compute_command(at(0.5))
    assert at_present(controller.lookahead_point) is not None
    controller.compute_command(at(11.0))
    assert controller.lookahead_point is None


# ── steering and acceleration ──


@given(left=st.floats(-1.9, 1.9), speed=st.floats(0.0, 2.0))
def test_it_steers_on_the_arc_through_the_target(left: float, speed: float) -> None:
    controller = following(along_x(20))
    command = controller.compute_command(at(3.0, -left, speed_mps=speed))
    assert command.front_wheel_angle_rad == pytest.approx(math.atan(2 * left * 2.7 / 4.0), abs=1e-9)
    assert command.front_wheel_angle_rad * left >= 0.0  # the path is on the left: to the left


@pytest.mark.parametrize(
    ("speed_mps", "target_mps", "accel_mps2"),
    [(2.0, 5.0, 21 / 4), (2.0, 1.0, -3 / 4), (2.0, 2.0, 0.0), (0.0, 2.0, 1.0), (-1.0, 2.0, 5 / 4)],
)
def test_it_reaches_the_targets_speed_at_the_target(speed_mps: float, target_mps: float, accel_mps2: float) -> None:
    command = following(along_x(20, speed_mps=target_mps)).compute_command(at(3.5, speed_mps=speed_mps))
    assert command.accel_mps2 == pytest.approx(accel_mps2, abs=1e-12)


@given(speed=st.floats(-2.0, 2.0), target=st.floats(-5.0, 5.0).filter(lambda v: abs(v) > 0.01))
def test_it_always_accelerates_towards_the_targets_speed(speed: float, target: float) -> None:
    way = math.copysign(1.0, target)
    trajectory = replace(along_x(20, speed_mps=target), x_m=np.array([way * i for i in range(20)]))
    command = following(trajectory).compute_command(at(way * 3.5, speed_mps=speed))
    assert command.accel_mps2 * (target - speed) >= 0.0


@pytest.mark.parametrize(
    ("reference", "speed_mps"), [(ControlReference.SPATIAL, 3.0), (ControlReference.TEMPORAL, 5.0)]
)
def test_the_command_carries_the_reference_points_speed(reference: ControlReference, speed_mps: float) -> None:
    trajectory = replace(along_x(), speed_mps=np.array([float(i) for i in range(11)]))
    controller = following(trajectory, behavior=BehaviorConfig(reference=reference))
    assert controller.compute_command(at(3.5, stamp_ns=5 * NS_PER_S)).speed_mps == speed_mps


def test_the_command_never_carries_a_speed_against_the_direction_of_travel() -> None:
    there_and_back = replace(
        along_x(),
        x_m=np.array([*map(float, [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0])]),
        speed_mps=np.array([2.0] * 5 + [0.0] + [-2.0] * 5),
    )
    controller = following(there_and_back, behavior=BehaviorConfig(reference=ControlReference.TEMPORAL))
    assert controller.compute_command(at(3.5, stamp_ns=8 * NS_PER_S)).speed_mps == 0.0


def test_a_vehicle_that_rolls_through_a_standing_start_is_not_stopped() -> None:
    command = following(replace(along_x(), speed_mps=np.array([0.0] + [1.0] * 10))).compute_command(at(0.5))
    assert command.accel_mps2 == pytest.approx(0.0, abs=1e-12)


def with_a_dwell(at_index: int, n: int = 11) -> Trajectory:
    """`along_x` with a stop of one second at one of its points."""
    x = [float(i - (i > at_index)) for i in range(n)]
    return replace(
        along_x(n),
        x_m=np.array(x),
        speed_mps=np.array([0.0 if i in (at_index, at_index + 1) else 1.0 for i in range(n)]),
    )


def test_the_target_moved_back_keeps_the_speed_of_the_first_point_beyond() -> None:
    trajectory = replace(along_x(2, speed_mps=5.0), x_m=np.array([10.0, 20.0]))
    command = PurePursuit().compute_command(at(0.0, speed_mps=0.0))
    assert command.is_stop
    command = following(trajectory, PurePursuitConfig()).compute_command(at(0.0, speed_mps=0.0))
    assert command.accel_mps2 == pytest.approx(25 / (2 * 2))
    rising = replace(along_x(20), speed_mps=np.array([float(i) for i in range(20)]))
    assert following(rising).compute_command(at(3.5, speed_mps=2.0)).accel_mps2 == pytest.approx((36 - 4) / (2 * 2))


@pytest.mark.parametrize("left_m", [1.0, 0.05])
@pytest.mark.parametrize("seconds", [[8, 9, 10], [8, 9, 9]])
def test_a_vehicle_at_rest_short_of_the_end_stays(left_m: float, seconds: list[int]) -> None:
    trajectory = replace(
        along_x(),
        x_m=np.array([*map(float, range(9)), 9.0, 9.0]),
        speed_mps=np.array([1.0] * 9 + [0.0, 0.0]),
        time_from_start_ns=np.array([s * NS_PER_S for s in [*range(8), *seconds]], dtype=np.int64),
    )
    assert following(trajectory).compute_command(at(9.0 - left_m, speed_mps=0.0)).accel_mps2 == 0.0


def test_a_vehicle_at_rest_short_of_a_dwell_creeps_up_to_it() -> None:
    controller = following(with_a_dwell(5))
    assert controller.compute_command(at(4.5, speed_mps=0.0)).accel_mps2 == pytest.approx(0.1**2 / (2 * 0.5))


def test_a_standing_start_at_distinct_places_is_no_dwell() -> None:
    trajectory = replace(along_x(), speed_mps=np.array([0.0, 0.0] + [5.0] * 9))
    assert following(trajectory).compute_command(at(0.0, speed_mps=0.0)).accel_mps2 == pytest.approx(25 / 4)


def test_a_standing_start_without_time_is_no_dwell() -> None:
    trajectory = replace(
        with_a_dwell(0), time_from_start_ns=np.array([0, 0, *(i * NS_PER_S for i in range(2, 11))], dtype=np.int64)
    )
    assert following(trajectory).compute_command(at(0.0, speed_mps=0.0)).accel_mps2 > 0.0


def test_a_standing_start_with_a_dwell_waits_for_its_time() -> None:
    controller = following(with_a_dwell(0))
    assert controller.compute_command(at(0.0, speed_mps=0.0, stamp_ns=NS_PER_S - 1)).accel_mps2 == 0.0
    assert controller.compute_command(at(0.0, speed_mps=0.0, stamp_ns=NS_PER_S)).accel_mps2 > 0.0


def test_a_point_without_speed_and_without_time_is_not_braked_for() -> None:
    trajectory = replace(along_x(), speed_mps=np.array([5.0] * 3 + [0.0] + [5.0] * 7))
    assert following(trajectory).compute_command(at(2.5, speed_mps=2.0)).accel_mps2 == pytest.approx(21 / 4)


@pytest.mark.parametrize("speeds", [[1.0] * 5 + [0.0] + [-1.0] * 5, [1.0] * 6 + [-1.0] * 5])
def test_a_change_of_direction_is_braked_for(speeds: list[float]) -> None:
    trajectory = replace(
        along_x(), x_m=np.array([*map(float, [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0])]), speed_mps=np.array(speeds)
    )
    assert following(trajectory).compute_command(at(4.0)).accel_mps2 == pytest.approx(-1 / 2)


def test_a_vehicle_that_overshot_a_stop_brakes_hard_and_only_then_goes_on() -> None:
    controller = following(with_a_dwell(5))
    late_ns = 9 * NS_PER_S
    controller.compute_command(at(4.5, stamp_ns=late_ns))
    assert controller.compute_command(at(5.1, stamp_ns=late_ns)).accel_mps2 == -3.0
    assert controller.compute_command(at(5.2, stamp_ns=late_ns, speed_mps=0.0)).accel_mps2 > 0.0


def test_numbers_that_overflow_are_refused_and_not_sent() -> None:
    with pytest.raises(InvalidValueError):
        following(along_x(20)).compute_command(at(3.0, speed_mps=1e200))


def test_a_tracking_stop_goes_on_steering_at_the_path() -> None:
    controller = following(along_x(20), behavior=BehaviorConfig(stop_steering=StopSteering.TRACK))
    driving = controller.compute_command(at(3.0, 1.0))
    stop = controller.compute_stop_command(at(3.0, 1.0), Reason.STATE_STALE)
    assert stop.front_wheel_angle_rad == driving.front_wheel_angle_rad < 0.0
    assert stop.accel_mps2 == -3.0


@given(trajectory=strategies.trajectories(least=1), state=strategies.states())
def test_every_command_is_finite_and_plain(trajectory: Trajectory, state: VehicleState) -> None:
    for delay_compensation, interpolate in itertools.product((False, True), repeat=2):
        config = replace(CONFIG, delay_compensation=delay_compensation, interpolate=interpolate)
        controller = PurePursuit(config, clock=lambda: state.stamp_ns + 50_000_000)
        controller.set_trajectory(trajectory)
        assert_plain(controller.compute_command(state))
        if controller.lookahead_point is not None:
            assert all(type(value) is float for value in controller.lookahead_point)


# ── delay ──


@pytest.mark.parametrize(("age_s", "ahead_m"), [(0.2, 0.4), (-1.0, 0.0), (7.0, 1.0)])
def test_with_delay_compensation_it_aims_from_where_the_vehicle_is_by_now(age_s: float, ahead_m: float) -> None:
    stamp_ns = 123
    controller = PurePursuit(replace(CONFIG, delay_compensation=True), clock=lambda: stamp_ns + round(age_s * NS_PER_S))
    controller.set_trajectory(along_x(20))
    command = controller.compute_command(at(3.0, speed_mps=2.0, stamp_ns=stamp_ns))
    assert controller.lookahead_point == pytest.approx((5.0 + ahead_m, 0.0))
    assert command.stamp_ns == stamp_ns


def test_a_braking_vehicle_is_not_thought_to_reverse_by_now() -> None:
    controller = PurePursuit(replace(CONFIG, delay_compensation=True), clock=lambda: 500_000_000)
    controller.set_trajectory(along_x(20))
    controller.compute_command(at(3.0, speed_mps=1.0, accel_mps2=-5.0))
    assert controller.lookahead_point == pytest.approx((3.1 + 2.0, 0.0))


def test_by_default_the_age_is_by_the_monotonic_clock() -> None:
    controller = following(along_x(20, stamp_ns=2**62), replace(CONFIG, delay_compensation=True))
    assert controller.compute_command(at(3.0, stamp_ns=2**61)).reason is Reason.NOMINAL


# ── configuration ──


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, "2", True, None])
@pytest.mark.parametrize(
    "name", ["wheelbase_m", "min_lookahead_m", "max_lookahead_m", "lookahead_time_s", "standstill_speed_mps"]
)
def test_a_number_that_makes_no_sense_is_refused(name: str, value: object) -> None:
    with pytest.raises(InvalidValueError, match=name):
        PurePursuitConfig(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["wheelbase_m", "min_lookahead_m"])
def test_a_length_of_nothing_is_refused(name: str) -> None:
    with pytest.raises(InvalidValueError, match=name):
        PurePursuitConfig(**{name: 0.0})  # type: ignore[arg-type]


def test_bounds_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="at least min_lookahead_m"):
        PurePursuitConfig(min_lookahead_m=5.0, max_lookahead_m=4.0)


@pytest.mark.parametrize("name", ["interpolate", "delay_compensation"])
def test_a_switch_that_is_neither_on_nor_off_is_refused(name: str) -> None:
    with pytest.raises(InvalidValueError, match=name):
        PurePursuitConfig(**{name: 1})  # type: ignore[arg-type]


# ── driving ──

FIRM = replace(CONFIG, min_lookahead_m=2.5, lookahead_time_s=0.5)


def standing_from_to(log: list[tuple[VehicleState, Command]], x_m: float) -> tuple[float, float]:
    """The first and last second in which the vehicle stood within 0.1 m of `x_m`."""
    seconds = [s.stamp_ns / NS_PER_S for s, _ in log if abs(s.speed_mps) <= 0.1 and abs(s.x_m - x_m) < 0.1]
    return seconds[0], seconds[-1]


def test_a_straight_line_is_driven_to_its_end() -> None:
    trajectory = plant.straight(30.0, greatest_mps=5.0, stops_m=[0.0, 30.0])
    log = plant.drive(following(trajectory), plant.Bicycle(y_m=0.5), duration_s=20.0)
    assert abs(log[600][0].y_m) < 0.02
    assert log[-1][0].x_m == pytest.approx(30.0, abs=0.1)
    assert log[-1][1].reason in {Reason.PAST_END_TIME, Reason.PAST_END_SPACE}


def test_it_stands_through_a_dwell_and_goes_on() -> None:
    trajectory = plant.straight(40.0, greatest_mps=5.0, stops_m=[0.0, 20.0, 40.0], dwell_s=4.0)
    goes_on_s = trajectory.time_from_start_ns[80 + 1] / NS_PER_S
    log = plant.drive(following(trajectory), plant.Bicycle(), duration_s=30.0)
    came_s, went_s = standing_from_to(log, 20.0)
    assert came_s < goes_on_s - 2.0
    assert went_s == pytest.approx(goes_on_s, abs=0.2)
    assert log[-1][0].x_m == pytest.approx(40.0, abs=0.2)


def test_a_late_vehicle_still_stops_and_goes_on_at_once() -> None:
    trajectory = plant.straight(40.0, greatest_mps=5.0, stops_m=[0.0, 20.0, 40.0], dwell_s=0.5)
    late = replace(trajectory, stamp_ns=-8 * NS_PER_S, time_from_start_ns=_with_a_late_end(trajectory))
    log = plant.drive(following(late), plant.Bicycle(), duration_s=40.0)
    came_s, went_s = standing_from_to(log, 20.0)
    assert went_s - came_s < 0.2
    assert log[-1][0].x_m == pytest.approx(40.0, abs=0.1)


def test_it_waits_for_the_time_of_a_standing_start() -> None:
    route = plant.straight(20.0, greatest_mps=3.0, stops_m=[0.0, 20.0])
    twice = [0, *range(len(route))]
    times_ns = route.time_from_start_ns[twice] + 2 * NS_PER_S
    times_ns[0] = 0
    trajectory = Trajectory(
        stamp_ns=0,
        time_from_start_ns=times_ns,
        x_m=route.x_m[twice],
        y_m=route.y_m[twice],
        heading_rad=route.heading_rad[twice],
        speed_mps=route.speed_mps[twice],
    )
    log = plant.drive(following(trajectory), plant.Bicycle(), duration_s=4.0)
    assert standing_from_to(log, 0.0)[1] == pytest.approx(2.0, abs=0.2)
    assert log[-1][0].x_m > 0.5


def test_a_vehicle_that_came_to_rest_short_of_a_stop_creeps_up_to_it() -> None:
    trajectory = plant.straight(40.0, greatest_mps=5.0, stops_m=[0.0, 20.0, 40.0], dwell_s=0.5)
    controller = following(trajectory)
    log = plant.drive(controller, plant.Bicycle(x_m=19.9), duration_s=12.0)
    assert max(s.speed_mps for s, _ in log[:200]) < 0.2
    assert controller.spatial_index >= 80
    assert log[-1][0].x_m > 20.5


@pytest.mark.parametrize("speed_mps", [3.0, -2.0])
def test_a_circle_is_driven_forwards_and_backwards(speed_mps: float) -> None:
    trajectory = plant.circle(10.0, laps=2, speed_mps=speed_mps)
    end_s = trajectory.time_from_start_ns[-1] / NS_PER_S
    log = plant.drive(following(trajectory), plant.Bicycle(), duration_s=end_s + 2.0)
    assert plant.lateral_errors(log, trajectory).max() < 0.02
    steered = [c.front_wheel_angle_rad for _, c in log if not c.is_stop and c.accel_mps2 > -0.3]
    assert np.median(steered) == pytest.approx(math.atan(2.7 / 10.0), abs=0.01)  # the centre is on the left
    end = log[-1][0]
    assert math.hypot(end.x_m - trajectory.x_m[-1], end.y_m - trajectory.y_m[-1]) < 0.5


def test_a_reverse_trajectory_is_driven_to_its_end_and_no_further() -> None:
    trajectory = plant.straight(10.0, greatest_mps=2.0, stops_m=[0.0, 10.0])
    trajectory = replace(
        trajectory,
        x_m=-trajectory.x_m,
        speed_mps=-trajectory.speed_mps,
        time_from_start_ns=_with_a_late_end(trajectory),
    )
    log = plant.drive(following(trajectory), plant.Bicycle(), duration_s=20.0)
    assert log[-1][0].x_m == pytest.approx(-10.0, abs=0.05)
    assert log[-1][1].reason is Reason.PAST_END_SPACE


@pytest.mark.parametrize("has_a_point_without_speed", [True, False])
def test_it_drives_into_a_cusp_and_out_of_it_backwards(has_a_point_without_speed: bool) -> None:
    trajectory = plant.cusp()
    turn = 40
    if not has_a_point_without_speed:
        speed = trajectory.speed_mps.copy()
        speed[turn] = 0.2
        trajectory = replace(trajectory, speed_mps=speed)
    trajectory = replace(trajectory, time_from_start_ns=_with_a_late_end(trajectory))
    controller = following(trajectory)
    log = plant.drive(controller, plant.Bicycle(), duration_s=25.0)
    assert plant.lateral_errors(log, trajectory).max() < 0.05
    end = log[-1][0]
    assert (end.x_m, end.y_m) == pytest.approx((trajectory.x_m[-1], trajectory.y_m[-1]), abs=0.1)
    assert controller.spatial_index == len(trajectory) - 1
    assert log[-1][1].reason is Reason.PAST_END_SPACE
    # nowhere does the command ask for the gear against which it accelerates from rest
    assert not [
        c for s, c in log if abs(s.speed_mps) < 0.05 and c.speed_mps * c.accel_mps2 < 0.0 < abs(c.accel_mps2) < 0.5
    ]


@pytest.mark.parametrize(("config", "greatest_m"), [(CONFIG, 0.22), (FIRM, 0.17)])
def test_a_figure_of_eight_replanned_ten_times_a_second_is_followed(
    config: PurePursuitConfig, greatest_m: float
) -> None:
    whole = plant.figure_of_eight(laps=1)
    vehicle = plant.Bicycle(heading_rad=math.pi / 4)
    controller = PurePursuit(config)
    log = plant.drive(
        controller,
        vehicle,
        duration_s=whole.time_from_start_ns[-1] / NS_PER_S + 2.0,
        every_step=_receding_horizon(controller, vehicle, whole),
    )
    assert plant.lateral_errors(log, whole).max() < greatest_m
    assert vehicle.speed_mps == 0.0
    assert math.hypot(vehicle.x_m - whole.x_m[-1], vehicle.y_m - whole.y_m[-1]) < 0.3


def _with_a_late_end(trajectory: Trajectory) -> np.ndarray:
    """The times, the last one a minute later: the end is reached in space."""
    times = trajectory.time_from_start_ns.copy()
    times[-1] += 60 * NS_PER_S
    return times


def _receding_horizon(controller: ControllerBase, vehicle: plant.Bicycle, whole: Trajectory) -> Callable[[int], None]:
    """Plans the next 30 m every 0.1 s, from 1 m behind the vehicle on, timed as if it were where it is by
    plan."""
    nearest = 0

    def plan(stamp_ns: int) -> None:
        nonlocal nearest
        if stamp_ns % 100_000_000:
            return
        near = slice(nearest, nearest + 40)
        nearest += int(np.hypot(whole.x_m[near] - vehicle.x_m, whole.y_m[near] - vehicle.y_m).argmin())
        begin = max(nearest - 4, 0)
        part, times = slice(begin, begin + 124), whole.time_from_start_ns
        controller.set_trajectory(
            Trajectory(
                stamp_ns=stamp_ns - int(times[nearest] - times[begin]),
                time_from_start_ns=times[part] - times[begin],
                x_m=whole.x_m[part],
                y_m=whole.y_m[part],
                heading_rad=whole.heading_rad[part],
                speed_mps=whole.speed_mps[part],
            )
        )

    return plan
