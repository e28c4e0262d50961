"""Wrong fields of the state: what the profile's tolerances show must stop the vehicle, the rest must do no harm."""

from dataclasses import replace
from pathlib import Path

import pytest
from hil_bench.cases import catalogue_for
from hil_bench.expect import StaysNear, Stops
from hil_bench.peer.build import open_wire
from hil_bench.result import CaseResult, Verdict
from scenes import at, observed
from vehicle_bus_contract.reference import S
from virtual_rig import run_virtual


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
