"""Profiles are found by name or path, read strictly, and frozen."""

import subprocess
import sys
from pathlib import Path

import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile, profile_names

from .conftest import FOLDER, REFERENCE, Edit


def test_the_reference_profile_is_found_by_name() -> None:
    profile = load_profile("reference")
    assert profile.name == "reference"
    assert Path(profile.dbc) == FOLDER / "reference.dbc"
    assert Path(profile.file) == FOLDER / "reference.toml"
    assert profile.reviewed is False


def test_a_path_is_that_file_and_its_dbc_lies_beside_it(edited: Edit) -> None:
    path = edited('name = "reference"', 'name = "mine"')
    for given in (path, str(path)):
        profile = load_profile(given)
        assert profile.name == "mine"
        assert Path(profile.dbc) == path.parent / "reference.dbc"


def test_the_ending_of_a_path_may_be_in_capitals(edited: Edit) -> None:
    path = edited('name = "reference"', 'name = "mine"')
    assert load_profile(path.rename(path.with_suffix(".TOML"))).name == "mine"


def test_an_unknown_name_lists_those_that_there_are() -> None:
    assert "reference" in profile_names()
    with pytest.raises(ConfigError, match=r"profile 'refrence': .*one of: .*reference"):
        load_profile("refrence")


@pytest.mark.parametrize("name", ["../dbc/reference", "", "/etc/passwd", "reference.dbc"])
def test_a_name_is_not_a_path(name: str) -> None:
    with pytest.raises(ConfigError, match="must be a path ending in"):
        load_profile(name)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read: No such file"):
        load_profile(tmp_path / "none.toml")


def test_by_default_stops_are_straight_and_without_a_warning(tmp_path: Path) -> None:
    text = REFERENCE.replace('stop_steering = "straight"', "").replace("[handover]", "").replace("warning_s = 3.0", "")
    path = tmp_path / "plain.toml"
    path.write_text(text.replace("hold_until_warned = false", ""), encoding="utf-8")
    profile = load_profile(path)
    assert profile.behavior.stop_steering == "straight"
    assert (profile.handover.warning_s, profile.handover.hold_until_warned) == (0.0, False)


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"name = '\xff\xfe'")
    with pytest.raises(ConfigError, match=r"binary\.toml: byte 8: must be UTF-8"):
        load_profile(path)


def test_a_profile_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        load_profile("reference").limits.speed_max_mps = 100.0  # type: ignore[misc]


def test_parts_that_a_vehicle_does_not_have_may_be_left_out(tmp_path: Path) -> None:
    text = REFERENCE.split("[body.signals]")[0]
    for line in ("rear_wheel_angle_rad = ", "lateral_speed_mps = ", "gear_request = ", "fault_code = "):
        text = "\n".join(row for row in text.splitlines() if not row.startswith(line + '"'))
    path = tmp_path / "small.toml"
    path.write_text(text, encoding="utf-8")
    profile = load_profile(path)
    assert profile.body is None
    assert profile.state.signals.rear_wheel_angle_rad is None
    assert profile.command.signals.gear_request is None


def test_a_process_that_loaded_a_profile_ends_well() -> None:
    """A pattern inside a union made msgspec 0.22 crash one process in three when it ended."""
    script = "from vehicle_iface.profile import load_profile; load_profile('reference')"
    for _ in range(6):
        assert subprocess.run([sys.executable, "-c", script], check=False, cwd=FOLDER.parent).returncode == 0
