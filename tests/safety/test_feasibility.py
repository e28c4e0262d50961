"""What a trajectory may ask for."""

import math
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.harness import Drive, reference, straight
from vehicle_iface import Trajectory, drivable
from vehicle_iface.errors import ConfigError
from vehicle_iface.pieces import slices
from vehicle_iface.safety import feasibility
from vehicle_iface.safety.feasibility import SLACK, find_violation, find_violation_in_pieces, max_curvature
from vehicle_iface.trajectories import ROUTES, make_route, save_csv
from vehicle_iface.trajectories.source import FixedTrajectory

PROFILE = reference().profile
LIMITS, WHEELBASE_M = PROFILE.limits, PROFILE.geometry.wheelbase_m
TIGHTEST_M = WHEELBASE_M / math.tan(LIMITS.front_wheel_angle_rad)
"""The radius of full lock: 3.95 m."""
DRAWN = {name: make_route(name).to_trajectory() for name in ROUTES}


def judged(trajectory: Trajectory) -> str:
    """What the reference vehicle's limits say to it."""
    return find_violation(trajectory, LIMITS, WHEELBASE_M)


def path(**columns: Any) -> Trajectory:
    given: dict[str, Any] = {
        "time_from_start_ns": np.arange(4) * 10**9,
        "x_m": np.arange(4.0),
        "y_m": np.zeros(4),
        "heading_rad": np.zeros(4),
        "speed_mps": np.ones(4),
    }
    return Trajectory(stamp_ns=0, **given | columns)


@pytest.mark.parametrize("sign", [-1, 1])
def test_at_the_limits_it_may_be_followed_and_beyond_them_the_point_is_named(sign: int) -> None:
    at = np.array([0.0, 0.0, sign * 20.0, 0.0])
    assert judged(path(speed_mps=at)) == ""
    assert judged(path(speed_mps=at * 1.001)) == f"speed_mps[2] = {sign * 20.02}: must be in [-20.0, 20.0]"
    angle = np.array([0.0, sign * 0.6, 0.0, 0.0])
    assert judged(path(front_wheel_angle_rad=angle)) == ""
    assert judged(path(front_wheel_angle_rad=angle * 1.01)).startswith("front_wheel_angle_rad[1] = ")


def test_an_empty_one_may_be_followed_and_a_million_points_may() -> None:
    assert judged(Trajectory.empty(stamp_ns=0)) == ""
    assert judged(straight(length_m=1e6)) == ""


def test_a_loop_rejects_a_trajectory_that_is_too_fast_and_logs_it() -> None:
    drive = Drive(FixedTrajectory(straight(speed_mps=25.0)))
    drive.run_s(1.0)
    assert drive.controller.trajectory is None
    assert drive.loop.details().loop["trajectories_rejected"] >= 1


def test_a_billionth_beyond_a_limit_is_rounding_and_more_is_not() -> None:
    assert judged(path(speed_mps=np.full(4, 20.0 * (1.0 + 1e-9)))) == ""
    assert judged(path(speed_mps=np.full(4, 20.0 * (1.0 + 1.2e-9)))).startswith("speed_mps[0] = ")


def circle(
    radius_m: float, *, spacing_m: float = 0.25, speed_mps: float = 1.0, turn_rad: float = math.tau
) -> Trajectory:
    """An arc to the left from the origin on; a negative speed drives it backwards."""
    angle = np.arange(0.0, turn_rad, spacing_m / radius_m)
    way = math.copysign(1.0, speed_mps)
    return path(
        time_from_start_ns=np.arange(len(angle)) * 10**7,
        x_m=way * radius_m * np.sin(angle),
        y_m=way * radius_m * (1.0 - np.cos(angle)),
        heading_rad=np.remainder(angle + math.pi, math.tau) - math.pi,
        speed_mps=np.full(len(angle), speed_mps),
    )


