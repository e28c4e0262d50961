"""The catalogue: complete, unique, and made of valid trajectories."""

import math
from pathlib import Path

import pytest
from hil_bench import bench, judges, routes
from hil_bench.case import Case, Need, Then
from hil_bench.cases import CATALOGUE, catalogue_for, catalogue_of
from hil_bench.cases.files import FILES
from hil_bench.fault_rows import list_fault_rows
from scenes import WIRE

from vehicle_iface.profile import load_profile
from vehicle_iface.safety.feasibility import find_violation
from vehicle_iface.trajectories.csv_file import load_csv

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ROOT / "tools"


PROFILE = load_profile("reference")
EVERY_CASE = (*catalogue_of(2), *catalogue_for(WIRE)[len(CATALOGUE) :])


def test_every_failure_of_the_page_has_a_case_or_a_reason_why_it_has_none() -> None:
    rows = list_fault_rows(EVERY_CASE)
    assert len(rows) > 70
    assert {fault for case in EVERY_CASE for fault in case.fault.split()} <= {row.row for row in rows}
    assert [row.row for row in rows if bool(row.cases) == bool(row.why_none)] == []


def test_every_case_has_a_unique_name_and_an_expectation() -> None:
    assert len(CATALOGUE) >= 60
    assert len({case.name for case in EVERY_CASE}) == len(EVERY_CASE)
    for case in EVERY_CASE:
        assert case.see or case.measure or case.steps, case.name
        assert all(step.see or step.measure for step in case.steps), case.name
        assert case.proves.endswith("."), case.name
        assert case.allow <= set(judges.KINDS), case.name
        assert case.injected or (case.inject is None and not case.steps), case.name
        assert Need.REARM in case.needs or case.then is not Then.REARM, case.name
    assert {case.name for case in bench.select_cases((), (), quick=True)} < {case.name for case in CATALOGUE}


@pytest.mark.parametrize("case", catalogue_for(WIRE), ids=lambda case: case.name)
def test_every_trajectory_is_accepted_by_the_program_except_the_broken_ones(case: Case, tmp_path: Path) -> None:
    path = case.route().write(tmp_path / "route.csv")
    refused = find_violation(load_csv(path), PROFILE.limits, PROFILE.geometry.wheelbase_m)
    assert bool(refused) == (case.name == "trajectory-too-sharp"), refused
    if case.breaks is not None and not refused:
        assert case.breaks(path.read_text()) != path.read_text()


def test_every_broken_profile_differs_from_the_original() -> None:
    toml, dbc = WIRE.path.read_text(), WIRE.dbc.read_text()
    spoilt = [case.profile(toml, dbc) for case in FILES if case.profile is not None]
    assert len(spoilt) >= 4
    assert all(texts != (toml, dbc) for texts in spoilt)


def test_routes_begin_at_the_origin_along_x_and_their_time_grows() -> None:
    for make in (routes.step, routes.slalom, routes.double_lane_change, routes.stop_and_go, routes.reverse_bay):
        route = make()
        assert (route.x_m[0], route.y_m[0], route.heading_rad[0]) == (0.0, 0.0, 0.0)
        assert all(b > a for a, b in zip(route.time_s, route.time_s[1:], strict=False))
        for i in range(1, len(route.x_m)):
            step_m = math.hypot(route.x_m[i] - route.x_m[i - 1], route.y_m[i] - route.y_m[i - 1])
            assert 0.0 <= step_m < 0.6
