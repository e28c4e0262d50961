"""When the vehicle is not where or how it was commanded."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.harness import reference, straight
from vehicle_iface import Trajectory, VehicleState
from vehicle_iface.safety import path_distance
from vehicle_iface.safety.deviation import DeviationKind, DeviationMonitor
from vehicle_iface.safety.path_distance import PathLocator

PATH = straight(length_m=100.0)
"""Along +x, a point each metre."""


def monitor() -> DeviationMonitor:
    return DeviationMonitor(reference().profile.deviation, speed_max_mps=20.0)


def state(**numbers: float) -> VehicleState:
    given: dict[str, Any] = {"x_m": 10.4, "y_m": 0.0, "heading_rad": 0.0, "speed_mps": 5.0}
    return VehicleState(stamp_ns=0, **given | numbers)


def counted(watching: DeviationMonitor) -> dict[str, int]:
    return {what: count for what, count in watching.counts.items() if count}


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("y_m", "finding", "stops"),
    [
        (1.0, None, False),
        (1.001, DeviationKind.BESIDE, False),
        (3.0, DeviationKind.BESIDE, False),
        (3.001, DeviationKind.OFF_PATH, True),
    ],
)
def test_beyond_1_m_from_its_path_a_vehicle_is_counted_and_beyond_3_m_stopped(
    y_m: float, finding: DeviationKind | None, stops: bool, sign: int
) -> None:
    watching = monitor()
    assert watching.update(state(y_m=sign * y_m), PATH, 10, 5.0) is stops
    assert counted(watching) == ({finding.value: 1} if finding else {})


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("heading_rad", "stops"), [(0.8, False), (0.801, True), (math.pi, True), (2.0 * math.pi, False)]
)
def test_a_vehicle_more_than_0_8_rad_off_its_paths_heading_is_stopped(
    heading_rad: float, stops: bool, sign: int
) -> None:
    watching = monitor()
    assert watching.update(state(heading_rad=sign * heading_rad), PATH, 10, 5.0) is stops
    assert counted(watching) == ({DeviationKind.HEADING.value: 1} if stops else {})


@pytest.mark.parametrize(("speed_mps", "stops"), [(21.0, False), (21.01, True)])
def test_faster_than_the_vehicle_may_go(speed_mps: float, stops: bool) -> None:
    assert monitor().update(state(speed_mps=speed_mps), PATH, 10, 5.0) is stops
    assert monitor().update(state(speed_mps=-speed_mps), PATH, 10, -5.0) is stops


@pytest.mark.parametrize(
    ("speed_mps", "direction_mps", "stops"),
    [(-0.5, 5.0, False), (-0.51, 5.0, True), (0.5, -1.0, False), (0.51, -1.0, True), (-3.0, 0.0, False)],
)
def test_rolling_against_the_direction_of_travel(speed_mps: float, direction_mps: float, stops: bool) -> None:
    assert monitor().update(state(speed_mps=speed_mps), PATH, 10, direction_mps) is stops


@pytest.mark.parametrize(
    ("change", "direction_mps", "findings"),
    [
        ({"y_m": 2.0}, 5.0, [DeviationKind.BESIDE]),
        ({"y_m": 2.0, "heading_rad": 0.8}, 5.0, [DeviationKind.BESIDE]),
        ({"y_m": 2.0, "heading_rad": 0.801}, 5.0, [DeviationKind.BESIDE, DeviationKind.HEADING]),
        ({"y_m": 2.0, "speed_mps": 21.0}, 5.0, [DeviationKind.BESIDE]),
        ({"y_m": 2.0, "speed_mps": 21.01}, 5.0, [DeviationKind.BESIDE, DeviationKind.OVERSPEED]),
        ({"y_m": 2.0, "speed_mps": -3.0}, 0.0, [DeviationKind.BESIDE]),
        ({"y_m": 2.0, "speed_mps": -3.0}, 1.0, [DeviationKind.BESIDE, DeviationKind.ROLLING_BACK]),
        ({"y_m": 4.0, "heading_rad": 3.0, "speed_mps": -22.0}, 1.0, list(DeviationKind)[1:]),
    ],
)
def test_everything_that_is_wrong_is_counted(
    change: dict[str, float], direction_mps: float, findings: list[DeviationKind]
) -> None:
    watching = monitor()
    assert watching.update(state(**change), PATH, 10, direction_mps) is (findings != [DeviationKind.BESIDE])
    assert {what for what, count in watching.counts.items() if count} == {finding.value for finding in findings}


def test_at_the_warning_a_vehicle_that_the_index_is_far_behind_of_is_not_beside() -> None:
    watching = monitor()
    assert not watching.update(state(x_m=60.4, y_m=1.0), PATH, 0, 5.0)
    assert not any(watching.counts.values())


def test_a_vehicle_that_is_set_elsewhere_on_its_path_is_found_there_at_once() -> None:
    watching, path = monitor(), straight(length_m=1000.0)
    assert not watching.update(state(y_m=2.0), path, 10, 5.0)
    assert not watching.update(state(x_m=900.0, y_m=0.5), path, 10, 5.0)


def test_a_vehicle_near_its_path_is_not_located_whatever_else_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PathLocator, "locate", lambda *_, **__: pytest.fail("located"))
    assert not monitor().update(state(y_m=0.9), PATH, 10, 5.0)
    assert monitor().update(state(y_m=0.9, speed_mps=22.0), PATH, 10, 5.0)
    assert monitor().update(state(y_m=0.9, speed_mps=-1.0), PATH, 10, 5.0)


def test_a_deviation_holds_until_the_vehicle_stands_and_there_is_a_new_trajectory() -> None:
    watching, planned = monitor(), [straight(length_m=100.0) for _ in range(3)]
    assert watching.update(state(y_m=4.0), PATH, 10, 5.0)
    assert watching.update(state(), PATH, 11, 5.0)
    assert all(watching.update(state(speed_mps=speed_mps), planned[0], 11, 5.0) for speed_mps in (5.0, 0.051, -0.051))
    assert not watching.update(state(speed_mps=0.05), planned[0], 11, 5.0)
    assert not watching.update(state(), planned[0], 11, 5.0)
    assert watching.update(state(y_m=4.0, speed_mps=0.0), planned[1], 11, 5.0)
    assert watching.update(state(speed_mps=0.0), planned[1], 11, 5.0)
    assert not watching.update(state(speed_mps=-0.05), planned[2], 11, 5.0)


def test_a_vehicle_off_its_new_trajectory_too_needs_another_one() -> None:
    watching, planned = monitor(), straight(length_m=100.0)
    for path in (PATH, planned):
        assert watching.update(state(y_m=4.0, speed_mps=0.0), path, 10, 5.0)
    assert watching.update(state(speed_mps=0.0), planned, 10, 5.0)
    assert not watching.update(state(speed_mps=0.0), PATH, 10, 5.0)


def test_the_newest_trajectory_is_the_one_that_counts() -> None:
    watching = monitor()
    aside = replace(PATH, y_m=np.full(len(PATH), 3.5))
    assert not watching.update(state(), PATH, 10, 5.0)
    assert watching.update(state(), aside, 10, 5.0)


def test_after_a_reset_a_deviation_does_not_stop_a_moving_vehicle() -> None:
    watching = monitor()
    assert watching.update(state(y_m=4.0), PATH, 10, 5.0)
    watching.reset()
    assert not watching.update(state(), PATH, 10, 5.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"y_m": -3.214}, "off the path: distance_m = 3.214, limit 3"),
        ({"heading_rad": -0.85}, "heading away from the path: heading_rad = 0.85, limit 0.8"),
        ({"speed_mps": 21.5}, "faster than the vehicle may go: speed_mps = 21.5, limit 21"),
        ({"speed_mps": -0.6}, "rolling against the direction of travel: rollback_mps = 0.6, limit 0.5"),
        (
            {"y_m": 4.0, "speed_mps": 21.5},
            "off the path: distance_m = 4, limit 3; faster than the vehicle may go: speed_mps = 21.5, limit 21",
        ),
        (
            {"speed_mps": -21.5},
            "faster than the vehicle may go: speed_mps = 21.5, limit 21; "
            "rolling against the direction of travel: rollback_mps = 21.5, limit 0.5",
        ),
        ({"y_m": 2.0}, ""),
    ],
)
def test_a_deviation_is_logged_once_with_value_limit_and_place(
    change: dict[str, float], said: str, caplog: pytest.LogCaptureFixture
) -> None:
    watching = monitor()
    for trajectory in (PATH, PATH, straight(length_m=100.0)):
        watching.update(state(**change), trajectory, 10, 5.0)
    expected = [f"deviation at point 10: {said}"] if said else []
    assert caplog.messages == expected
    watching.update(state(speed_mps=0.0), straight(length_m=100.0), 10, 5.0)
    watching.update(state(**change), PATH, 10, 5.0)
    assert caplog.messages == 2 * expected


@pytest.mark.parametrize(
    ("off_m", "finding", "stops"),
    [
        (1.0, None, False),
        (1.001, DeviationKind.BESIDE, False),
        (3.0, DeviationKind.BESIDE, False),
        (3.001, DeviationKind.OFF_PATH, True),
    ],
)
@pytest.mark.parametrize("is_before", [True, False])
def test_before_the_first_point_and_behind_the_last_the_distance_counts_as_it_does_beside(
    off_m: float, finding: DeviationKind | None, stops: bool, is_before: bool
) -> None:
    watching = monitor()
    x_m, index = (-off_m, 0) if is_before else (100.0 + off_m, 100)
    assert watching.update(state(x_m=x_m), PATH, index, 5.0) is stops
    assert {what: count for what, count in watching.counts.items() if count} == ({finding.value: 1} if finding else {})


def test_a_path_that_begins_300_m_ahead_is_300_m_away(caplog: pytest.LogCaptureFixture) -> None:
    ahead = replace(PATH, x_m=PATH.x_m + 300.0)
    assert monitor().update(state(x_m=0.0), ahead, 0, 5.0)
    assert caplog.messages == ["deviation at point 0: off the path: distance_m = 300, limit 3"]


@pytest.mark.parametrize("turned_rad", [0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi, 2.0 * math.pi])
def test_a_vehicle_anywhere_round_a_closed_lap_does_not_deviate_wherever_the_index_is(turned_rad: float) -> None:
    angle_rad = np.linspace(0.0, math.tau, 201)
    lap = Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.arange(201),
        x_m=15.0 * np.sin(angle_rad),
        y_m=15.0 - 15.0 * np.cos(angle_rad),
        heading_rad=angle_rad,
        speed_mps=np.full(201, 4.0),
    )
    x_m, y_m = 15.0 * math.sin(turned_rad), 15.0 - 15.0 * math.cos(turned_rad)
    for index in (0, 100, 200):
        watching = monitor()
        assert not watching.update(state(x_m=x_m, y_m=y_m, heading_rad=turned_rad), lap, index, 4.0)
        assert not any(watching.counts.values())
        assert watching.update(state(x_m=x_m, y_m=y_m, heading_rad=turned_rad + 1.0), lap, index, 4.0)


def test_after_a_deviation_a_vehicle_on_its_next_trajectory_drives_on_from_standstill_only() -> None:
    """Two searches are a tenth of a second apart then."""
    watching, lanes = monitor(), [replace(PATH, y_m=np.full(len(PATH), y_m)) for y_m in (0.0, 40.0)]
    assert watching.update(state(y_m=20.0), lanes[0], 10, 5.0)
    assert watching.update(state(y_m=20.0, speed_mps=0.0), lanes[1], 10, 5.0)
    assert not watching.update(state(y_m=40.0, speed_mps=0.0), replace(lanes[1]), 10, 5.0)


def test_on_a_coarse_path_the_way_between_two_points_is_the_line_between_them() -> None:
    """A quarter circle of 20 m in two pieces: its points' own tangents are metres away from the line."""
    angle_rad = np.array([0.0, math.pi / 4, math.pi / 2])
    coarse = Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.array([0, 1, 2]),
        x_m=20.0 * np.sin(angle_rad),
        y_m=20.0 - 20.0 * np.cos(angle_rad),
        heading_rad=angle_rad,
        speed_mps=np.full(3, 5.0),
    )
    for part in np.linspace(0.0, math.pi / 2, 50):
        here = state(x_m=20.0 * math.sin(part), y_m=20.0 - 20.0 * math.cos(part), heading_rad=float(part))
        index = 0 if part < math.pi / 4 else 1
        watching = monitor()
        assert not watching.update(here, coarse, index, 5.0)