def copied(trajectory: Trajectory, stride: int, *, digits: int, noise_m: float, follows_chords: bool) -> Trajectory:
    """A route as another program exports it: fewer points, rounded, measured, with headings from the positions."""
    kept = np.append(np.arange(0, len(trajectory) - 1, stride), len(trajectory) - 1)
    # A change of direction is a point that nobody leaves out.
    kept = np.union1d(kept, np.flatnonzero(trajectory.speed_mps == 0.0))
    dice = np.random.default_rng(stride)
    x_m, y_m = (
        values[kept] + dice.uniform(-noise_m, noise_m, len(kept)) for values in (trajectory.x_m, trajectory.y_m)
    )
    heading_rad = trajectory.heading_rad[kept]
    if follows_chords:
        along = np.arctan2(np.diff(y_m), np.diff(x_m))
        backs = np.signbit(trajectory.speed_mps[kept][1:] + trajectory.speed_mps[kept][:-1])
        far = np.hypot(np.diff(x_m), np.diff(y_m)) > 0.1
        heading_rad[1:] = np.where(far, along + math.pi * backs, heading_rad[1:])
    return path(
        time_from_start_ns=trajectory.time_from_start_ns[kept],
        x_m=np.round(x_m, digits),
        y_m=np.round(y_m, digits),
        heading_rad=np.round(np.remainder(heading_rad + math.pi, math.tau) - math.pi, digits),
        speed_mps=np.round(trajectory.speed_mps[kept], digits),
    )


@given(
    st.sampled_from(sorted(ROUTES)),
    st.integers(1, 12),
    st.integers(2, 6),
    st.floats(0.0, 0.01),
    st.booleans(),
)
@settings(max_examples=300)
def test_builtin_routes_are_feasible_even_after_csv_rounding(
    name: str, stride: int, digits: int, noise_m: float, follows_chords: bool
) -> None:
    assert judged(DRAWN[name]) == ""
    copy = copied(DRAWN[name], stride, digits=digits, noise_m=noise_m, follows_chords=follows_chords)
    assert judged(copy) == ""


@given(st.floats(TIGHTEST_M, 100.0), st.floats(0.01, 6.0), st.sampled_from([-1.0, 1.0]))
def test_a_circle_that_wheels_and_lateral_acceleration_allow_may_be_followed_however_it_is_drawn(
    radius_m: float, spacing_m: float, way: float
) -> None:
    speed_mps = way * min(math.sqrt(LIMITS.lateral_accel_mps2 * radius_m), 5.0)
    assert judged(circle(radius_m, spacing_m=spacing_m, speed_mps=speed_mps)) == ""


@given(st.floats(0.7, TIGHTEST_M / SLACK * 0.97), st.floats(0.01, 1.0), st.sampled_from([-1.0, 1.0]))
def test_a_circle_beyond_full_lock_is_refused_however_it_is_drawn(
    radius_m: float, spacing_m: float, way: float
) -> None:
    assert "rad/m at point" in judged(circle(radius_m, spacing_m=spacing_m, speed_mps=way))


@given(st.floats(4.5, 19.0), st.floats(0.05, 3.0))
def test_a_bend_that_is_driven_too_fast_is_refused_however_it_is_drawn(speed_mps: float, spacing_m: float) -> None:
    radius_m = speed_mps**2 / LIMITS.lateral_accel_mps2 / SLACK * 0.95
    bend = circle(radius_m, spacing_m=spacing_m, speed_mps=speed_mps)
    assert f"at {speed_mps:.4g} m/s" in judged(bend)


def test_a_turn_that_is_too_sharp_is_named_with_point_value_and_limit() -> None:
    text = judged(circle(2.0))
    assert re.fullmatch(r"the path turns by 0\.5 rad/m at point \d+: must be at most 0\.2534 rad/m at 1 m/s", text)


def test_a_corner_is_too_sharp_and_so_is_a_way_back_on_the_same_line_without_a_change_of_direction() -> None:
    there, none = np.arange(0.0, 10.0, 0.25), np.zeros(40)
    corner = {"x_m": np.concatenate([there, none + 10.0]), "y_m": np.concatenate([none, there])}
    back = {"x_m": np.concatenate([there, there[::-1]]), "y_m": np.zeros(80)}
    rest = {"time_from_start_ns": np.arange(80), "heading_rad": np.zeros(80)}
    assert "at point 40:" in judged(path(**corner, **rest, speed_mps=np.ones(80)))
    assert re.search(r"at point (3[7-9]|4[0-2]):", judged(path(**back, **rest, speed_mps=np.ones(80))))
    assert judged(path(**back, **rest, speed_mps=np.repeat([1.0, -1.0], 40))) == ""


def test_headings_that_turn_faster_than_the_wheels_can_are_refused_on_a_straight_line() -> None:
    rest = {"time_from_start_ns": np.arange(80), "x_m": np.arange(80) * 0.25, "y_m": np.zeros(80)}
    assert judged(path(**rest, heading_rad=0.06 * np.arange(80), speed_mps=np.ones(80))) == ""
    spun = judged(path(**rest, heading_rad=0.08 * np.arange(80), speed_mps=np.ones(80)))
    assert spun.startswith("the path turns by 0.3")


