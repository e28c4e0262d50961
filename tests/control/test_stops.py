"""Finding the places to stand at, in one pass."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.control.stops import Stops

speeds = st.lists(st.sampled_from([-2.0, -0.5, 0.0, 1e-4, 0.5, 2.0]), min_size=1, max_size=40)


def stop_of(stops: Stops) -> tuple[int | None, int, bool]:
    return stops.first, stops.last, stops.turns


def test_a_run_without_speed_is_one_stop() -> None:
    stops = Stops([1.0, 1.0, 0.0, 0.0, 0.0, 1.0], 0)
    assert not stops.look(0, 1)
    assert stops.look(0, 2)
    assert stop_of(stops) == (2, 4, False)
    assert stops.must_stand


def test_a_change_of_direction_is_a_stop_at_its_last_point() -> None:
    stops = Stops([1.0, 1.0, -1.0, -1.0], 0)
    assert stops.look(0, 3)
    assert stop_of(stops) == (1, 1, True)
    stops.release()
    assert stops.direction == -1.0
    assert not stops.look(1, 3)


def test_a_standing_start_asks_for_its_time_only() -> None:
    stops = Stops([0.0, 0.0, -1.0], 0)
    assert stops.direction == -1.0
    assert stops.look(0, 0)
    assert stop_of(stops) == (0, 1, False)
    assert not stops.must_stand


def test_a_stop_that_was_seen_stays_until_it_is_released() -> None:
    stops = Stops([1.0, 0.0, 1.0, 1.0, 0.0], 0)
    assert stops.look(0, 2)
    assert stops.look(3, 4)
    assert stops.first == 1
    stops.release()
    assert stops.look(3, 4)
    assert stops.first == 4


def test_a_vehicle_that_was_set_ahead_starts_afresh() -> None:
    stops = Stops([1.0, 0.0, -1.0, -1.0, -1.0, 0.0], 0)
    assert not stops.look(4, 4)
    assert stops.direction == -1.0


@pytest.mark.parametrize(("values", "direction"), [([0.0, 0.0], 1.0), ([0.0, -1.0], -1.0), ([0.5, -1.0], 1.0)])
def test_the_direction_is_that_of_the_first_speed(values: Sequence[float], direction: float) -> None:
    assert Stops(values, 0).direction == direction


@given(speeds=speeds)
def test_from_stop_to_stop_the_speed_keeps_its_sign(speeds: list[float]) -> None:
    stops, at, last = Stops(speeds, 0), 0, len(speeds) - 1
    while stops.look(at, last):
        assert stops.first is not None
        assert at <= stops.first + 1 <= stops.last + 1 <= last + 1
        assert all(speed * stops.direction > 1e-3 for speed in speeds[at : stops.first])
        at = stops.last + 1
        stops.release()
    assert all(speed * stops.direction > 1e-3 for speed in speeds[at:])


@given(speeds=speeds)
def test_looking_step_by_step_finds_the_same_as_looking_at_once(speeds: list[float]) -> None:
    once, stepwise, last = Stops(speeds, 0), Stops(speeds, 0), len(speeds) - 1
    once.look(0, last)
    for until in range(last + 1):
        stepwise.look(0, until)
    assert stop_of(once) == stop_of(stepwise)
