"""Wrong fields of the state: what the profile's tolerances show must stop the vehicle, the rest must do no harm."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hil_bench.cases import catalogue_for
from hil_bench.contradictions import Told, Tolerances, find_contradiction, tell_truth
from hil_bench.expect import DoesNoHarm, StaysNear, Stops
from hil_bench.peer.build import open_wire
from hil_bench.result import CaseResult, Verdict
from hil_bench.vehicle import Instant
from scenes import WIRE, at, find_case, observed, steady
from vehicle_bus_contract.reference import AUTONOMOUS, MS, S
from virtual_rig import run_virtual

MAY = Tolerances.of(WIRE)


def run(name: str, folder: Path, profile: str = "reference") -> CaseResult:
    case = next(case for case in catalogue_for(open_wire(profile)) if case.name == name)
    return run_virtual(case, profile, folder)


@pytest.mark.parametrize(("profile", "must_stop"), [("reference", True), ("vbox_kart", False)])
def test_a_heading_must_stop_the_vehicle_only_where_the_profiles_tolerances_show_it(
    profile: str, must_stop: bool, tmp_path: Path
) -> None:
    case = next(case for case in catalogue_for(open_wire(profile)) if case.name == "sensor-heading-off")
    assert any(isinstance(one, Stops) for one in case.see) is must_stop
    found = run("sensor-heading-off", tmp_path, profile)
    assert found.verdict is Verdict.PASS, found.why


@pytest.mark.parametrize("profile", ["reference", "vbox_kart"])
def test_a_vehicle_that_jumps_brought_to_rest_may_wait_to_be_armed_and_one_in_motion_drives_on(
    profile: str, tmp_path: Path
) -> None:
    found = run("position-jumps", tmp_path, profile)
    assert found.verdict is Verdict.PASS, found.why
    assert any("armed again" in event.text for event in found.events) is (profile == "vbox_kart")


@pytest.mark.parametrize("profile", ["reference", "vbox_kart"])
def test_a_vehicle_that_drifts_is_stopped_where_no_reason_is_sent_also_for_a_contradiction(
    profile: str, tmp_path: Path
) -> None:
    found = run("drifting-off", tmp_path, profile)
    assert found.verdict is Verdict.PASS, found.why


def test_a_device_that_does_not_drive_on_after_jumps_in_motion_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "vehicle_iface.safety.plausibility.PlausibilityCheck.is_persistent", lambda self, **_: any(self.counts.values())
    )
    assert run("position-jumps", tmp_path).verdict is Verdict.FAIL


def test_a_vehicle_beyond_the_distance_is_not_near_its_path() -> None:
    seen = replace(
        observed(history=[replace(at(tick / 100, 1.0), y_m=0.01 * tick) for tick in range(300)]),
        inject_ns=1,
        then_ns=2 * S,
    )
    assert StaysNear(2.0).judge(seen)[0].verdict is Verdict.PASS
    assert StaysNear(1.9).judge(seen)[0].verdict is Verdict.FAIL


@pytest.mark.parametrize(
    ("profile", "name"),
    [
        ("reference", "fields-scaled"),
        ("pacmod3", "fields-swapped"),
        ("new_eagle_raptor", "fields-frozen"),
    ],
)
def test_the_program_stops_for_fields_that_contradict_one_another(profile: str, name: str, tmp_path: Path) -> None:
    found = run(name, tmp_path, profile)
    assert found.verdict is Verdict.PASS, found.why


@pytest.mark.parametrize("name", ["fields-frozen", "fields-swapped"])
def test_a_device_that_compares_nothing_fails_for_every_field(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vehicle_iface.safety.motion.MotionCheck.update", lambda *_, **__: None)
    monkeypatch.setattr("vehicle_iface.safety.plausibility.PlausibilityCheck.is_plausible", lambda *_, **__: True)
    case = find_case(name)
    failed = {one.text.split(":")[0] for one in run(name, tmp_path).checks if one.verdict is Verdict.FAIL}
    assert {step.name for step in case.steps} <= failed


def driven(**told: Callable[[float], float]) -> list[tuple[int, Told]]:
    """Three seconds on a circle of 12 m radius at 4 m/s; `told` by the time since the first second."""
    samples: list[tuple[int, Told]] = []
    for tick in range(300):
        turned_rad = 4.0 * tick / 100 / 12.0
        fields = tell_truth(
            Instant(
                tick * 10 * MS,
                12.0 * math.sin(turned_rad),
                12.0 * (1.0 - math.cos(turned_rad)),
                turned_rad,
                4.0,
                0.0,
                math.atan(MAY.wheelbase_m / 12.0),
                AUTONOMOUS,
            ),
            MAY.wheelbase_m,
        )
        late_s = max(0.0, tick / 100 - 1.0)
        samples.append((tick * 10 * MS, fields | {name: fields[name] + more(late_s) for name, more in told.items()}))
    return samples


def test_a_sound_drive_contradicts_nothing() -> None:
    assert find_contradiction(driven(), MAY, S) == (0, "")


@pytest.mark.parametrize(
    ("told", "what"),
    [
        ({"SPEED": lambda late_s: 0.6 * (late_s > 0.0)}, "position and speed"),
        ({"POS_X": lambda late_s: late_s, "POS_Y": lambda late_s: late_s}, "position and speed"),
        ({"LATERAL_SPEED": lambda late_s: 0.7 * (late_s > 0.0)}, "position and heading"),
        ({"ACCEL": lambda late_s: 2.0 * (late_s > 0.0)}, "speed and acceleration"),
        ({"HEADING": lambda late_s: 0.25 * late_s}, "heading and yaw rate"),
        ({"FRONT_WHEEL_ANGLE": lambda late_s: -0.2 * (late_s > 0.0)}, "yaw rate and wheels"),
    ],
)
def test_a_field_that_is_clearly_off_contradicts_another_within_two_seconds(
    told: dict[str, Callable[[float], float]], what: str
) -> None:
    shown_ns, found = find_contradiction(driven(**told), MAY, S)
    assert S < shown_ns < 3 * S
    assert found == what


def test_a_field_that_is_not_sent_contradicts_nothing() -> None:
    blind = replace(MAY, has=MAY.has - {"ACCEL"})
    assert find_contradiction(driven(ACCEL=lambda late_s: 2.0 * (late_s > 0.0)), blind, S) == (0, "")
    assert not replace(MAY, has=frozenset({"SPEED", "FRONT_WHEEL_ANGLE"})).is_compared("SPEED")


def test_a_vehicle_that_is_driven_off_its_path_or_long_too_fast_comes_to_harm() -> None:
    pairs = steady(5, 8)
    for speed_mps, y_m, verdict in ((3.0, 2.9, Verdict.PASS), (3.0, 3.1, Verdict.FAIL), (4.0, 0.0, Verdict.FAIL)):
        history = [replace(at(5.0 + tick / 100, speed_mps), y_m=y_m) for tick in range(300)]
        assert DoesNoHarm().judge(replace(observed(*pairs, history=history), end_ns=8 * S))[0].verdict is verdict
