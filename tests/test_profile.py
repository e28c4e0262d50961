"""A profile is read strictly: what is wrong is named with its file and place."""

import subprocess
import sys
from pathlib import Path

import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile, profile_names

FOLDER = Path(__file__).parents[1] / "dbc"
REFERENCE = (FOLDER / "reference.toml").read_text(encoding="utf-8")


@pytest.fixture
def edited(tmp_path):
    """Write the reference profile with one text replaced; give its path."""

    def write(old, new):
        assert old in REFERENCE
        path = tmp_path / "reference.toml"
        path.write_text(REFERENCE.replace(old, new, 1), encoding="utf-8")
        return path

    return write


def test_the_reference_profile_is_found_by_name():
    profile = load_profile("reference")
    assert profile.name == "reference"
    assert Path(profile.dbc) == FOLDER / "reference.dbc"
    assert Path(profile.file) == FOLDER / "reference.toml"
    assert profile.reviewed is False


def test_a_path_is_that_file_and_its_dbc_lies_beside_it(edited):
    path = edited('name = "reference"', 'name = "mine"')
    for given in (path, str(path)):
        profile = load_profile(given)
        assert profile.name == "mine"
        assert Path(profile.dbc) == path.parent / "reference.dbc"


def test_an_unknown_name_lists_those_that_there_are():
    assert "reference" in profile_names()
    with pytest.raises(ConfigError, match=r"profile 'refrence': .*one of: .*reference"):
        load_profile("refrence")


@pytest.mark.parametrize("name", ["../dbc/reference", "", "/etc/passwd", "reference.dbc"])
def test_a_name_is_not_a_path(name):
    with pytest.raises(ConfigError, match="must be a path ending in"):
        load_profile(name)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read: No such file"):
        load_profile(tmp_path / "none.toml")


