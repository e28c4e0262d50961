"""Where a vehicle is on a path, compared with a search of every segment."""

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.harness import reference, straight
from vehicle_iface import Trajectory, VehicleState
from vehicle_iface.safety import path_distance
from vehicle_iface.safety.path_distance import BLOCK, MOST_BLOCKS, SEARCH_PERIOD_NS, WALK, WINDOW, PathLocator
from vehicle_iface.trajectories import ROUTES, make_route
from vehicle_iface.trajectory import FloatArray, IntArray

LIMITS = reference().profile.deviation
WARN_M, STOP_M, HEADING_RAD = LIMITS.lateral_warn_m, LIMITS.lateral_stop_m, LIMITS.heading_stop_rad
DRAWN = {name: make_route(name).to_trajectory() for name in ROUTES}
RADIUS_M = 15.0


def path(x_m: Any, y_m: Any, heading_rad: Any) -> Trajectory:
    """Points driven at 1 m/s."""
    x_m = np.asarray(x_m, dtype=float)
    return Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.arange(len(x_m)),
        x_m=x_m,
        y_m=y_m,
        heading_rad=np.broadcast_to(np.asarray(heading_rad, dtype=float), x_m.shape),
        speed_mps=np.ones(len(x_m)),
    )


def circle(points: int, laps: float = 1.0) -> Trajectory:
    """Laps to the left from the origin, closed."""
    angle = np.linspace(0.0, math.tau * laps, points)
    return path(RADIUS_M * np.sin(angle), RADIUS_M - RADIUS_M * np.cos(angle), angle)


def state(x_m: float, y_m: float, heading_rad: float = 0.0, stamp_ns: int = 0) -> VehicleState:
    return VehicleState(stamp_ns=stamp_ns, x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_mps=1.0)


def on_circle(turned_rad: float, outside_m: float = 0.0, stamp_ns: int = 0) -> VehicleState:
    """Round the lap so far, along it, and so far to its right."""
    radius_m = RADIUS_M + outside_m
    x_m, y_m = radius_m * math.sin(turned_rad), RADIUS_M - radius_m * math.cos(turned_rad)
    return state(x_m, y_m, math.remainder(turned_rad, math.tau), stamp_ns)


def locator(trajectory: Trajectory, index: int = 0) -> PathLocator:
    return PathLocator(trajectory, LIMITS, index=index)


def is_near(found: PathLocator, here: VehicleState, index: int = 0) -> bool:
    return found.is_near(index, here.x_m, here.y_m, here.heading_rad)


