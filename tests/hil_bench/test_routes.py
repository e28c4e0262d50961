"""The routes of the cases as each vehicle drives them: which of time and space ends first."""

import itertools
import math
from pathlib import Path

import pytest
from hil_bench import applicable, routes
from hil_bench.applicable import adapt, scale_for
from hil_bench.case import Case
from hil_bench.cases import CATALOGUE
from hil_bench.expect import ReachesEnd
from hil_bench.peer.build import open_wire
from hil_bench.routes import Route
from hil_bench.wire import Wire
from scenes import SHIPPED, find_case
from virtual_drive import VirtualDrive

BEGINNING_S = 4.0
"""For engaging, the command's delay and the lag of the drive."""
MARGIN = 1.4
"""On the time that a vehicle takes which drives as fast as the route and the limits have it."""
SHARE_OF_LIMITS = 0.4
"""Of acceleration and safe deceleration: what a controller uses on a calm drive."""


def cases_that_end(in_time: bool) -> list[Case]:
    """The cases that wait for the end of their route's time, or of its space."""
    ends = [(case, see) for case in CATALOGUE for see in case.see if isinstance(see, ReachesEnd)]
    return [case for case, see in ends if ("PAST_END_TIME" in see.reasons) is in_time]


def distances_m(route: Route) -> list[float]:
    """From each point to the next one."""
    return [math.dist(a, b) for a, b in itertools.pairwise(zip(route.x_m, route.y_m, strict=True))]


def times_of_a_calm_drive_s(route: Route, wire: Wire) -> list[float]:
    """When a vehicle is at each point, if it keeps the route's speeds and accelerates and brakes gently."""
    limits, behavior = wire.profile["limits"], wire.profile["behavior"]
    accel_mps2 = SHARE_OF_LIMITS * limits["accel_max_mps2"]
    brake_mps2 = SHARE_OF_LIMITS * behavior["safe_deceleration_mps2"]
    steps_m = distances_m(route)
    speeds = [0.0, *map(abs, route.speed_mps[1:-1]), 0.0]
    for i, step_m in enumerate(steps_m):
        speeds[i + 1] = min(speeds[i + 1], math.sqrt(speeds[i] ** 2 + 2.0 * accel_mps2 * step_m))
    for i in reversed(range(len(steps_m))):
        speeds[i] = min(speeds[i], math.sqrt(speeds[i + 1] ** 2 + 2.0 * brake_mps2 * steps_m[i]))
    steps = zip(steps_m, itertools.pairwise(speeds), strict=True)
    return [0.0, *itertools.accumulate(2.0 * step_m / (a + b) if step_m else 0.0 for step_m, (a, b) in steps)]


@pytest.mark.parametrize("profile", SHIPPED)
def test_the_time_is_enough_to_reach_every_stop_and_the_end_in_space(profile: str) -> None:
    wire = open_wire(profile)
    for case in cases_that_end(in_time=False):
        route = scale_for(case.route(), wire)
        calm_s = times_of_a_calm_drive_s(route, wire)
        stops = [i for i, speed_mps in enumerate(route.speed_mps) if i and speed_mps == 0.0]
        assert stops[-1] == len(route.x_m) - 1, case.name
        for i in stops:
            assert BEGINNING_S + MARGIN * calm_s[i] <= route.time_s[i], case.name


@pytest.mark.parametrize("profile", SHIPPED)
def test_a_hurried_route_ends_long_before_the_fastest_drive_is_at_its_end(profile: str) -> None:
    wire = open_wire(profile)
    (case,) = cases_that_end(in_time=True)
    route = scale_for(case.route(), wire)
    fastest_mps = max(map(abs, route.speed_mps))
    assert sum(distances_m(route)) / fastest_mps >= 1.5 * route.time_s[-1]
    assert 0.5 * SHARE_OF_LIMITS * wire.profile["limits"]["accel_max_mps2"] * route.time_s[-1] ** 2 > 1.0  # it moves


def test_only_a_hurried_route_gets_less_time_when_its_length_shrinks_more_than_its_speed() -> None:
    hurried, calm = (routes.route("r", [(60.0, 0.0)], 5.0, slack=slack) for slack in (0.4, 2.0))
    assert routes.scale(hurried, length=0.25, speed=0.5).time_s[-1] == pytest.approx(0.5 * hurried.time_s[-1])
    assert routes.scale(calm, length=0.25, speed=0.5).time_s == calm.time_s


def test_stretches_are_counted_from_stop_to_stop() -> None:
    assert routes.straight(60.0).shortest_stretch_m() == pytest.approx(60.0)
    assert routes.stop_and_go().shortest_stretch_m() == pytest.approx(16.0)
    assert routes.reverse_bay().shortest_stretch_m() == pytest.approx(math.pi / 2.0 * 7.0 + 4.0, rel=0.01)


@pytest.mark.parametrize("profile", SHIPPED)
def test_a_straight_stretch_is_longer_than_a_controller_looks_ahead_at_a_crawl(profile: str) -> None:
    wire = open_wire(profile)
    for name in ("end-of-space", "end-of-time", "drive-stop-and-go", "drive-from-the-side", "state-lost"):
        route = scale_for(find_case(name).route(), wire)
        assert route.is_straight
        assert route.shortest_stretch_m() > 0.99 * applicable.SHORTEST_STRETCH_M, name


@pytest.mark.parametrize("profile", SHIPPED)
def test_the_program_is_at_the_end_in_space_well_before_the_end_in_time(profile: str, tmp_path: Path) -> None:
    drive = VirtualDrive(profile, find_case("end-of-space").route(), tmp_path)
    lasts_s = scale_for(find_case("end-of-space").route(), drive.wire).time_s[-1]
    drive.run_until(lambda: drive.vehicle.has_arrived, 0.8 * lasts_s)
    assert not drive.wire.tells_reasons or drive.loop.reason.name == "PAST_END_SPACE"


@pytest.mark.parametrize("profile", SHIPPED)
def test_the_program_is_under_way_at_the_end_in_time(profile: str, tmp_path: Path) -> None:
    drive, case = VirtualDrive(profile, find_case("end-of-time").route(), tmp_path), find_case("end-of-time")
    route = adapt(case, drive.wire).route()
    for attribute, value in case.setup.items():
        setattr(drive.vehicle.plant, attribute, value)
    drive.run_until(lambda: drive.loop.reason.name.startswith("PAST_END"), BEGINNING_S + route.time_s[-1])
    assert drive.loop.reason.name == "PAST_END_TIME"
    assert 0.5 < drive.vehicle.plant.x_m < 0.8 * route.x_m[-1]