# ruff: noqa: E501
FAULTS = [
    ("front_wheel_angle_rad = 0.6", 'front_wheel_angle_rad = "0.6"', "$.limits.front_wheel_angle_rad: Expected float, got str"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = true", "$.limits.front_wheel_angle_rad: Expected float, got bool"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = nan", "$.limits.front_wheel_angle_rad: nan: must be finite"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = inf", "$.limits.front_wheel_angle_rad: inf: must be finite"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = -0.6", "$.limits.front_wheel_angle_rad: Expected float > 0"),
    ("front_wheel_angle_rad = 0.6", "", "$.limits: Object missing required field front_wheel_angle_rad"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_deg = 0.6", "$.limits: Object contains unknown field front_wheel_angle_deg"),
    ("[[0.0, 0.6], [5.0, 0.6]", "[[0.0, 0.6], [0.0, 0.6]", "$.limits.front_wheel_angle_by_speed[1][0]: 0.0: must be above the row before it, 0.0"),
    ("[[0.0, 0.6], [5.0, 0.6], [10.0, 0.2], [20.0, 0.05]]", "[]", "$.limits.front_wheel_angle_by_speed: Expected"),
    ("[[0.0, 3.0], [10.0, 3.0]", "[[0.0, 3.0], [10.0, -3.0]", "$.limits.accel_max_by_speed"),
    ("[[0.0, 3.0], [10.0, 3.0]", "[[0.0, 3.0], [10.0, nan]", "$.limits.accel_max_by_speed"),
    ("lateral_accel_mps2 = 3.0", "", "$.limits: Object missing required field lateral_accel_mps2"),
    ("accel_max_mps2 = 1.0", "", "$.limits.engaging: Object missing required field accel_max_mps2"),
    ("accel_min_mps2 = -6.0", "accel_min_mps2 = 6.0", "$.limits.accel_min_mps2: Expected float < 0"),
    ("state_stale_s = 0.05", "state_stale_s = 0", "$.timing.state_stale_s: Expected float > 0"),
    ("state_stale_s = 0.05", "state_stale_s = 0.7", "$.timing.state_silent_s: 0.5: must be above state_stale_s = 0.7"),
    ("status_stale_s = 0.1 ", "status_stale_s = 0.01 ", "$.timing.status_stale_s: 0.01: must be above status_period_s"),
    ("length_m = 4.6", "length_m = 3.0", "$.geometry.length_m: 3.0: must be at least"),
    ("safe_deceleration_mps2 = 3.0", "safe_deceleration_mps2 = 7.0", "$.behavior.safe_deceleration_mps2: 7.0: must be at most 6.0"),
    ("stop_jerk_mps3 = 30.0", "", "$.behavior: Object missing required field stop_jerk_mps3"),
    ("stop_jerk_mps3 = 30.0", "stop_jerk_mps3 = 0.0", "$.behavior.stop_jerk_mps3: Expected float > 0"),
    ("stop_jerk_mps3 = 30.0", "stop_jerk_mps3 = 14.9", "$.behavior.stop_jerk_mps3: 14.9: must be at least safe_deceleration_mps2 / stop_ease_s = 15.0"),
    ("stop_ease_s = 0.2", "", "$.behavior: Object missing required field stop_ease_s"),
    ("stop_ease_s = 0.2", "stop_ease_s = -0.2", "$.behavior.stop_ease_s: Expected float > 0"),
    ("hold_deceleration_mps2 = 0.0", "", "$.behavior: Object missing required field hold_deceleration_mps2"),
    ("hold_deceleration_mps2 = 0.0", "hold_deceleration_mps2 = -0.5", "$.behavior.hold_deceleration_mps2: Expected float >= 0"),
    ("hold_deceleration_mps2 = 0.0", "hold_deceleration_mps2 = nan", "$.behavior.hold_deceleration_mps2: nan: must be finite"),
    ('stop_steering = "straight"', 'stop_steering = "left"', "$.behavior.stop_steering: Invalid enum value 'left'"),
    ("warning_s = 3.0", "", "$.handover: Object missing required field warning_s"),
    ("warning_s = 3.0", "warning_s = 10.0", "$.handover.warning_s: 10.0: must be below $.timing.shutdown_s = 10.0"),
    ("warning_s = 3.0", "warning_s = -1.0", "$.handover.warning_s: Expected float >= 0"),
    ("profile = 1 ", "profile = 4 ", "$.e2e.profile: Invalid enum value 4"),
    ('data_id_mode = "BOTH"', 'data_id_mode = "HIGH"', "$.e2e.data_id_mode: Invalid enum value 'HIGH'"),
    ("max_counter_step = 3", "max_counter_step = 0", "$.e2e.max_counter_step: Expected int >= 1"),
    ("POSE = 0x110", "POSE = 0x11000", "$.e2e.data_ids"),
    ('"POSE.POS_X"', '"POS_X"', "$.state.signals.x_m: 'POS_X': must be MESSAGE.SIGNAL"),
    ('x_m = "POSE.POS_X"', "", "$.state.signals: Object missing required field x_m"),
    ('mode = "VEHICLE_STATUS.MODE"', "", "$.status.signals: Object missing required field mode"),
    ('enable = ["DRIVE_COMMAND.ENABLE", "STEER_COMMAND.ENABLE"]', "enable = []", "$.command.signals.enable: must name at least one"),
    ('sample = ["POSE", "MOTION", "CHASSIS"]', "sample = []", "$.state.sample: Expected array of length >= 1"),
    ("bitrate = 500000", "bitrate = 500000.5", "$.bus.bitrate: Expected int, got float"),
    ("reviewed = false", "reviewd = false", "$: Object contains unknown field reviewd"),
    ("reviewed = false", 'file = "x"', "$.file: unknown key"),
    ("constants = {}", 'constants = {"BODY_COMMAND.HORN" = nan}', "$.constants.BODY_COMMAND.HORN: nan: must be finite"),
    ("[geometry]", "[geometry", "not TOML: "),
    ("[limits]", "[limitz]", "$: Object"),
    ("ignored = []", 'ignored = ["POSE"]', "$.ignored: 'POSE': must be MESSAGE.SIGNAL"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "text"), FAULTS, ids=[new or f"without {old}" for old, new, _ in FAULTS])
def test_a_fault_is_refused_with_file_and_place(edited, old, new, text):
    with pytest.raises(ConfigError) as refused:
        load_profile(edited(old, new))
    assert str(refused.value).startswith(f"reference.toml: {text}")


@pytest.mark.parametrize(
    ("old", "new"), [("stop_jerk_mps3 = 30.0", "stop_jerk_mps3 = 15.0"), ("warning_s = 3.0", "warning_s = 9.9")]
)
def test_at_the_bound_of_two_numbers_a_profile_is_taken(edited, old, new):
    assert load_profile(edited(old, new)).name == "reference"


def test_without_a_word_about_it_stops_are_straight_and_nobody_is_warned_ahead(tmp_path):
    text = REFERENCE.replace('stop_steering = "straight"', "").replace("[handover]", "").replace("warning_s = 3.0", "")
    path = tmp_path / "plain.toml"
    path.write_text(text.replace("holds = false", ""), encoding="utf-8")
    profile = load_profile(path)
    assert profile.behavior.stop_steering == "straight"
    assert (profile.handover.warning_s, profile.handover.holds) == (0.0, False)


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "binary.toml"
    path.write_bytes(b"name = '\xff\xfe'")
    with pytest.raises(ConfigError, match=r"binary\.toml: byte 8: must be UTF-8"):
        load_profile(path)


def test_a_profile_cannot_be_changed():
    with pytest.raises(AttributeError):
        load_profile("reference").limits.speed_max_mps = 100.0


def test_parts_that_a_vehicle_does_not_have_may_be_left_out(tmp_path):
    text = REFERENCE.split("[body.signals]")[0]
    for line in ("rear_wheel_angle_rad = ", "lateral_speed_mps = ", "gear_request = ", "fault_code = "):
        text = "\n".join(row for row in text.splitlines() if not row.startswith(line + '"'))
    path = tmp_path / "small.toml"
    path.write_text(text, encoding="utf-8")
    profile = load_profile(path)
    assert profile.body is None
    assert profile.state.signals.rear_wheel_angle_rad is None
    assert profile.command.signals.gear_request is None


def test_a_process_that_loaded_a_profile_ends_well():
    """A pattern inside a union made msgspec 0.22 crash one process in three when it ended."""
    script = "from vehicle_iface.profile import load_profile; load_profile('reference')"
    for _ in range(6):
        assert subprocess.run([sys.executable, "-c", script], check=False, cwd=FOLDER.parent).returncode == 0