def distances(trajectory: Trajectory, here: VehicleState) -> tuple[float, float]:
    """To the nearest segment, and to the nearest one that the vehicle is on; every one is looked at."""
    p = np.stack([trajectory.x_m, trajectory.y_m])
    a, b = p[:, : max(len(trajectory) - 1, 1)], p[:, min(1, len(trajectory) - 1) :]
    edge, away = b - a, np.array([[here.x_m], [here.y_m]]) - a
    square = (edge**2).sum(axis=0)
    part = np.clip((edge * away).sum(axis=0) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    distance_m = np.hypot(*(away - part * edge))
    off_rad = np.abs(np.angle(np.exp(1j * (trajectory.heading_rad - here.heading_rad))))
    fits = np.minimum(off_rad[: a.shape[1]], off_rad[-b.shape[1] :]) <= HEADING_RAD
    around = np.pad(distance_m, 1, constant_values=np.inf) ** 2 + 1e-6
    is_on = fits & (distance_m**2 <= np.minimum(around[:-2], around[2:])) & (distance_m <= STOP_M)
    return float(distance_m.min()), float(np.where(is_on, distance_m, np.inf).min())


def assert_is_found(found: PathLocator, here: VehicleState, index: int, *, after_search: bool) -> None:
    """What the locator says is what a search of every segment says."""
    nearest_m, nearest_on_m = distances(found.trajectory, here)
    if is_near(found, here, index):
        assert nearest_m <= WARN_M + 1e-9
        return
    place = found.locate(here, may_begin_stop=True)
    assert place.is_on is (nearest_on_m <= STOP_M)
    expected_m = nearest_on_m if place.is_on else nearest_m
    assert place.distance_m >= expected_m - 1e-6
    if not place.is_on or (after_search and place.distance_m > WARN_M):
        assert place.distance_m == pytest.approx(expected_m, abs=1e-6)
    assert place.is_on is (place.distance_m <= STOP_M and place.heading_error_rad <= HEADING_RAD)


# Distances


@pytest.mark.parametrize(
    ("x_m", "y_m", "segment", "distance_m"),
    [
        (-4.0, 3.0, 0, 5.0),  # before the first point
        (104.0, -3.0, 99, 5.0),  # behind the last one
        (10.25, 2.5, 10, 2.5),
        (10.25, -2.5, 10, 2.5),
        (0.0, 2.0, 0, 2.0),
        (100.0, 2.0, 99, 2.0),
    ],
)
def test_the_distance_is_along_the_path_as_well_as_beside_it(
    x_m: float, y_m: float, segment: int, distance_m: float
) -> None:
    place = locator(straight(length_m=100.0)).locate(state(x_m, y_m), may_begin_stop=True)
    assert place.segment == segment
    assert place.distance_m == pytest.approx(distance_m)
    assert place.is_on is (distance_m <= STOP_M)


@pytest.mark.parametrize(("x_m", "is_found"), [(-1.0, True), (-1.001, False), (101.0, True), (101.001, False)])
def test_before_the_first_point_and_behind_the_last_near_ends_at_the_warning(x_m: float, is_found: bool) -> None:
    assert is_near(locator(straight(length_m=100.0)), state(x_m, 0.0), 0 if x_m < 0.0 else 100) is is_found


@pytest.mark.parametrize("heading_rad", [0.0, 1.5, -0.8, math.pi])
def test_a_path_of_one_point_is_a_segment_without_length(heading_rad: float) -> None:
    found, fits = locator(path([5.0], [1.0], heading_rad)), abs(heading_rad) <= HEADING_RAD
    assert is_near(found, state(5.6, 1.8), 0) is fits
    place = found.locate(state(5.0, 3.5), may_begin_stop=True)
    assert (place.segment, place.distance_m, place.is_on) == (0, 2.5, fits)
    assert place.heading_error_rad == pytest.approx(abs(heading_rad))


def test_points_at_one_place_have_the_distance_of_that_place() -> None:
    found = locator(path([0.0, 2.0, 2.0, 2.0, 4.0], np.zeros(5), 0.0))
    assert is_near(found, state(2.5, 0.5), 1)
    assert not is_near(found, state(2.0, 1.1), 1)
    assert found.locate(state(2.0, 1.1), may_begin_stop=True).distance_m == pytest.approx(1.1)


@pytest.mark.parametrize("far", [1e150, -1e160, 1e308])
def test_coordinates_whose_squares_overflow_raise_nothing_and_are_far_away(far: float) -> None:
    wild = path([-far, far, 0.0, far], [far, -far, far, far], [0.0, 1.0, -3.0, 3.0])
    for index, here in enumerate((state(0.0, 0.0), state(far, 1.0), state(-1.0, -far), state(far, far))):
        found = locator(wild, index)
        is_near(found, here, index)
        assert found.locate(here, may_begin_stop=True).distance_m >= 0.0
    place = locator(path([far, far], [far, -far], 0.0)).locate(state(0.0, 0.0), may_begin_stop=True)
    assert (place.distance_m >= 1e150, place.is_on) == (True, False)


# Near


@pytest.mark.parametrize(
    ("index", "x_m", "segment"),
    [
        (20, 20.0, 20),
        (20, 20.999, 20),
        (20, 21.0, 21),
        (20, 20.5 + WALK, 20 + WALK),
        (20, 21.0 + WALK, None),
        (20, 19.999, 19),
        (20, 20.0 - WALK, 20 - WALK),
        (20, 19.999 - WALK, None),
        (0, -0.5, 0),
        (3, -0.5, 0),
        (37, 40.5, 39),
        (39, 40.5, 39),
        (40, 40.5, 39),
        (40, 38.5, 38),
    ],
)
def test_from_the_index_the_vehicles_segment_is_found_a_few_segments_on_and_back(
    index: int, x_m: float, segment: int | None
) -> None:
    for elsewhere in (0, 39):
        found = locator(straight(length_m=40.0), elsewhere)
        if segment is None or abs(segment - elsewhere) > WALK:
            assert is_near(found, state(x_m, 0.5), index) is (segment is not None)
            assert found.segment == (elsewhere if segment is None else segment)
        found = locator(straight(length_m=40.0), index)
        assert is_near(found, state(x_m, 0.5), elsewhere) is (segment is not None)
        assert found.segment == (min(index, 39) if segment is None else segment)


@pytest.mark.parametrize("start", range(24))
def test_on_a_coarse_curve_the_vehicles_segment_is_found_a_few_segments_on_and_back(start: int) -> None:
    lap = circle(25)
    for segment in range(max(start - WALK, 0), min(start + WALK + 1, 24)):
        for part in (0.1, 0.5, 0.9):
            found, here = locator(lap, start), on_circle((segment + part) * math.tau / 24, 0.1)
            assert is_near(found, here, start)
            assert found.segment == segment


def segment_beside(line: Any, start: int, position: Any) -> int:
    """On from a segment while its second point is passed; else back while its first one is not. `line` is (n, 2)."""

    def is_past(point: int) -> bool:
        return float((line[point] - line[point - 1]) @ (position - line[point])) >= 0.0

    i = start
    while i < len(line) - 2 and is_past(i + 1):
        i += 1
    while 0 < i <= start and not is_past(i):
        i -= 1
    return i


@given(st.integers(0, 2**32 - 1))
def test_on_a_zigzag_the_segment_is_the_one_whose_first_point_is_passed_and_whose_second_is_not(seed: int) -> None:
    dice = np.random.default_rng(seed)
    line = np.cumsum(dice.integers(-3, 4, (12, 2)), axis=0) * 0.5
    zigzag = path(line[:, 0], line[:, 1], 0.0)
    for start in range(11):
        position = line[start] + dice.uniform(-1.0, 1.0, 2)
        found, here = locator(zigzag, start), state(float(position[0]), float(position[1]))
        expected = segment_beside(line, start, position)
        if is_near(found, here, start):
            assert found.segment == expected
            assert abs(expected - start) <= WALK


def test_the_warning_is_that_of_the_limits() -> None:
    strict = PathLocator(straight(length_m=40.0), msgspec.structs.replace(LIMITS, lateral_warn_m=0.5), index=0)
    assert is_near(strict, state(10.5, 0.5), 10)
    assert not is_near(strict, state(10.5, 0.501), 10)


@pytest.mark.parametrize("turned_rad", [0.0, 1.0, -2.2, 3.0])
def test_near_is_within_the_warning_of_the_segment_whichever_way_it_leads(turned_rad: float) -> None:
    """Of a line with a point each 10 m."""
    cos, sin, along_m = math.cos(turned_rad), math.sin(turned_rad), np.arange(5) * 10.0
    line = path(along_m * cos, along_m * sin, turned_rad)
    for x_m, y_m, expected in (
        *(
            (x_m, side * y_m, y_m < 1.0)
            for x_m in (0.0, 3.0, 17.0, 40.0)
            for y_m in (0.97, 1.03)
            for side in (-1.0, 1.0)
        ),
        (-0.57, 0.77, True),
        (-0.57, 0.87, False),
        (-0.67, -0.77, False),
        (40.57, 0.77, True),
        (40.57, 0.87, False),
        (40.67, -0.77, False),
    ):
        here = state(cos * x_m - sin * y_m, sin * x_m + cos * y_m, turned_rad)
        for index in range(5):
            assert is_near(locator(line), here, index) is expected, (x_m, y_m, index)


@pytest.mark.parametrize(
    ("segment", "heading_rad", "expected"),
    [
        (0, 0.8, True),
        (0, -0.8, True),
        (0, -0.81, False),
        (0, 1.8, True),
        (0, 1.81, False),
        (0, 0.8 - math.tau, True),
        (1, 0.3, True),
        (1, 0.19, False),
        (1, 2.7, True),
        (1, 2.81, False),
        (2, 3.7 - math.tau, True),
        (2, 1.1, False),
    ],
)
def test_near_is_within_the_limit_of_the_heading_at_either_end_of_the_segment(
    segment: int, heading_rad: float, expected: bool
) -> None:
    turning = path([0.0, 10.0, 20.0, 30.0], np.zeros(4), [0.0, 1.0, 2.0, 3.0])
    here = state(5.0 + 10.0 * segment, 0.0, heading_rad)
    assert is_near(locator(turning), here, segment) is expected
    place = locator(turning).locate(here, may_begin_stop=True)
    assert (place.segment, place.distance_m, place.is_on) == (segment, 0.0, expected)


def test_on_the_outside_of_a_corner_its_point_is_near_and_on_the_inside_the_nearer_side() -> None:
    corner = path([0.0, 10.0, 10.0], [0.0, 0.0, 10.0], [0.0, math.pi / 4, math.pi / 2])
    for x_m, y_m, segment in ((10.6, -0.7, 1), (9.4, 0.3, 0), (9.7, 0.6, 1)):
        for index in (0, 1):
            assert is_near(locator(corner), state(x_m, y_m, math.pi / 4), index)
        place = locator(corner).locate(state(x_m, y_m, math.pi / 4), may_begin_stop=True)
        assert place.is_on
        assert place.distance_m == pytest.approx(distances(corner, state(x_m, y_m, math.pi / 4))[1])
        assert place.segment == segment or x_m > 10.0
    assert not is_near(locator(corner), state(10.8, -0.7, math.pi / 4), 0)


# Compared with every segment


POINTS = st.lists(
    st.tuples(
        st.sampled_from([0.0, 1.0, 2.5, -3.0, 40.0]) | st.floats(-60.0, 60.0),
        st.sampled_from([0.0, 0.5, -2.0]) | st.floats(-60.0, 60.0),
        st.floats(-4.0, 4.0),
    ),
    min_size=1,
    max_size=40,
)
PLACES = st.tuples(st.floats(-70.0, 70.0), st.floats(-70.0, 70.0), st.floats(-math.pi, math.pi))


@given(POINTS, PLACES, st.integers(0, 40))
@settings(max_examples=200)
def test_on_any_path_the_first_answer_is_that_of_a_search_of_every_segment(
    points: list[tuple[float, float, float]], place: tuple[float, float, float], index: int
) -> None:
    x_m, y_m, heading_rad = (np.array(column) for column in zip(*points, strict=True))
    found = locator(path(x_m, y_m, heading_rad))
    assert_is_found(found, state(*place), min(index, len(points) - 1), after_search=True)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3 * WINDOW + BLOCK), st.integers(0, 1000))