def test_a_vehicle_that_stands_while_it_is_measured_turns_by_nothing() -> None:
    dice = np.random.default_rng(0)
    x_m = np.concatenate([np.zeros(2000), np.arange(0.0, 20.0, 0.1)]) + dice.normal(0.0, 0.002, 2200)
    y_m = dice.normal(0.0, 0.002, 2200)
    speed_mps = np.concatenate([np.zeros(2000), np.full(200, 2.0)])
    none = np.zeros(2200)
    assert (
        judged(path(time_from_start_ns=np.arange(2200), x_m=x_m, y_m=y_m, heading_rad=none, speed_mps=speed_mps)) == ""
    )


@given(st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 4), max_size=30))
def test_every_finite_trajectory_is_judged(rows: list[tuple[float, float, float, float]]) -> None:
    x_m, y_m, heading_rad, speed_mps = np.array(rows).reshape(-1, 4).T
    times_ns = np.arange(len(rows))
    odd = path(time_from_start_ns=times_ns, x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_mps=speed_mps)
    assert isinstance(judged(odd), str)


def test_a_file_with_a_path_that_is_too_sharp_is_refused_before_anything_drives(tmp_path: Path) -> None:
    save_csv(tmp_path / "sharp.csv", circle(2.0))
    with pytest.raises(ConfigError, match=r"sharp\.csv: the path turns by 0\.5 rad/m at point"):
        drivable.load_trajectory(str(tmp_path / "sharp.csv"), PROFILE)
    save_csv(tmp_path / "round.csv", circle(6.0))
    assert len(drivable.load_trajectory(str(tmp_path / "round.csv"), PROFILE)) == len(circle(6.0))


def test_a_route_is_laid_out_for_what_the_vehicle_stands_and_refused_where_that_does_not_help() -> None:
    gentle = msgspec.structs.replace(PROFILE, limits=msgspec.structs.replace(LIMITS, lateral_accel_mps2=0.5))
    assert find_violation(drivable.build_route("figure8", gentle).to_trajectory(), gentle.limits, WHEELBASE_M) == ""
    stiff = msgspec.structs.replace(LIMITS, front_wheel_angle_by_speed=((0.0, 0.6), (1.0, 0.05)))
    with pytest.raises(ConfigError, match="route 'u_turn': the path turns by"):
        drivable.build_route("u_turn", msgspec.structs.replace(PROFILE, limits=stiff))


def bent(turn_rad: float, before_m: float, after_m: float, spacing_m: float = 10.0, **columns: Any) -> Trajectory:
    """Two straight lines with one corner; headings that say nothing of it."""
    before = np.append(np.arange(0.0, before_m - 1e-9, spacing_m), before_m)
    after = np.append(np.arange(spacing_m, after_m - 1e-9, spacing_m), after_m)
    count = len(before) + len(after)
    given: dict[str, Any] = {
        "time_from_start_ns": np.arange(count),
        "x_m": np.concatenate([before, before_m + np.round(after * math.cos(turn_rad), 12)]),
        "y_m": np.concatenate([np.zeros(len(before)), np.round(after * math.sin(turn_rad), 12)]),
        "heading_rad": np.zeros(count),
        "speed_mps": np.ones(count),
    }
    return path(**given | columns)


def turned_per_m(text: str) -> float:
    found = re.match(r"the path turns by (\S+) rad/m", text)
    assert found, text
    return float(found[1])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("turn_deg", "per_m"),
    [
        (60.0, 2.0 * math.sin(math.pi / 3) / 3.5),  # of the circle through the three points
        (80.0, 2.0 * math.sin(math.radians(80.0)) / math.sqrt(8.5 + 7.5 * math.cos(math.radians(80.0)))),
        (90.0, 2.0 / math.sqrt(8.5)),
        (120.0, 2.0 * math.sin(math.radians(60.0)) / 2.5),  # of the angle, over the longer line
        (170.0, 2.0 * math.sin(math.radians(85.0)) / 2.5),
        (180.0, 2.0 / 2.5),
    ],
)
def test_a_corner_of_three_points_turns_by_its_circle_and_where_it_leads_back_by_its_angle(
    turn_deg: float, per_m: float, sign: float
) -> None:
    text = judged(bent(sign * math.radians(turn_deg), 1.5, 2.5))
    assert turned_per_m(text) == pytest.approx(per_m, rel=1e-3)
    assert " at point 1: " in text


@pytest.mark.parametrize(("after_m", "is_judged"), [(0.5, False), (0.7, True), (0.9, True)])
def test_at_the_end_half_a_chord_is_enough_to_measure_a_turn_and_less_is_not(after_m: float, is_judged: bool) -> None:
    assert bool(judged(bent(math.pi / 2, 1.5, after_m))) is is_judged


