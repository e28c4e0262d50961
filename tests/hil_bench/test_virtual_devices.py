"""Cases in virtual time: what a device without a process can be put through, and that its defects show."""

from pathlib import Path

import pytest
from hil_bench.cases import catalogue_for
from hil_bench.peer.build import open_wire
from hil_bench.result import CaseResult, Verdict
from virtual_rig import run_virtual

CASES = {case.name: case for case in catalogue_for(open_wire("reference"))}


def run(name: str, folder: Path, *, is_minimal: bool = False, defect: str = "") -> CaseResult:
    return run_virtual(CASES[name], "reference", folder, is_minimal=is_minimal, defect=defect)


def failed(result: CaseResult) -> list[str]:
    return [check.text for check in result.checks if check.verdict is Verdict.FAIL]


@pytest.mark.parametrize(
    "name",
    [
        *("link-down", "second-commander", "paused-2-s", "wall-clock-back-an-hour", "not-armed", "killed"),
        *("messages-in-turn", "state-in-turn", "releases-in-turn", "drifting-off-and-back"),
        *("not-fit-to-engage", "driver-brakes-while-held", "fault-during-the-end"),
    ],
)
@pytest.mark.parametrize("is_minimal", [False, True], ids=["program", "minimal"])
def test_a_sound_device_passes(name: str, is_minimal: bool, tmp_path: Path) -> None:
    result = run(name, tmp_path, is_minimal=is_minimal)
    assert (result.verdict, failed(result)) == (Verdict.PASS, [])


def test_a_trajectory_that_the_vehicle_cannot_follow_is_rejected_with_the_programs_status(tmp_path: Path) -> None:
    assert run("trajectory-too-sharp", tmp_path).verdict is Verdict.PASS


@pytest.mark.parametrize(
    ("defect", "name", "text"),
    [
        ("commands_after_override", "driver-brakes", "ENABLE = 0 with DRIVER_OVERRIDE within 60 ms"),
        ("late_by_30_ms", "latency-at-0-percent-load", "half of the answers"),
        ("jerk_unlimited", "end-of-space", "steering, lateral acceleration, braking and jerk"),
        ("counter_repeated_with_fresh_crc", "end-of-space", "its counters advance by one"),
    ],
)
def test_a_defect_of_the_minimal_controller_shows(defect: str, name: str, text: str, tmp_path: Path) -> None:
    assert any(found.startswith(text) for found in failed(run(name, tmp_path, is_minimal=True, defect=defect)))