@settings(max_examples=200)
def test_on_a_long_path_that_winds_about_it_is_as_well(seed: int, points: int, index: int) -> None:
    """Of several blocks and more than one window."""
    dice = np.random.default_rng(seed)
    heading_rad = np.cumsum(dice.normal(0.0, 0.2, points))
    step_m = dice.uniform(0.0, 0.6, points)
    winding = path(np.cumsum(step_m * np.cos(heading_rad)), np.cumsum(step_m * np.sin(heading_rad)), heading_rad)
    for at in dice.integers(0, points, 5).tolist():
        x_m, y_m = winding.x_m[at] + dice.normal(0.0, 2.0), winding.y_m[at] + dice.normal(0.0, 2.0)
        turned_rad = math.remainder(float(heading_rad[at] + dice.normal(0.0, 0.7)), math.tau)
        found = locator(winding, min(index, points - 1))
        assert_is_found(found, state(float(x_m), float(y_m), turned_rad), found.segment, after_search=True)


@given(
    st.sampled_from(sorted(ROUTES)),
    st.floats(0.0, 1.0),
    st.lists(st.tuples(st.floats(0.0, 3.0), st.floats(-1.0, 1.0), st.floats(-0.3, 0.3)), min_size=1, max_size=60),
    st.sampled_from(["stuck", "ahead", "with it"]),
)
def test_along_every_route_the_place_is_followed_wherever_the_controllers_index_is(
    name: str, begin: float, steps: list[tuple[float, float, float]], index_is: str
) -> None:
    """It goes on along the route, and drifts off it sideways and in heading."""
    route, aside_m, turned_rad = DRAWN[name], 0.0, 0.0
    found, at = locator(route), begin * (len(route) - 1)
    for number, (ahead, aside, turn) in enumerate(steps):
        at = min(at + ahead, len(route) - 1.001)
        aside_m, turned_rad = aside_m + aside, turned_rad + turn
        i, part = int(at), at % 1.0
        heading_rad = float(route.heading_rad[i])
        here = state(
            float(route.x_m[i] + part * (route.x_m[i + 1] - route.x_m[i])) - aside_m * math.sin(heading_rad),
            float(route.y_m[i] + part * (route.y_m[i + 1] - route.y_m[i])) + aside_m * math.cos(heading_rad),
            math.remainder(heading_rad + turned_rad, math.tau),
            number * SEARCH_PERIOD_NS // 10,
        )
        index = {"stuck": 0, "ahead": len(route) - 1, "with it": i}[index_is]
        assert_is_found(found, here, index, after_search=False)


