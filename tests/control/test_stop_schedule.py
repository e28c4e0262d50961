"""Finding the places to stand at."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.control.stop_schedule import StopSchedule, find_stops
from vehicle_iface.control.tracking import PathProgress
from vehicle_iface.pieces import finish
from vehicle_iface.trajectory import Trajectory

POINTS = st.tuples(st.sampled_from([-2.0, 0.0, 1e-4, 0.5, 2.0]), st.booleans(), st.booleans())
"""Speed, and whether place and time are others than those of the point before."""


def stops_on(
    speeds_mps: Sequence[float],
    places_m: Sequence[float] | None = None,
    times_ns: Sequence[int] | None = None,
    index: int = 0,
) -> StopSchedule:
    """Of points at one place, 1 ns apart, unless told otherwise."""
    n = len(speeds_mps)
    progress = PathProgress(
        Trajectory(
            stamp_ns=0,
            time_from_start_ns=np.array(range(n) if times_ns is None else times_ns, dtype=np.int64),
            x_m=np.array([0.0] * n if places_m is None else places_m),
            y_m=np.array([0.0] * n),
            heading_rad=np.array([0.0] * n),
            speed_mps=np.array(speeds_mps),
        )
    )
    progress.spatial_index = index
    return StopSchedule(progress, finish(find_stops(progress.trajectory)))


def stop_of(stops: StopSchedule) -> tuple[int, int, bool]:
    return stops.first, stops.last, stops.turns


def test_a_dwell_is_a_stop() -> None:
    assert stop_of(stops_on([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])) == (2, 4, False)


@pytest.mark.parametrize(
    ("places_m", "times_ns"),
    [([0.0, 1.0, 1.0011, 2.0], [0, 1, 2, 3]), ([0.0, 1.0, 1.0, 2.0], [0, 1, 1, 3])],
    ids=["places apart", "no time"],
)
def test_points_without_speed_at_two_places_or_without_time_are_no_dwell(
    places_m: list[float], times_ns: list[int]
) -> None:
    assert stop_of(stops_on([1.0, 0.0, 0.0, 1.0], places_m, times_ns)) == (4, 4, False)


def test_a_millimetre_is_one_place() -> None:
    assert stop_of(stops_on([1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 1.0009, 2.0])) == (1, 2, False)


def test_one_point_without_speed_is_no_dwell() -> None:
    assert stop_of(stops_on([1.0, 0.0, 1.0])) == (3, 3, False)


def test_standing_after_the_last_motion_is_no_stop() -> None:
    assert stop_of(stops_on([1.0, 0.0, 0.0])) == (3, 3, False)
    assert stop_of(stops_on([0.0, 0.0])) == (2, 2, False)


def test_a_change_of_direction_is_a_stop_at_its_last_point() -> None:
    stops = stops_on([1.0, 1.0, -1.0, -1.0])
    assert stop_of(stops) == (1, 1, True)
    assert stops.direction == 1.0
    stops.release(1)
    assert stops.direction == -1.0
    assert stop_of(stops) == (4, 4, False)


def test_a_change_of_direction_with_a_point_without_speed_is_a_stop_there() -> None:
    assert stop_of(stops_on([1.0, 0.0, -1.0])) == (1, 1, True)


def test_a_dwell_where_the_direction_changes_is_one_stop() -> None:
    stops = stops_on([1.0, 0.0, 0.0, -1.0])
    assert stop_of(stops) == (1, 2, True)
    stops.release(1)
    assert stop_of(stops) == (4, 4, False)


def test_a_standing_start_is_a_dwell_without_a_change_of_direction() -> None:
    stops = stops_on([0.0, 0.0, -1.0])
    assert stops.direction == -1.0
    assert stop_of(stops) == (0, 1, False)


def test_a_vehicle_that_was_set_ahead_starts_afresh() -> None:
    stops = stops_on([1.0, 0.0, 0.0, -1.0, -1.0, -1.0], index=4)
    assert stops.direction == -1.0
    assert stop_of(stops) == (6, 6, False)


@pytest.mark.parametrize(("values", "direction"), [([0.0, 0.0], 1.0), ([0.0, -1.0], -1.0), ([0.5, -1.0], 1.0)])
def test_the_direction_is_that_of_the_first_speed(values: Sequence[float], direction: float) -> None:
    assert stops_on(values).direction == direction


@given(points=st.lists(POINTS, min_size=1, max_size=40))
def test_from_stop_to_stop_it_finds_every_dwell_and_every_change_of_direction(
    points: list[tuple[float, bool, bool]],
) -> None:
    speeds, places, times = [p[0] for p in points], [0.0], [0]
    for _, moves, lasts in points[1:]:
        places.append(places[-1] + moves)
        times.append(times[-1] + lasts)
    stops, found, index = stops_on(speeds, places, times), [], 0
    while stops.first < len(points):
        assert index <= stops.last
        found.append((stops.first, stops.last))
        moving = [speed * stops.direction for speed in speeds[index : stops.first] if abs(speed) > 1e-3]
        assert all(along > 0.0 for along in moving)
        index = stops.last + 1
        stops.release(0)
    assert all(speed * stops.direction > -1e-3 for speed in speeds[index:])
    assert [stop for stop in found if stop[0] < stop[1]] == _dwells(speeds, places, times)


def _dwells(speeds: list[float], places: list[float], times: list[int]) -> list[tuple[int, int]]:
    """Point by point."""
    moving = [i for i, speed in enumerate(speeds) if abs(speed) > 1e-3]
    found: list[tuple[int, int]] = []
    for i in range(moving[-1] if moving else 0):
        rests = abs(speeds[i]) <= 1e-3 and abs(speeds[i + 1]) <= 1e-3
        if rests and places[i] == places[i + 1] and times[i] < times[i + 1]:
            first = found.pop()[0] if found and found[-1][1] == i else i
            found.append((first, i + 1))
    return found