@pytest.mark.parametrize(("heading_rad", "stops"), [(0.0, False), (math.pi / 2, False), (math.pi, True), (-0.81, True)])
def test_at_a_kink_of_the_path_the_heading_of_either_neighbour_counts(heading_rad: float, stops: bool) -> None:
    corner = Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.array([0, 1]),
        x_m=np.array([0.0, 10.0]),
        y_m=np.zeros(2),
        heading_rad=np.array([0.0, math.pi / 2]),
        speed_mps=np.full(2, 5.0),
    )
    assert monitor().update(state(x_m=5.0, heading_rad=heading_rad), corner, 0, 5.0) is stops


def test_the_path_of_points_at_one_place_is_that_place() -> None:
    dwell = Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.array([0, 1]),
        x_m=np.zeros(2),
        y_m=np.zeros(2),
        heading_rad=np.zeros(2),
        speed_mps=np.zeros(2),
    )
    assert not monitor().update(state(x_m=3.0), dwell, 0, 0.0)
    assert monitor().update(state(x_m=3.1), dwell, 0, 0.0)
    assert monitor().update(state(x_m=0.0, y_m=3.1), dwell, 0, 0.0)


@pytest.mark.parametrize(("greatest_mps", "stops"), [(21.0, False), (21.01, True)])
def test_the_greatest_speed_of_all_sources_counts(greatest_mps: float, stops: bool) -> None:
    assert monitor().update(state(speed_mps=10.0), PATH, 10, 5.0, greatest_mps=greatest_mps) is stops


def test_only_the_prepared_trajectory_is_searched_without_computing_more(monkeypatch: pytest.MonkeyPatch) -> None:
    def must_not_run(*_: object) -> None:
        raise AssertionError

    far, other = state(x_m=90.0, y_m=3.1), straight(length_m=100.0)
    watching, unprepared = monitor(), monitor()
    for _ in watching.prepare(PATH):
        pass
    assert unprepared.update(far, PATH, 10, 5.0)
    monkeypatch.setattr(path_distance, "compute_boxes", must_not_run)
    assert watching.update(far, PATH, 10, 5.0)
    assert watching.counts == unprepared.counts
    with pytest.raises(AssertionError):
        watching.update(far, other, 10, 5.0)
