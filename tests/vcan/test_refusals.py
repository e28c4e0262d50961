"""Files that a loop on a live bus must refuse: with a clear line for each fault, before its first frame."""

import json
from pathlib import Path

import pytest
from vehicle_bus_contract.reference import READY

from .conftest import ROOT, Programs
from .observer import Observer
from .peer import Vehicle

STARTS = str(ROOT / "tests" / "vcan" / "rejected_starts.py")
BAD_USAGE = 2
HEADER = "time_s,x_m,y_m,heading_rad,speed_mps\n"

DBC: dict[str, tuple[str, str, str]] = {
    "cut short": ("BO_ 256 VEHICLE_STATUS", "\0", "reference.dbc"),
    "one identifier twice": ("BO_ 273 MOTION", "BO_ 272 MOTION", "id 272 is already in line"),
    "one name twice": ("BO_ 273 MOTION", "BO_ 273 POSE", "POSE: is already in line"),
    "overlapping signals": ("SPEED : 32|16", "SPEED : 31|16", "overlapping"),
    "factor 0": ("YAW_RATE : 48|16@1- (0.0002,0)", "YAW_RATE : 48|16@1- (0,0)", "MOTION.YAW_RATE: factor 0"),
    "garbage": ("BO_ 272 POSE:", "%%PDF-1.7", "POSE"),
    "another encoding": ("BO_ 256 VEHICLE_STATUS", "BO_ 256 VEHICLE_STATUS\udcff", "reference.dbc"),
}
"""What is replaced by what (`\\0`: cut off there), and the complaint."""
PROFILE: dict[str, tuple[str, str, str]] = {
    "no number": ("speed_max_mps = 20.0", "speed_max_mps = nan", "$.limits.speed_max_mps"),
    "a misspelt key": ("wheelbase_m = 2.7", "wheelbas_m = 2.7", "wheelbas_m"),
    "a wrong type": ("speed_max_mps = 20.0", 'speed_max_mps = "fast"', "$.limits.speed_max_mps: Expected"),
    "a missing limit": ("lateral_accel_mps2 = 3.0", "", "lateral_accel_mps2"),
    "an unknown signal": ("POSE.POS_X", "POSE.POSX", "no signal 'POSX' in POSE"),
    "two fields on one signal": ('"MOTION.SPEED"', '"MOTION.HEADING"', "MOTION.HEADING is already bound"),
}
CSV: dict[str, tuple[str, str]] = {
    "text in a cell": (HEADER + "0,0,0,0,1\n1,1,zero,0,1\n", "line 3, column 3 (y_m): 'zero' is not a number"),
    "decimal commas": (HEADER + "0,0,1,5,2,5,0,1,3,0\n", "line 2, column 6: "),
    "a missing column": ("time_s,x_m,y_m,speed_mps\n0,1,2,3\n", "line 1: missing column heading_rad"),
    "nothing": ("", "line 1: the file is empty"),
    "another delimiter": (HEADER.replace(",", ";") + "0;0;0;0;1\n", "line 1: "),
    "no number": (HEADER + "0,nan,0,0,1\n", "line 2, column 2 (x_m): 'nan' is not finite"),
    "time that goes back": (HEADER + "1,0,0,0,1\n0,1,0,0,1\n", "line 3, column 1 (time_s)"),
    "too fast": (HEADER + "0,0,0,0,25\n1,25,0,0,25\n", "speed_mps[0] = 25: must be in [-20.0, 20.0]"),
    "a step back": (
        HEADER + "0,0,0,0,1\n1,1,0,0,1\n2,2,0,0,1\n3,1.75,0,0,1\n4,3,0,0,1\n",
        "line 5: point 3 lies 0.25 m from point 2 and not ahead of it",
    ),
    "headings that are not the path's": (
        HEADER + "".join(f"{i},{i},0,1.5708,1\n" for i in range(9)),
        "line 3: point 1 lies 1 m from point 0 and not ahead of it",
    ),
    "too sharp": (
        HEADER + "".join(f"{i},{min(i, 8)},{max(0, i - 8)},0,1\n" for i in range(17)),
        "the path turns by 0.7071 rad/m at point 8: must be at most 0.2534 rad/m at 1 m/s",
    ),
}
"""What is in the file, and the complaint."""


def damaged(folder: Path, old: str, new: str, name: str) -> list[str]:
    """Arguments with a copy of the reference profile and its DBC, in one of which this is replaced."""
    folder.mkdir()
    for each in ("reference.dbc", "reference.toml"):
        text = (ROOT / "dbc" / each).read_text(encoding="utf-8")
        if each == name:
            assert old in text
            text = text.partition(old)[0] if new == "\0" else text.replace(old, new, 1)
        (folder / each).write_text(text, encoding="utf-8", errors="surrogateescape")
    return ["--profile", str(folder / "reference.toml"), "--route", "line"]


@pytest.fixture
def cases(tmp_path: Path) -> dict[str, tuple[list[str], str]]:
    """Arguments of the loop, and what it must say."""
    found: dict[str, tuple[list[str], str]] = {}
    for name, faults in (("reference.dbc", DBC), ("reference.toml", PROFILE)):
        for what, (old, new, expected) in faults.items():
            found[f"{name}: {what}"] = damaged(tmp_path / f"{name} {what}", old, new, name), expected
    for what, (content, expected) in CSV.items():
        path = tmp_path / f"{what}.csv"
        path.write_text(content, encoding="utf-8")
        found[f"CSV: {what}"] = ["--trajectory", str(path)], expected
    found["a controller that is none"] = ["--route", "line", "--controller", "none.py:None"], "no such file none.py"
    return found


def test_bad_databases_profiles_and_trajectories_are_rejected_by_name_before_the_first_frame(
    programs: Programs, bus: Observer, vehicle: Vehicle, cases: dict[str, tuple[list[str], str]]
) -> None:
    file, telemetry = programs.folder / "cases.json", programs.telemetry
    usual = ["run", "--arm", "--duration", "1", "--telemetry", telemetry]
    file.write_text(json.dumps([[*usual, *arguments] for arguments, _ in cases.values()]), encoding="utf-8")
    loop = programs.start_python(STARTS, str(file), name="run")
    assert loop.wait_for_end(60.0) == 0
    *complaints, rest = "\n".join(loop.lines).split(f"status {BAD_USAGE}")
    assert not rest
    for (what, (_, expected)), complaint in zip(cases.items(), complaints, strict=True):
        assert expected in complaint, (what, complaint)
    assert bus.sent_by_controller() == []
    assert vehicle.mode == READY