# Which of several stretches


@pytest.mark.parametrize("points", [200, 2_000, 200_000])
@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_a_vehicle_anywhere_round_a_closed_lap_is_on_its_path(points: int, part: float) -> None:
    found, here = locator(circle(points)), on_circle(part * math.tau)
    near = is_near(found, here, 0)
    place = found.locate(here, may_begin_stop=True)
    assert place.distance_m == pytest.approx(0.0, abs=0.01)
    assert place.heading_error_rad == pytest.approx(0.0, abs=0.04)
    assert near is (part in (0.0, 1.0))
    assert is_near(found, here, 0)


def test_at_a_crossing_of_the_path_the_stretch_along_the_heading_counts() -> None:
    cross = path(
        [-20.0, 20.0, 30.0, 0.0, 0.0], [0.0, 0.0, 20.0, 20.0, -20.0], [0.0, 0.0, math.pi, math.pi, -math.pi / 2]
    )
    for heading_rad, y_m, segment in ((0.0, 0.4, 0), (-math.pi / 2, 0.1, 3)):
        found = locator(cross)
        place = found.locate(state(0.3, y_m, heading_rad), may_begin_stop=True)
        assert (place.segment, place.is_on) == (segment, True)
        assert place.distance_m == pytest.approx(y_m if segment == 0 else 0.3)


