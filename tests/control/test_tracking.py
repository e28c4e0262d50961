"""Where the vehicle stands, what that costs, and how far off it is."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vehicle_iface.control import ReferencePoint, point_at, tracking_error
from vehicle_iface.control.tracking import PathProgress, advance_in_blocks, advance_in_space, advance_in_time
from vehicle_iface.errors import FrameMismatchError, InvalidValueError
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import NS_PER_S

from . import strategies
from .contract import along_x, at


class Counting(list[Any]):
    """Counts the values that are read."""

    reads = 0

    def __getitem__(self, key: Any) -> Any:
        got = super().__getitem__(key)
        self.reads += len(got) if isinstance(key, slice) else 1
        return got


points = st.lists(st.tuples(strategies.coordinates, strategies.coordinates), min_size=1, max_size=400)
wide = st.floats(allow_nan=False, allow_infinity=False)


@given(points=points, x_m=strategies.coordinates, y_m=strategies.coordinates, data=st.data())
def test_blocks_walk_like_single_steps(
    points: list[tuple[float, float]], x_m: float, y_m: float, data: st.DataObject
) -> None:
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    index = data.draw(st.integers(0, len(points) - 1))
    assert advance_in_blocks(xs, ys, index, x_m, y_m) == _one_by_one(xs, ys, index, x_m, y_m)
    assert advance_in_space(xs, ys, index, x_m, y_m) == _one_by_one(xs, ys, index, x_m, y_m)


@given(points=st.lists(st.tuples(wide, wide), min_size=1, max_size=40), x_m=wide, y_m=wide)
def test_blocks_walk_like_single_steps_where_products_overflow(
    points: list[tuple[float, float]], x_m: float, y_m: float
) -> None:
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    assert advance_in_blocks(xs, ys, 0, x_m, y_m) == _one_by_one(xs, ys, 0, x_m, y_m)


@pytest.mark.parametrize("n", [1, 2, 33, 34, 97, 98, 99, 5000])
def test_a_far_jump_ends_at_the_first_point_that_is_not_passed(n: int) -> None:
    xs, ys = [float(i) for i in range(n)], [0.0] * n
    assert advance_in_space(xs, ys, 0, 1e9, 0.0) == n - 1
    for ahead in range(max(1, n - 40), n):
        assert advance_in_space(xs, ys, 0, ahead - 0.5, 0.0) == ahead - 1
        assert type(advance_in_space(xs, ys, 0, ahead - 0.5, 0.0)) is int


@pytest.mark.parametrize("spacing_m", [1.0, 0.1])
def test_the_tolerance_is_in_the_products_own_unit(spacing_m: float) -> None:
    xs, ys = [0.0, spacing_m, 2 * spacing_m], [0.0] * 3
    assert advance_in_space(xs, ys, 0, spacing_m - 0.99e-7 / spacing_m, 0.0) == 1
    assert advance_in_space(xs, ys, 0, spacing_m - 1.01e-7 / spacing_m, 0.0) == 0


@pytest.mark.parametrize("advanced", [advance_in_space, advance_in_blocks])
@pytest.mark.parametrize(("x_m", "index"), [(-1e-7, 1), (-1.0000001e-7, 0)])
def test_a_point_is_passed_when_the_product_is_the_tolerance_itself(advanced: Any, x_m: float, index: int) -> None:
    assert advanced([-1.0, 0.0], [0.0, 0.0], 0, x_m, 0.0) == index
    assert advanced([0.0, 0.0], [-1.0, 0.0], 0, 0.0, x_m) == index


@pytest.mark.parametrize("advanced", [advance_in_space, advance_in_blocks])
def test_whether_a_point_is_passed_is_asked_along_the_way_to_it_and_not_from_where_the_walk_began(
    advanced: Any,
) -> None:
    out_and_half_back, zeros = [0.0, 10.0, 5.0], [0.0] * 3
    assert advanced(out_and_half_back, zeros, 0, 11.0, 0.0) == 1
    assert advanced(zeros, out_and_half_back, 0, 0.0, 11.0) == 1


def test_points_at_one_place_are_passed_together() -> None:
    assert advance_in_space([0.0, 1.0, 1.0, 1.0, 2.0], [0.0] * 5, 0, 1.5, 0.0) == 3
    assert advance_in_space([0.0, 1.0, 1.0, 1.0, 2.0], [0.0] * 5, 0, 0.5, 0.0) == 0


def test_a_point_that_comes_back_past_one_that_is_not_passed_does_not_count() -> None:
    # the path goes to x = 10 and returns; the vehicle at x = 5 has not been at the far end
    xs = [float(i) for i in range(11)] + [float(i) for i in range(9, -1, -1)]
    assert advance_in_space(xs, [0.0] * len(xs), 0, 5.2, 0.0) == 5


@pytest.mark.parametrize("ahead", [0, 1, 5, 100, 3000])
def test_a_step_in_space_costs_the_points_that_it_advances_over(ahead: int) -> None:
    xs, ys = Counting(float(i) for i in range(100_000)), Counting([0.0] * 100_000)
    assert advance_in_space(xs, ys, 1000, 1000.5 + ahead, 0.0) == 1000 + ahead
    assert xs.reads + ys.reads <= 4 * (3 * ahead + 4)


@pytest.mark.parametrize("ahead", [0, 1, 5, 100, 3000])
def test_a_step_in_time_costs_no_more(ahead: int) -> None:
    times = Counting(range(100_000))
    assert advance_in_time(times, 1000, 1000 + ahead) == 1000 + ahead
    assert times.reads <= 3 * math.log2(ahead + 1) + 6


@given(steps=st.lists(st.integers(0, 3), min_size=1, max_size=200), elapsed=st.integers(-5, 700), data=st.data())
def test_the_index_in_time_is_the_last_point_whose_time_has_come(
    steps: list[int], elapsed: int, data: st.DataObject
) -> None:
    times = np.cumsum(steps).tolist()
    index = data.draw(st.integers(0, len(times) - 1))
    expected = max([index, *(i for i, time in enumerate(times) if time <= elapsed)])
    assert advance_in_time(times, index, elapsed) == expected


def one_point(x_m: float = 0.0, y_m: float = 0.0, heading_rad: float = 0.0, time_ns: int = 0) -> Trajectory:
    return Trajectory(
        stamp_ns=7,
        time_from_start_ns=np.array([time_ns], dtype=np.int64),
        x_m=np.array([x_m]),
        y_m=np.array([y_m]),
        heading_rad=np.array([heading_rad]),
        speed_mps=np.array([1.0]),
    )


ways = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))


@example(place=(2.0, 3.0), heading_rad=0.7, way=(-0.5, 4.0))
@given(place=ways, heading_rad=strategies.angles, way=ways)
def test_past_the_end_is_ahead_of_the_last_point_in_its_own_axes_wherever_to_the_side(
    place: tuple[float, float], heading_rad: float, way: tuple[float, float]
) -> None:
    ahead_m, left_m = way
    if abs(ahead_m) < 1e-6:  # on the plane itself rounding decides
        return
    x_m = place[0] + ahead_m * math.cos(heading_rad) - left_m * math.sin(heading_rad)
    y_m = place[1] + ahead_m * math.sin(heading_rad) + left_m * math.cos(heading_rad)
    assert PathProgress(one_point(*place, heading_rad)).is_past_end_in_space(x_m, y_m) is (ahead_m > 0.0)


@pytest.mark.parametrize(("x_m", "is_past"), [(-1e-7, True), (-1.0000001e-7, False)])
def test_the_end_is_passed_when_what_is_missing_is_the_tolerance_itself(x_m: float, is_past: bool) -> None:
    assert PathProgress(one_point()).is_past_end_in_space(x_m, 0.0) is is_past


def test_a_place_behind_the_plane_of_the_end_is_not_past_it_while_points_are_left() -> None:
    there_and_back = Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.array([0, 1, 2], dtype=np.int64),
        x_m=np.array([0.0, 10.0, 0.0]),
        y_m=np.array([0.0, 0.0, 1.0]),
        heading_rad=np.array([0.0, math.pi / 2, math.pi]),
        speed_mps=np.array([1.0] * 3),
    )
    progress = PathProgress(there_and_back)
    progress.advance(0, -1.0, 0.0)
    assert not progress.is_past_end_in_space(-1.0, 0.0)


@pytest.mark.parametrize(
    ("trajectory", "end_ns"),
    [(Trajectory.empty(stamp_ns=7), 7), (one_point(time_ns=5), 12), (along_x(stamp_ns=7), 10 * NS_PER_S + 7)],
)
def test_a_trajectory_ends_with_its_last_point_and_without_one_when_it_begins(
    trajectory: Trajectory, end_ns: int
) -> None:
    progress = PathProgress(trajectory)
    assert progress.is_past_end_in_time(end_ns)
    assert not progress.is_past_end_in_time(end_ns - 1)


def test_the_cached_lists_of_a_trajectory_equal_its_arrays() -> None:
    trajectory = along_x(speed_mps=2.5)
    progress = PathProgress(trajectory)
    assert (list(progress.xs_m), list(progress.ys_m)) == (trajectory.x_m.tolist(), trajectory.y_m.tolist())
    assert list(progress.speeds_mps) == trajectory.speed_mps.tolist()
    assert list(progress.times_ns) == trajectory.time_from_start_ns.tolist()


def test_the_error_is_state_minus_reference_in_the_references_axes() -> None:
    reference = ReferencePoint(
        stamp_ns=0, x_m=1.0, y_m=2.0, heading_rad=math.pi / 2, speed_mps=3.0, accel_mps2=0.5, yaw_rate_radps=0.1
    )
    state = VehicleState(
        stamp_ns=0, x_m=0.5, y_m=4.0, heading_rad=math.pi / 2 + 0.2, speed_mps=2.0, accel_mps2=1.0, yaw_rate_radps=0.4
    )
    error = tracking_error(state, reference)
    assert error.lateral_m == pytest.approx(0.5)  # x is to the right of a vehicle that looks along +y
    assert error.longitudinal_m == pytest.approx(2.0)
    assert error.heading_rad == pytest.approx(0.2)
    assert (error.speed_mps, error.accel_mps2) == (-1.0, 0.5)
    assert error.yaw_rate_radps == pytest.approx(0.3)


@given(state=strategies.states(), reference=strategies.states())
def test_the_heading_error_is_wrapped_and_distance_is_kept(state: VehicleState, reference: VehicleState) -> None:
    error = tracking_error(state, reference)
    assert -math.pi <= error.heading_rad <= math.pi
    assert math.cos(error.heading_rad) == pytest.approx(math.cos(state.heading_rad - reference.heading_rad), abs=1e-9)
    way_m = math.hypot(state.x_m - reference.x_m, state.y_m - reference.y_m)
    assert math.hypot(error.lateral_m, error.longitudinal_m) == pytest.approx(way_m)
    assert all(type(getattr(error, name)) is float for name in type(error).__struct_fields__)


def test_a_vehicle_on_its_reference_has_no_error() -> None:
    error = tracking_error(at(1.0), at(1.0))
    assert not any(getattr(error, name) for name in type(error).__struct_fields__)


def test_a_reference_without_a_frame_is_taken_to_be_in_the_states() -> None:
    shape = SimpleNamespace(x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0, accel_mps2=0.0, yaw_rate_radps=0.0)
    assert tracking_error(at(1.0), shape).longitudinal_m == 1.0


def test_a_reference_in_another_frame_is_refused() -> None:
    with pytest.raises(FrameMismatchError):
        tracking_error(at(0.0), point_at(along_x(frame_id="odom"), 0))


def test_a_reference_point_without_derivatives_is_one_of_steady_straight_driving() -> None:
    point = ReferencePoint(stamp_ns=0, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=1.0)
    assert (point.accel_mps2, point.yaw_rate_radps, point.front_wheel_angle_rad) == (0.0, 0.0, 0.0)


def test_a_point_of_a_trajectory_is_in_plain_numbers() -> None:
    point = point_at(along_x(stamp_ns=5), 3)
    assert (point.stamp_ns, point.x_m, point.speed_mps) == (3_000_000_005, 3.0, 1.0)
    assert type(point.stamp_ns) is int
    assert type(point.x_m) is float


@pytest.mark.parametrize("index", [-1, 11])
def test_a_point_that_is_not_there_is_refused(index: int) -> None:
    with pytest.raises(InvalidValueError, match=r"0\.\.10"):
        point_at(along_x(), index)


def _one_by_one(xs: list[float], ys: list[float], index: int, x_m: float, y_m: float) -> int:
    while index + 1 < len(xs):
        way = (xs[index + 1] - xs[index], ys[index + 1] - ys[index])
        if not way[0] * (x_m - xs[index + 1]) + way[1] * (y_m - ys[index + 1]) >= -1e-7:
            break
        index += 1
    return index