@pytest.mark.parametrize("speeds_mps", [(1.0, 1.0, 1.0), (-1.0, -1.0, -1.0), (1.0, 0.0, 1.0), (-1.0, 0.0, -1.0)])
def test_a_corner_where_the_vehicle_stands_is_one_as_long_as_it_goes_on_in_the_same_direction(
    speeds_mps: tuple[float, ...],
) -> None:
    assert judged(bent(math.pi / 2, 1.5, 2.5, speed_mps=np.array(speeds_mps))) != ""
    assert judged(bent(math.pi / 2, 1.5, 2.5, speed_mps=np.array(speeds_mps) * (1.0, 1.0, -1.0))) == ""


@pytest.mark.parametrize(("speed_mps", "chord_m"), [(1.0, WHEELBASE_M / 2), (10.0, 5.0)])
def test_a_turn_is_measured_over_half_a_wheelbase_or_half_a_second_whichever_is_longer(
    speed_mps: float, chord_m: float
) -> None:
    corner = bent(0.45, 20.0, 20.0, 0.05)
    text = judged(path(**columns_of(corner) | {"speed_mps": np.full(len(corner), speed_mps)}))
    assert turned_per_m(text) == pytest.approx(2.0 * math.sin(0.225) / chord_m, rel=0.15)


def columns_of(trajectory: Trajectory) -> dict[str, Any]:
    return {name: getattr(trajectory, name) for name in ("time_from_start_ns", "x_m", "y_m", "heading_rad")}


def test_a_corner_is_seen_as_near_to_the_first_point_as_a_chord_is_long() -> None:
    text = judged(bent(0.42, WHEELBASE_M / 2, 20.0, 0.05))
    assert turned_per_m(text) == pytest.approx(2.0 * math.sin(0.21) / (WHEELBASE_M / 2), rel=0.02)


def test_rear_wheels_that_turn_as_well_make_the_sharpest_curve_sharper() -> None:
    rear = msgspec.structs.replace(LIMITS, rear_wheel_angle_rad=0.1)
    both_per_m = (math.tan(LIMITS.front_wheel_angle_rad) + math.tan(0.1)) / WHEELBASE_M
    assert max_curvature(np.array([1.0]), rear, WHEELBASE_M) == pytest.approx(both_per_m)


@pytest.mark.parametrize("size", [1, 2, 7, 64])
@pytest.mark.parametrize("seed", range(30))
def test_the_size_of_the_pieces_does_not_change_what_is_found(
    size: int, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = wandering(np.random.default_rng(seed))
    whole = judged(drawn)
    monkeypatch.setattr(feasibility, "slices", lambda count, _=0: slices(count, size))
    assert judged(drawn) == whole


def test_wandering_paths_are_feasible_and_not() -> None:
    found = [judged(wandering(np.random.default_rng(seed))) for seed in range(30)]
    assert "" in found
    assert any("the path turns" in text for text in found)


def wandering(random: np.random.Generator) -> Trajectory:
    """A path of up to 200 points that turns at random, with stretches backwards and at rest."""
    n = int(random.integers(3, 200))
    speed_mps = np.repeat(random.choice([1.0, -2.0, 0.0, 9.0], n), 9)[:n]
    spacing_m = random.choice([0.02, 0.3, 1.0])
    heading_rad = np.cumsum(random.normal(0.0, random.choice([0.01, 0.1, 0.5]), n) * spacing_m)
    return path(
        time_from_start_ns=np.arange(n) * 10**8,
        x_m=np.cumsum(np.cos(heading_rad) * spacing_m * np.sign(speed_mps)),
        y_m=np.cumsum(np.sin(heading_rad) * spacing_m * np.sign(speed_mps)),
        heading_rad=heading_rad,
        speed_mps=speed_mps,
    )


def test_a_path_through_a_point_far_away_is_checked_in_many_short_pieces() -> None:
    """All windows but the last ones begin at the point before the gap."""
    x_m = np.append(np.arange(9_999) * 0.01, 3_000.0)
    drawn = path(
        **dict.fromkeys(("y_m", "heading_rad"), np.zeros(10_000)),
        time_from_start_ns=np.arange(10_000),
        x_m=x_m,
        speed_mps=np.ones(10_000),
    )
    pieces = sum(1 for _ in find_violation_in_pieces(drawn, LIMITS, WHEELBASE_M))
    assert pieces > 3_000.0 / (feasibility.STEP_WHEELBASES * WHEELBASE_M) / feasibility._WINDOWS