def test_the_opposite_lane_is_not_the_vehicles_own() -> None:
    there_and_back = path(
        [0.0, 50.0, 55.0, 50.0, 0.0], [0.0, 0.0, 2.0, 4.0, 4.0], [0.0, 0.0, math.pi / 2, math.pi, math.pi]
    )
    place = locator(there_and_back).locate(state(20.0, 2.9), may_begin_stop=True)
    assert (place.segment, place.is_on) == (0, True)
    assert place.distance_m == pytest.approx(2.9)
    place = locator(there_and_back).locate(state(20.0, 3.1), may_begin_stop=True)
    assert (place.segment, place.is_on) == (3, False)
    assert place.distance_m == pytest.approx(0.9)
    assert place.heading_error_rad == pytest.approx(math.pi)


def test_a_vehicle_that_leaves_its_stretch_sideways_is_off_the_path_before_it_comes_to_another_one() -> None:
    route = DRAWN["u_turn"]
    found, distances_m = locator(route), []
    for number in range(160):
        here = state(5.0, 0.1 * number, 0.0, number * 10_000_000)
        near = is_near(found, here, 20)
        distances_m.append(0.0 if near else found.locate(here, may_begin_stop=False).distance_m)
    assert max(distances_m) > 7.0
    assert sum(distance_m > STOP_M for distance_m in distances_m) > 90


