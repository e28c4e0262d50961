"""Points that do not lead on: recording noise is taken out, anything else is refused, and nothing sound is touched."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.harness import reference
from vehicle_iface import Trajectory, VehicleState, drivable
from vehicle_iface.control.tracking import PathProgress
from vehicle_iface.errors import BackwardStepError, ConfigError
from vehicle_iface.pieces import slices
from vehicle_iface.safety.feasibility import find_violation
from vehicle_iface.trajectories import (
    RecedingRoute,
    RouteConfig,
    cleaning,
    drop_backward_steps,
    load_csv,
    make_route,
    save_csv,
)
from vehicle_iface.trajectories.cleaning import NOISE_M, find_backward_step
from vehicle_iface.trajectories.shapes import ROUTES
from vehicle_iface.trajectory import IntArray

COLUMNS = (
    "time_from_start_ns",
    "x_m",
    "y_m",
    "heading_rad",
    "speed_mps",
    "accel_mps2",
    "yaw_rate_radps",
    "front_wheel_angle_rad",
)
DRAWN = {
    (name, spacing_m): make_route(name, RouteConfig(point_spacing_m=spacing_m)).to_trajectory()
    for name in sorted(ROUTES)
    for spacing_m in (0.25, 0.05)
}


def path(x_m: Any, y_m: Any = 0.0, **columns: Any) -> Trajectory:
    """Points 0.1 s apart, along +x at 2 m/s unless the columns say otherwise."""
    x_m = np.asarray(x_m, dtype=float)
    given: dict[str, Any] = {"y_m": y_m, "heading_rad": 0.0, "speed_mps": 2.0} | columns
    full = {name: np.broadcast_to(np.asarray(values, dtype=float), x_m.shape) for name, values in given.items()}
    return Trajectory(stamp_ns=7, frame_id="odom", time_from_start_ns=np.arange(len(x_m)) * 10**8, x_m=x_m, **full)


def changed(trajectory: Trajectory, **columns: Any) -> Trajectory:
    return Trajectory(
        stamp_ns=trajectory.stamp_ns,
        frame_id=trajectory.frame_id,
        **{name: getattr(trajectory, name) for name in COLUMNS} | columns,
    )


def same(one: Trajectory, other: Trajectory) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in COLUMNS)


def turned(trajectory: Trajectory, by_rad: float) -> Trajectory:
    """The same path elsewhere, leading another way."""
    cos, sin = math.cos(by_rad), math.sin(by_rad)
    return changed(
        trajectory,
        x_m=5.0 + cos * trajectory.x_m - sin * trajectory.y_m,
        y_m=-3.0 + sin * trajectory.x_m + cos * trajectory.y_m,
        heading_rad=trajectory.heading_rad + by_rad,
    )


def noisy(trajectory: Trajectory, noise_m: float, seed: int) -> Trajectory:
    """Return a measured trajectory, with noise."""
    dice, count = np.random.default_rng(seed), len(trajectory)
    x_m, y_m = (values + dice.uniform(-noise_m, noise_m, count) for values in (trajectory.x_m, trajectory.y_m))
    return changed(trajectory, x_m=x_m, y_m=y_m)


def reaches_its_end(trajectory: Trajectory, along: Trajectory, step_m: float = 0.2, beside_m: float = 0.0) -> bool:
    """Whether the index comes to the last point when a vehicle drives along another path, and 1 m on at its end.

    It is sampled each `step_m`, and drives `beside_m` to the left.
    """
    progress, x_m, y_m, heading_rad = PathProgress(trajectory), along.x_m, along.y_m, along.heading_rad
    way = -1.0 if along.speed_mps.max() <= 0.0 else 1.0
    x_m = np.append(x_m, x_m[-1] + way * math.cos(heading_rad[-1]))
    y_m = np.append(y_m, y_m[-1] + way * math.sin(heading_rad[-1]))
    for i, heading in enumerate(heading_rad.tolist()):
        ex_m, ey_m = x_m[i + 1] - x_m[i], y_m[i + 1] - y_m[i]
        left_x_m, left_y_m = -beside_m * math.sin(heading), beside_m * math.cos(heading)
        count = max(1, math.ceil(math.hypot(ex_m, ey_m) / step_m))
        for part in np.arange(1, count + 1) / count:
            progress.advance(0, float(x_m[i] + part * ex_m + left_x_m), float(y_m[i] + part * ey_m + left_y_m))
    return progress.spatial_index == progress.last


# What is sound is left alone


@pytest.mark.parametrize(("name", "spacing_m"), DRAWN)
@pytest.mark.parametrize("digits", [None, 6, 3, 2])
def test_no_route_of_ours_is_changed_nor_what_is_written_down_of_it(
    name: str, spacing_m: float, digits: int | None
) -> None:
    route = DRAWN[name, spacing_m]
    if digits is not None:
        columns = {each: np.round(getattr(route, each), digits) for each in COLUMNS[1:]}
        route = changed(route, **columns)
    assert find_backward_step(route) is None
    cleaned = drop_backward_steps(route)
    assert cleaned.trajectory is route
    assert len(cleaned.dropped) == len(cleaned.moved) == 0


@given(st.sampled_from(sorted(ROUTES)), st.integers(1, 24), st.booleans())
def test_a_coarse_drawing_of_a_route_is_not_changed(name: str, stride: int, follows_chords: bool) -> None:
    """Every so many points, with the headings of the curve or those of the lines between them."""
    route = DRAWN[name, 0.25]
    kept = np.append(np.arange(0, len(route) - 1, stride), len(route) - 1)
    kept = np.union1d(kept, np.flatnonzero(route.speed_mps == 0.0))
    coarse = Trajectory(stamp_ns=0, **{each: getattr(route, each)[kept] for each in COLUMNS})
    if follows_chords:
        dx_m, dy_m = np.diff(coarse.x_m), np.diff(coarse.y_m)
        backs = coarse.speed_mps[1:] + coarse.speed_mps[:-1] < 0.0
        along_rad = np.where(
            np.hypot(dx_m, dy_m) > 0.0, np.arctan2(dy_m, dx_m) + math.pi * backs, coarse.heading_rad[1:]
        )
        coarse = changed(coarse, heading_rad=np.append(coarse.heading_rad[0], along_rad))
    assert find_backward_step(coarse) is None
    assert drop_backward_steps(coarse).trajectory is coarse


@pytest.mark.parametrize("name", sorted(ROUTES))
def test_no_piece_of_a_receding_route_steps_back(name: str) -> None:
    route = make_route(name)
    for s_m in np.arange(0.0, route.length_m, 1.37):
        x_m, y_m, heading_rad = (
            float(np.interp(s_m, route.s_m, values)) for values in (route.x_m, route.y_m, route.heading_rad)
        )
        piece = RecedingRoute(route).next(
            0, VehicleState(stamp_ns=0, x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_mps=1.0)
        )
        assert piece is not None
        assert find_backward_step(piece) is None


@pytest.mark.parametrize(
    "sound",
    [
        Trajectory.empty(stamp_ns=0),
        path([1.0]),
        path([0.0, 1.0]),
        path([0.0, 1.0, 1.0, 1.0, 2.0]),
        path([0.0, -1.0, -2.0], speed_mps=-1.0),
        path([0.0, 1.0, 2.0, 1.0, 0.0], speed_mps=[1.0, 1.0, 0.0, -1.0, -1.0]),
        path([0.0, 1.0, 2.0, 2.0, 1.0, 0.0], speed_mps=[1.0, 1.0, 0.0, 0.0, -1.0, -1.0]),
        path([0.0, 1.0, 2.0, 1.0, 0.0], speed_mps=[1.0, 1.0, 1.0, -1.0, -1.0]),
        path([0.0, 1.0, 2.0, 1.0, 0.0], speed_mps=[1.0, 1.0, -1.0, -1.0, -1.0]),
        path([0.0, -1.0, -2.0, -1.0, 0.0], speed_mps=[-1.0, -1.0, 0.0, 1.0, 1.0]),
        path([0.0, -1.0, -2.0, -1.0, 0.0], speed_mps=[-1.0, -1.0, -1.0, 1.0, 1.0]),
        path([0.0, 1.0, 1.001, 1.001, 1.002, 1.001, 1.0, 0.0], speed_mps=[1.0] + [0.04] * 4 + [-0.04] * 2 + [-1.0]),
        path([0.0, 0.5, 1.0], speed_mps=0.0),
        path([0.0, -0.5, -1.0], speed_mps=[-0.04, -0.04, 0.0]),
        path([0.0, 10.0, 10.0], [0.0, 0.0, 10.0], heading_rad=[0.0, 0.0, math.pi / 2]),
        path([0.0, 10.0, 8.0], [0.0, 0.0, 10.0], heading_rad=[0.0, math.radians(50.0), math.radians(101.0)]),
        path([-1e308, 0.0, 1e308], heading_rad=0.0),
    ],
    ids=str,
)
def test_points_that_lead_on_are_left_unchanged(sound: Trajectory) -> None:
    for each in (sound, turned(sound, math.pi / 2), turned(sound, -2.0)):
        assert find_backward_step(each) is None
        assert drop_backward_steps(each).trajectory is each


@pytest.mark.parametrize("wrong_rad", [math.pi, -2.0])
def test_a_path_that_leads_back_as_a_whole_has_no_step_that_an_index_cannot_get_past(wrong_rad: float) -> None:
    """Nor has one with a corner; cleaning refuses both."""
    for path_of in (path([0.0, 1.0, 2.0]), path([0.0, 1.0, 1.0], [0.0, 0.0, 1.0])):
        assert find_backward_step(changed(path_of, heading_rad=path_of.heading_rad + wrong_rad)) is None


def test_looking_for_a_step_back_computes_directions_only_where_the_path_turns_round(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cleaning, "_Directions", lambda _: pytest.fail("directions of a path that does not turn round"))
    for sound in (DRAWN["figure8", 0.25], DRAWN["stop_and_go", 0.25], path(np.arange(20_000) * 0.01)):
        assert find_backward_step(sound) is None


# Noise


def lap() -> Trajectory:
    """Round a circle of 15 m at 4 m/s; point 60 lies 5 mm behind point 59."""
    turned_rad = np.arange(200) * math.tau / 199
    turned_rad[60] = turned_rad[59] - 0.005 / 15.0
    return path(15.0 * np.sin(turned_rad), 15.0 - 15.0 * np.cos(turned_rad), heading_rad=turned_rad, speed_mps=4.0)


def recorded(seed: int = 1) -> Trajectory:
    """5 s of standstill, measured with 2 cm of noise, and then straight ahead."""
    dice, away_m = np.random.default_rng(seed), np.arange(1, 600) * 0.1
    x_m = np.append(dice.uniform(-0.02, 0.02, 51), away_m)
    y_m = np.append(dice.uniform(-0.02, 0.02, 51), np.zeros(599))
    speed_mps = np.append(np.zeros(51), np.minimum(np.sqrt(2.0 * away_m), 5.0))
    return path(x_m, y_m, speed_mps=speed_mps)


def test_a_step_back_of_5_mm_is_found_and_left_out() -> None:
    step = find_backward_step(lap())
    assert step is not None
    assert step.point == 60
    assert step.back_m == pytest.approx(0.005, rel=1e-3)
    assert str(step) == "point 60 lies 0.005 m behind point 59 in the direction of travel"
    cleaned = drop_backward_steps(lap())
    assert cleaned.dropped.tolist() == [60]
    assert cleaned.moved.tolist() == []
    assert same(cleaned.trajectory, without(lap(), [60]))
    assert (cleaned.trajectory.stamp_ns, cleaned.trajectory.frame_id) == (7, "odom")
    assert reaches_its_end(cleaned.trajectory, cleaned.trajectory)


def test_without_cleaning_the_index_stays_in_front_of_a_step_back() -> None:
    raw, line = path([0.0, 0.5, 1.0, 0.995, 1.5, 2.0]), path([0.0, 2.0])
    assert not reaches_its_end(raw, line)
    assert reaches_its_end(drop_backward_steps(raw).trajectory, line)


def without(trajectory: Trajectory, points: list[int]) -> Trajectory:
    return changed(trajectory, **{name: np.delete(getattr(trajectory, name), points) for name in COLUMNS})


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("signs_mps", [0.0, 0.04])
def test_a_noisy_standstill_becomes_a_dwell(seed: int, signs_mps: float) -> None:
    """A measured speed is not 0 at standstill either."""
    raw = recorded(seed)
    dice = np.random.default_rng(seed)
    raw = changed(
        raw,
        speed_mps=raw.speed_mps + (raw.speed_mps == 0.0) * dice.uniform(-signs_mps, signs_mps, len(raw)),
        accel_mps2=np.full(len(raw), 0.3),
        yaw_rate_radps=np.full(len(raw), 0.02),
        front_wheel_angle_rad=np.arange(len(raw)) * 1e-3,
    )
    assert find_backward_step(raw) is not None
    cleaned = drop_backward_steps(raw)
    assert cleaned.dropped.tolist() == list(range(1, 50))
    assert cleaned.moved.tolist() == [50]
    result, points = cleaned.trajectory, [0, 50]
    assert np.array_equal(result.time_from_start_ns[:2], raw.time_from_start_ns[points])
    assert np.array_equal(result.front_wheel_angle_rad[:2], raw.front_wheel_angle_rad[points])
    for name in ("x_m", "y_m", "heading_rad"):
        assert getattr(result, name)[:2].tolist() == [getattr(raw, name)[0]] * 2
    for name in ("speed_mps", "accel_mps2", "yaw_rate_radps"):
        assert getattr(result, name)[:2].tolist() == [0.0, 0.0]
    assert same(without(result, [0, 1]), without(raw, list(range(51))))
    assert reaches_its_end(result, path([0.0, 60.0]))


def test_a_noisy_standstill_at_the_end_keeps_the_end_of_the_time() -> None:
    cleaned = drop_backward_steps(path([0.0, 1.0, 2.0, 1.99, 2.01, 1.98], speed_mps=[2.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    assert cleaned.dropped.tolist() == [3, 4]
    assert cleaned.moved.tolist() == [5]
    assert cleaned.trajectory.x_m.tolist() == [0.0, 1.0, 2.0, 2.0]
    assert cleaned.trajectory.time_from_start_ns.tolist() == [0, 10**8, 2 * 10**8, 5 * 10**8]


def test_a_noisy_standstill_that_begins_a_little_back_is_at_the_last_place_that_leads_on() -> None:
    raw = path([0.0, 1.0, 0.99, 0.98, 0.99, 2.0], speed_mps=[2.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    cleaned = drop_backward_steps(raw)
    assert cleaned.dropped.tolist() == [3]
    assert cleaned.moved.tolist() == [2, 4]
    assert cleaned.trajectory.x_m.tolist() == [0.0, 1.0, 1.0, 1.0, 2.0]
    assert cleaned.trajectory.speed_mps.tolist() == [2.0, 1.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("turned_rad", [0.0, math.pi / 2, 2.0])
@pytest.mark.parametrize("noise_m", [[0.01, -0.01, 0.02], [0.01, 0.03, -0.01, 0.02], [0.01, 0.01, -0.02, 0.01]])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_between_two_directions_of_travel_a_noisy_standstill_is_a_dwell_and_both_are_kept(
    turned_rad: float, noise_m: list[float], way: float
) -> None:
    count = len(noise_m)
    raw = path(
        [0.0, way, *(way * (1.0 + each_m) for each_m in noise_m), way * 1.015, 0.0],
        speed_mps=[2.0 * way, way, *([0.0] * count), -0.5 * way, -way],
    )
    cleaned = drop_backward_steps(turned(raw, turned_rad))
    assert cleaned.dropped.tolist() == [*range(3, count + 1), count + 2]
    assert cleaned.moved.tolist() == [count + 1]
    expected = turned(path([0.0, way, way * 1.01, way * 1.01, 0.0]), turned_rad)
    assert cleaned.trajectory.x_m == pytest.approx(expected.x_m)
    assert cleaned.trajectory.y_m == pytest.approx(expected.y_m)


@pytest.mark.parametrize("turned_rad", [0.0, math.pi / 2, 2.0])
@pytest.mark.parametrize(("beside_m", "is_dwell"), [(0.099, True), (0.101, False)])
def test_a_standstill_is_within_the_noise_of_its_first_point(
    turned_rad: float, beside_m: float, is_dwell: bool
) -> None:
    raw = path([0.0, 0.0, 0.05, 1.0], [0.0, beside_m, 0.0, 0.0], speed_mps=[0.0, 0.0, 0.0, 1.0])
    if is_dwell:
        cleaned = drop_backward_steps(turned(raw, turned_rad))
        assert (cleaned.dropped.tolist(), cleaned.moved.tolist()) == ([1], [2])
    else:
        with pytest.raises(BackwardStepError):
            drop_backward_steps(turned(raw, turned_rad))


def test_noise_is_a_tenth_of_a_metre_and_standstill_a_twentieth_of_a_metre_per_second_and_not_less() -> None:
    assert drop_backward_steps(path([0.0, -0.1, 0.5])).dropped.tolist() == [1]
    cleaned = drop_backward_steps(path([0.0, -0.1, 0.0, 1.0], speed_mps=[0.05, 0.05, 0.05, 1.0]))
    assert (cleaned.dropped.tolist(), cleaned.moved.tolist()) == ([1], [2])


@pytest.mark.parametrize("speed_mps", [0.04, -0.04])
def test_a_path_that_is_slow_all_along_is_cleaned_in_its_direction(speed_mps: float) -> None:
    """Here the sign of the slow speeds counts: there is no other."""
    way, off_rad = math.copysign(1.0, speed_mps), math.radians(65.0)
    raw = path(
        [0.0, way, way * (1.0 + 0.05 * math.cos(off_rad)), way * 1.9, way * 1.85, way * 3.0],
        [0.0, 0.0, 0.05 * math.sin(off_rad), 0.0, 0.0, 0.0],
        speed_mps=speed_mps,
    )
    cleaned = drop_backward_steps(raw)
    assert (cleaned.dropped.tolist(), cleaned.moved.tolist()) == ([], [2, 4])


def test_the_last_point_is_never_left_out() -> None:
    cleaned = drop_backward_steps(path([0.0, 1.0, 2.0, 1.95], speed_mps=[2.0, 2.0, 2.0, 1.0]))
    assert (cleaned.dropped.tolist(), cleaned.moved.tolist()) == ([], [3])
    assert cleaned.trajectory.x_m.tolist() == [0.0, 1.0, 2.0, 2.0]
    assert cleaned.trajectory.speed_mps.tolist() == [2.0, 2.0, 2.0, 1.0]


@pytest.mark.parametrize(("speed_mps", "is_slow"), [(0.05, True), (-0.05, True), (0.051, False)])
def test_a_slow_point_that_does_not_lead_on_keeps_its_time_and_a_faster_one_is_left_out(
    speed_mps: float, is_slow: bool
) -> None:
    cleaned = drop_backward_steps(path([0.0, 1.0, 0.95, 2.0], speed_mps=[2.0, 2.0, speed_mps, 2.0]))
    assert (cleaned.dropped.tolist(), cleaned.moved.tolist()) == (([], [2]) if is_slow else ([2], []))


@pytest.mark.parametrize("back", [1.0, -1.0])
def test_points_are_left_out_until_one_is_ahead_of_the_last_that_was_kept(
    back: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw = path(np.array([0.0, 1.0, 0.95, 0.97, 0.999, 1.0, 1.001, 2.0]) * back, speed_mps=2.0 * back)
    passes, without_noise = [], cleaning._remove_noise

    def counted(*arguments: Any) -> tuple[IntArray, IntArray]:
        passes.append(arguments)
        return without_noise(*arguments)

    monkeypatch.setattr(cleaning, "_remove_noise", counted)
    assert drop_backward_steps(raw).dropped.tolist() == [2, 3, 4]
    assert len(passes) == 1


@pytest.mark.parametrize("off_deg", [-59.9, 59.9, -60.1, 60.1, 90.0, 180.0])
@pytest.mark.parametrize("backs", [False, True])
def test_a_step_within_60_degrees_of_the_direction_of_travel_leads_on(off_deg: float, backs: bool) -> None:
    step_m, off_rad = 0.05, math.radians(off_deg) + (math.pi if backs else 0.0)
    bent = path(
        [0.0, step_m * math.cos(off_rad), -1.0 if backs else 1.0],
        [0.0, step_m * math.sin(off_rad), 0.0],
        speed_mps=-1.0 if backs else 1.0,
    )
    assert drop_backward_steps(bent).dropped.tolist() == ([] if abs(off_deg) < 60.0 else [1])


@given(
    st.sampled_from(sorted(DRAWN)),
    st.floats(0.0, 0.03),
    st.integers(0, 2**32 - 1),
    st.sampled_from([-0.1, 0.0, 0.1]),
)
@settings(max_examples=150, deadline=None)
def test_a_noisy_route_is_cleaned_once_and_a_vehicle_that_drives_along_it_comes_to_its_last_point(
    which: tuple[str, float], noise_m: float, seed: int, beside_m: float
) -> None:
    raw = noisy(DRAWN[which], noise_m, seed)
    cleaned = drop_backward_steps(raw)
    result, dropped, moved = cleaned.trajectory, cleaned.dropped, cleaned.moved
    assert drop_backward_steps(result).trajectory is result
    assert find_backward_step(result) is None
    kept = np.delete(np.arange(len(raw)), dropped)
    assert np.array_equal(result.time_from_start_ns, raw.time_from_start_ns[kept])
    assert result.time_from_start_ns[-1] == raw.time_from_start_ns[-1]
    assert np.isin(moved, kept).all()
    unmoved = ~np.isin(kept, moved)
    for name in ("x_m", "y_m", "heading_rad", "front_wheel_angle_rad"):
        assert np.array_equal(getattr(result, name)[unmoved], getattr(raw, name)[kept[unmoved]])
    assert np.hypot(result.x_m - raw.x_m[kept], result.y_m - raw.y_m[kept]).max() <= 2.0 * NOISE_M
    if which[0] == "three_point_turn":  # a vehicle turns round where it has passed the point at which it shall
        assert reaches_its_end(result, result)
    else:
        assert reaches_its_end(result, DRAWN[which], beside_m=beside_m)


@given(st.sampled_from(sorted(DRAWN)), st.floats(0.0, 0.03), st.integers(0, 2**32 - 1))
@settings(max_examples=100, deadline=None)
def test_the_index_does_not_stay_behind_without_a_step_back(
    which: tuple[str, float], noise_m: float, seed: int
) -> None:
    raw = noisy(DRAWN[which], noise_m, seed)
    assume(find_backward_step(raw) is None)
    assert reaches_its_end(raw, raw if which[0] == "three_point_turn" else DRAWN[which])


# What is no noise


@pytest.mark.parametrize(
    ("wrong", "point", "said"),
    [
        (path([0.0, 1.0, 0.75, 2.0]), 2, "point 2 lies 0.25 m from point 1 and not ahead of it"),
        (path([0.0, 1.0, 0.899, 2.0]), 2, "point 2 lies 0.101 m from point 1 and not ahead of it"),
        (path([0.0, 1.0, 0.95, 0.91, 0.85]), 4, "point 4 lies 0.15 m from point 1 and not ahead of it"),
        (path([0.0, 0.05, 0.03, 0.05, 0.08, 0.0, -0.11], speed_mps=0.0), 6, "point 6 lies 0.19 m from point 4"),
        (path([0.0, 1.0, 1.0], [0.0, 0.0, 1.0]), 2, "point 2 lies 1 m from point 1 and not ahead of it"),
        (path([0.0, 1.0, 2.0], heading_rad=math.pi), 1, "point 1 lies 1 m from point 0 and not ahead of it"),
        (path([0.0, 1.0, 2.0], speed_mps=-1.0), 1, "point 1 lies 1 m from point 0 and not ahead of it"),
        (path([1e308, -1e308]), 1, "point 1 lies inf m from point 0"),
        (path([1e308, -1e308], speed_mps=0.0), 1, "point 1 lies inf m from point 0"),
    ],
    ids=str,
)
def test_a_point_that_does_not_lead_on_and_is_further_away_is_refused_by_its_number(
    wrong: Trajectory, point: int, said: str
) -> None:
    with pytest.raises(BackwardStepError) as refused:
        drop_backward_steps(wrong)
    assert refused.value.point == point
    assert str(refused.value).startswith(said)
    assert str(refused.value).endswith(
        ", by heading and sign of the speed: at most 0.1 m is taken for noise and left out"
    )


@pytest.mark.parametrize("turned", [0.0, math.pi, 57.3])
def test_a_heading_column_that_is_wrong_is_refused(turned: float) -> None:
    """None at all, the other way round, and degrees."""
    lap = DRAWN["circle", 0.25]
    wrong = changed(lap, heading_rad=turned * lap.heading_rad if turned != math.pi else lap.heading_rad + turned)
    with pytest.raises(BackwardStepError):
        drop_backward_steps(wrong)


def test_a_step_back_of_a_hundred_millionth_of_a_metre_is_rounding_and_the_index_gets_past_it() -> None:
    rounded = path([0.0, 1.0, 1.0 - 0.99e-8, 2.0, 3.0, 12.0])
    assert find_backward_step(rounded) is None
    assert drop_backward_steps(rounded).trajectory is rounded
    assert reaches_its_end(rounded, path([0.0, 12.0]), 9.9)
    longer = path([0.0, 1.0, 1.0 - 1.01e-8, 2.0])
    step = find_backward_step(longer)
    assert step is not None
    assert step.point == 2
    cleaned = drop_backward_steps(path([0.0, 1.0, 1.0 - 1.01e-8, 2.0]))
    assert cleaned.dropped.tolist() == [2]


def test_rounding_at_standstill_between_two_directions_of_travel_is_no_noise() -> None:
    x_m = [0.0, 1.0, 1.0 + 0.9e-8, 1.0, 1.0 + 0.9e-8, 0.0]
    rounded = path(x_m, speed_mps=[1.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    assert drop_backward_steps(rounded).trajectory is rounded
    noise = changed(rounded, x_m=[0.0, 1.0, 1.0 + 4e-8, 1.0, 1.0 + 4e-8, 0.0])
    assert drop_backward_steps(noise).dropped.tolist() == [2, 3]


@pytest.mark.parametrize("turned_rad", [0.0, math.pi / 2, 1.0])
def test_a_step_back_between_points_at_one_place_is_found(turned_rad: float) -> None:
    step = find_backward_step(turned(path([0.0, 0.5, 0.5, 0.45, 0.45, 1.0]), turned_rad))
    assert step is not None
    assert step.point == 3
    assert step.back_m == pytest.approx(0.05)


def test_the_first_of_several_steps_back_is_named() -> None:
    step = find_backward_step(path([0.0, 1.0, 1.0, 0.9, 2.0, 1.5, 3.0]))
    assert step is not None
    assert step.point == 3
    assert step.back_m == pytest.approx(0.1)


# Files


def test_a_loaded_file_is_cleaned_and_its_changes_are_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "lap.csv"
    save_csv(file, lap())
    assert same(load_csv(file), lap())
    cleaned = drivable.load_trajectory(str(file), reference().profile)
    assert same(cleaned, without(lap(), [60]))
    assert caplog.messages == [
        f"{file}: 1 of 200 points left out and 0 moved to the place of the point before: they lie within 0.1 m of it "
        "and not ahead of it, which is taken for noise; the first is point 60, line 63"
    ]
    caplog.clear()
    save_csv(file, cleaned)
    assert same(drivable.load_trajectory(str(file), reference().profile), cleaned)
    assert caplog.messages == []


def test_of_a_file_the_first_point_that_was_moved_is_named_where_none_was_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    save_csv(tmp_path / "end.csv", path([0.0, 1.0, 2.0, 1.95]))
    drivable.load_trajectory(str(tmp_path / "end.csv"), reference().profile)
    assert "0 of 4 points left out and 1 moved" in caplog.text
    assert "the first is point 3, line 6" in caplog.text


def test_a_file_with_a_point_that_does_not_lead_on_is_refused_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "back.csv"
    save_csv(file, path([0.0, 1.0, 2.0, 1.75, 3.0]))
    file.write_text("# recorded on Monday\n\n" + file.read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"back\.csv, line 8: point 3 lies 0\.25 m from point 2 and not ahead of it"):
        drivable.load_trajectory(str(file), reference().profile)


def test_a_cleaned_file_is_judged_as_it_will_be_driven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the loop would refuse later is refused at the start."""
    judged: list[int] = []

    def noted(trajectory: Trajectory, *arguments: Any) -> str:
        judged.append(len(trajectory))
        return find_violation(trajectory, *arguments) or ("too sharp" if len(trajectory) == 199 else "")

    monkeypatch.setattr(drivable, "find_violation", noted)
    save_csv(tmp_path / "lap.csv", lap())
    with pytest.raises(ConfigError, match="too sharp"):
        drivable.load_trajectory(str(tmp_path / "lap.csv"), reference().profile)
    assert judged == [200, 199]


@pytest.mark.parametrize("size", [1, 2, 7, 64])
@pytest.mark.parametrize("seed", range(40))
def test_the_size_of_the_pieces_does_not_change_which_step_back_is_found(
    size: int, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = random_path(np.random.default_rng(seed))
    whole = find_backward_step(drawn)
    monkeypatch.setattr(cleaning, "slices", lambda count: slices(count, size))
    assert find_backward_step(drawn) == whole


def test_noisy_paths_have_steps_back_and_not() -> None:
    found = [find_backward_step(random_path(np.random.default_rng(seed))) for seed in range(40)]
    assert None in found
    assert any(found)


def random_path(random: np.random.Generator) -> Trajectory:
    """A straight path of up to 100 points with noise, stretches backwards and rests."""
    n = int(random.integers(2, 100))
    speed_mps = np.repeat(random.choice([1.0, -2.0, 0.0], n), 9)[:n]
    noise_m = random.choice([0.0, 1e-4, 0.02])
    return Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.arange(n) * 10**8,
        x_m=np.cumsum(0.05 * np.sign(speed_mps)) + random.normal(0.0, noise_m, n),
        y_m=np.zeros(n),
        heading_rad=np.zeros(n),
        speed_mps=speed_mps,
    )
