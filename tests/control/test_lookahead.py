"""Finding the point to aim at, and what that costs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.control import PurePursuit, PurePursuitConfig
from vehicle_iface.control.lookahead import ArcLength, search_target
from vehicle_iface.control.tracking import PathProgress
from vehicle_iface.trajectory import Trajectory

from . import strategies
from .contract import at


class Counting:
    """A sequence that counts the values read off it."""

    def __init__(self, values: Any) -> None:
        self.values = np.ascontiguousarray(values).data
        self.reads = self.greatest = 0

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, key: Any) -> Any:
        got = self.values[key]
        self.reads += len(got) if isinstance(key, slice) else 1
        self.greatest = max(self.greatest, key.stop if isinstance(key, slice) else key)
        return got


def find_point_by_point(
    xs: Sequence[float], ys: Sequence[float], start: int, x: float, y: float, ahead: tuple[float, float], reach: float
) -> int:
    """The law, point by point."""
    farthest, greatest = -1, -1.0
    for i in range(start, len(xs)):
        dx, dy = xs[i] - x, ys[i] - y
        square = dx * dx + dy * dy
        if dx * ahead[0] + dy * ahead[1] > 0.0:
            if square >= reach * reach:
                return i
            if square > greatest:
                farthest, greatest = i, square
    return farthest


@given(
    points=st.lists(st.tuples(strategies.coordinates, strategies.coordinates), min_size=1, max_size=80),
    heading=strategies.angles,
    lookahead=st.floats(0.5, 150.0),
    start=st.integers(0, 79),
)
def test_the_search_finds_the_first_that_is_far_enough_or_the_farthest(
    points: list[tuple[float, float]], heading: float, lookahead: float, start: int
) -> None:
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    ahead, start = (math.cos(heading), math.sin(heading)), min(start, len(points) - 1)
    found = search_target(ArcLength(xs, ys), start, len(xs), 0.0, 0.0, *ahead, lookahead)
    assert found == find_point_by_point(xs, ys, start, 0.0, 0.0, ahead, lookahead)
    assert type(found) is int


@given(
    turn=st.floats(-0.5, 0.5),
    spacing_m=st.floats(0.01, 2.0),
    begin=st.integers(0, 500),
    step=st.integers(1, 60),
    left_m=st.floats(-3.0, 3.0),
    lookahead=st.floats(0.5, 20.0),
)
def test_along_a_winding_path_it_finds_what_a_walk_would(
    turn: float, spacing_m: float, begin: int, step: int, left_m: float, lookahead: float
) -> None:
    heading = 2.0 * np.sin(turn * spacing_m * np.arange(700))
    xs = np.cumsum(spacing_m * np.cos(heading)).tolist()
    ys = np.cumsum(spacing_m * np.sin(heading)).tolist()
    way = ArcLength(xs, ys)
    for start in range(begin, 700, step):
        ahead = math.cos(heading[start]), math.sin(heading[start])
        x, y = xs[start] - left_m * ahead[1], ys[start] + left_m * ahead[0]
        found = search_target(way, start, 700, x, y, *ahead, lookahead)
        expected = find_point_by_point(xs, ys, start, x, y, ahead, lookahead)
        if found != expected:  # two points equally far, but for the last bit
            assert math.hypot(xs[found] - x, ys[found] - y) == pytest.approx(
                math.hypot(xs[expected] - x, ys[expected] - y), abs=1e-6
            )


@pytest.mark.parametrize("spacing_m", [0.25, 0.02, 0.002, 1e-4])
def test_a_search_among_dense_points_finds_the_first_that_is_far_enough(spacing_m: float) -> None:
    xs = (np.arange(100_000) * spacing_m).tolist()
    found = search_target(ArcLength(xs, [0.0] * 100_000), 3, 100_000, 0.05, 0.0, 1.0, 0.0, 5.0)
    assert found == find_point_by_point(xs, [0.0] * 100_000, 3, 0.05, 0.0, (1.0, 0.0), 5.0)


def test_points_beyond_all_numbers_are_found_too() -> None:
    xs = [0.0, 1e300, 3.0, -1e308, 1e308, 1e160]
    assert search_target(ArcLength(xs, [0.0] * 6), 0, 6, 0.0, 0.0, 1.0, 0.0, 2.0) == 1
    assert search_target(ArcLength(xs, [0.0] * 6), 2, 6, 0.0, 0.0, 1.0, 0.0, 4.0) == 4


def test_a_search_does_not_go_round_and_round_for_the_whole_trajectory() -> None:
    angle = np.arange(100_000) * 0.1
    xs, ys = Counting(np.sin(angle)), Counting(1 - np.cos(angle))
    found = search_target(ArcLength(xs, ys), 0, len(xs), 0.0, 0.0, 1.0, 0.0, 5.0)  # type: ignore[arg-type]
    assert xs[found] > 0.0
    assert xs.greatest < 2000


@pytest.mark.parametrize(
    "x_m",
    [0.05 * np.arange(300_000), 1e-5 * np.arange(300_000), np.r_[0.0, np.full(299_999, 1.0)]],
    ids=["usual", "dense", "at one place"],
)
def test_each_point_is_measured_once_and_few_are_read_again(x_m: Any) -> None:
    xs, ys = Counting(x_m), Counting(np.zeros(len(x_m)))
    way = ArcLength(xs, ys)  # type: ignore[arg-type]
    expected = find_point_by_point(x_m.tolist(), [0.0] * len(x_m), 0, 0.5, 0.0, (1.0, 0.0), 2.0)
    for _ in range(12):
        before = xs.reads
        assert search_target(way, 0, len(xs), 0.5, 0.0, 1.0, 0.0, 2.0) == expected
        assert xs.reads - before < 2 * 2**15 + 5000
    assert xs.reads < 300_000 + 12 * 5000
    xs.reads = 0
    for k in range(100):
        search_target(way, 0, len(xs), 0.5 + k * 1e-6, 0.0, 1.0, 0.0, 2.0)
    assert xs.reads < 100 * 40


@pytest.mark.parametrize("spacing_m", [0.05, 1.0])
@pytest.mark.parametrize("n", [2_000, 200_000])
def test_following_reads_no_more_points_of_a_long_trajectory(n: int, spacing_m: float) -> None:
    controller = PurePursuit(PurePursuitConfig())
    zeros = np.zeros(n)
    controller.set_trajectory(
        Trajectory(
            stamp_ns=0,
            time_from_start_ns=np.arange(n) * 10**9,
            x_m=np.arange(n, dtype=np.float64) * spacing_m,
            y_m=zeros,
            heading_rad=zeros,
            speed_mps=zeros + 5.0,
        )
    )
    controller.compute_command(at(0.0, speed_mps=5.0))
    progress = controller._progress
    assert isinstance(progress, PathProgress)
    xs = progress.xs_m = controller._arc_length.xs_m = Counting(progress.xs_m)  # type: ignore[assignment]
    for k in range(500):
        assert not controller.compute_command(at(k * 0.05, speed_mps=5.0)).is_stop
    assert xs.reads < 500 * 20 + 1000