# Cost


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many segments each comparison in NumPy looks at."""
    counts: list[int] = []
    nearest = PathLocator._nearest

    def counted(self: PathLocator, first: IntArray, length: int, here: VehicleState) -> Any:
        counts.append(len(first) * length)
        return nearest(self, first, length, here)

    monkeypatch.setattr(PathLocator, "_nearest", counted)
    return counts


class Counted:
    """A sequence that counts what is read of it."""

    def __init__(self, values: Sequence[float]) -> None:
        self.values, self.read = values, 0

    def __getitem__(self, index: int) -> float:
        self.read += 1
        return self.values[index]


@pytest.mark.parametrize("points", [1_000, 100_000, 1_000_000])
def test_however_long_the_path_is_a_vehicle_near_it_costs_two_segments_and_one_that_is_not_a_few_blocks(
    points: int, looked_at: list[int]
) -> None:
    x_m = np.arange(points) * 0.5
    found, middle_m = locator(path(x_m, np.zeros(points), 0.0)), float(x_m[points // 2])
    found._xs_m = reads = Counted(found._xs_m)  # type: ignore[assignment]
    for number in range(100):
        assert is_near(found, state(middle_m + 0.05 * number, 0.5), points // 2 + number // 10)
    assert not looked_at
    assert reads.read <= 100 * 12
    reads.read = 0
    for number in range(100):
        here = state(middle_m + 5.0 + 0.05 * number, 2.0, 0.0, number * 10_000_000)
        assert not is_near(found, here, 0)
        assert found.locate(here, may_begin_stop=False).distance_m == pytest.approx(2.0)
    assert reads.read <= 100 * 60
    windows = [count for count in looked_at if count == 2 * WINDOW + 1]
    assert len(windows) == 100
    assert len(looked_at) - len(windows) <= 10 * 2  # ten searches in a second, each of the nearest block and of others
    assert max(looked_at) <= 8 * BLOCK


def test_between_two_searches_of_the_whole_path_a_tenth_of_a_second_passes(looked_at: list[int]) -> None:
    found = locator(circle(100_000))
    searches = []
    for stamp_ns in range(0, 1_000_000_000, 10_000_000):
        looked_at.clear()
        found.locate(on_circle(1.0, 2.0, stamp_ns), may_begin_stop=False)
        if len(looked_at) > 1:
            searches.append(stamp_ns)
    assert searches == list(range(0, 1_000_000_000, 100_000_000))
    looked_at.clear()
    found.locate(on_circle(1.0, 2.0, 0), may_begin_stop=False)  # a vehicle that counts from 0 again
    assert len(looked_at) > 1


def test_a_stop_is_begun_only_after_a_search_of_the_whole_path_and_is_not_searched_for_again(
    looked_at: list[int],
) -> None:
    found = locator(circle(100_000))
    assert found.locate(on_circle(0.0, 2.0), may_begin_stop=True).is_on
    looked_at.clear()
    assert found.locate(on_circle(0.0, 2.0), may_begin_stop=True).is_on  # in the same instant
    assert len(looked_at) == 1
    assert found.locate(on_circle(2.0), may_begin_stop=True).is_on  # set elsewhere, in the same instant
    assert len(looked_at) > 2
    looked_at.clear()
    assert not found.locate(on_circle(4.0), may_begin_stop=False).is_on
    assert len(looked_at) == 1
    assert found.locate(on_circle(4.0, stamp_ns=SEARCH_PERIOD_NS), may_begin_stop=False).is_on


def test_with_all_segments_equally_near_only_the_nearest_blocks_are_searched(looked_at: list[int]) -> None:
    found = locator(circle(300_000, laps=300.0))
    place = found.locate(state(0.0, RADIUS_M), may_begin_stop=True)
    assert place.distance_m == pytest.approx(RADIUS_M, abs=0.01)
    assert not place.is_on
    assert sum(looked_at) <= (MOST_BLOCKS + 1) * BLOCK + 2 * WINDOW + 1


def test_a_place_near_the_path_ends_a_search(looked_at: list[int]) -> None:
    found = locator(circle(300_000, laps=300.0))
    assert found.locate(on_circle(2.0), may_begin_stop=True).distance_m == pytest.approx(0.0, abs=0.01)
    assert sum(looked_at) <= 2 * WINDOW + 1 + (1 + path_distance._BLOCKS_AT_ONCE) * BLOCK


def test_the_boxes_of_a_path_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    computed: list[int] = []
    compute_boxes = path_distance.compute_boxes

    def counted(x_m: FloatArray, y_m: FloatArray) -> object:
        computed.append(len(x_m))
        return compute_boxes(x_m, y_m)

    monkeypatch.setattr(path_distance, "compute_boxes", counted)
    found = locator(circle(1000))
    assert is_near(found, on_circle(0.0))
    assert computed == []
    for number in range(3):
        found.locate(on_circle(1.0, 2.0, number * SEARCH_PERIOD_NS), may_begin_stop=False)
    assert computed == [1000]


def test_a_place_at_the_warning_needs_no_search(looked_at: list[int]) -> None:
    found = locator(straight(length_m=100.0))
    assert not is_near(found, state(60.5, 1.0), 0)
    assert found.locate(state(60.5, 1.0), may_begin_stop=True).distance_m == WARN_M
    assert len(looked_at) == 1
    assert found.locate(state(60.5, 1.001), may_begin_stop=True).distance_m == pytest.approx(1.001)
    assert len(looked_at) > 2


def test_a_block_is_looked_at_when_its_box_is_no_further_away_than_what_was_found() -> None:
    """Two lanes in the same direction, each in a block whose box holds the vehicle: the second one is nearer."""
    lane_m = np.arange(120) * 0.5
    x_m = np.concatenate([lane_m, np.linspace(60.0, 80.0, 8), [-20.0], lane_m])
    y_m = np.concatenate([np.full(120, 1.2), np.linspace(1.0, -10.0, 8), [30.0], np.full(120, -1.1)])
    place = locator(path(x_m, y_m, 0.0)).locate(state(30.0, 0.0), may_begin_stop=True)
    assert place.distance_m == pytest.approx(1.1)
    assert place.segment >= BLOCK


def test_once_the_vehicle_is_found_on_the_path_only_nearer_blocks_are_looked_at(looked_at: list[int]) -> None:
    lanes = path(np.tile(np.arange(400) * 0.5, 20), np.repeat(2.0 + 0.01 * np.arange(20), 400), 0.0)
    assert locator(lanes).locate(state(100.0, 0.0), may_begin_stop=True).distance_m == pytest.approx(2.0)
    everything, searched = looked_at[0], sum(looked_at[1:])
    assert everything == 2 * WINDOW + 1
    assert searched <= 8 * BLOCK


def test_as_many_blocks_as_may_be_looked_at_are() -> None:
    lap = circle(MOST_BLOCKS * BLOCK + 1, laps=100.0)
    assert locator(lap).locate(state(0.0, RADIUS_M), may_begin_stop=True).distance_m == pytest.approx(
        RADIUS_M, abs=0.01
    )
