"""Every fault of a profile is reported with its file and place, all at once."""

from pathlib import Path

import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile

from .conftest import REFERENCE, Edit

# ruff: noqa: E501
FAULTS = [
    ("front_wheel_angle_rad = 0.6", 'front_wheel_angle_rad = "0.6"', "$.limits.front_wheel_angle_rad: Expected float, got str"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = true", "$.limits.front_wheel_angle_rad: Expected float, got bool"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = nan", "$.limits.front_wheel_angle_rad: nan: must be finite"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = inf", "$.limits.front_wheel_angle_rad: inf: must be finite"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = -0.6", "$.limits.front_wheel_angle_rad: Expected float > 0.0, not -0.6"),
    ("front_wheel_angle_rad = 0.6", "", "$.limits: front_wheel_angle_rad is missing"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_deg = 0.6", "$.limits.front_wheel_angle_deg: unknown key; did you mean 'front_wheel_angle_rad'?"),
    ("[[0.0, 0.6], [5.0, 0.6]", "[[0.0, 0.6], [0.0, 0.6]", "$.limits.front_wheel_angle_by_speed[1][0]: 0.0: must be above the row before it, 0.0"),
    ("[[0.0, 0.6], [5.0, 0.6], [10.0, 0.2], [20.0, 0.05]]", "[]", "$.limits.front_wheel_angle_by_speed: Expected"),
    ("[[0.0, 3.0], [10.0, 3.0]", "[[0.0, 3.0], [10.0, -3.0]", "$.limits.accel_max_by_speed"),
    ("[[0.0, 3.0], [10.0, 3.0]", "[[0.0, 3.0], [10.0, nan]", "$.limits.accel_max_by_speed"),
    ("lateral_accel_mps2 = 3.0", "", "$.limits: lateral_accel_mps2 is missing"),
    ("accel_max_mps2 = 1.0", "", "$.limits.while_engaging: accel_max_mps2 is missing"),
    ("accel_min_mps2 = -6.0", "accel_min_mps2 = 6.0", "$.limits.accel_min_mps2: Expected float < 0"),
    ("state_stale_s = 0.05", "state_stale_s = 0", "$.timing.state_stale_s: Expected float > 0"),
    ("state_stale_s = 0.05", "state_stale_s = 0.7", "$.timing.state_silent_s: 0.5: must be above state_stale_s = 0.7"),
    ("status_stale_s = 0.1 ", "status_stale_s = 0.01 ", "$.timing.status_stale_s: 0.01: must be above status_period_s"),
    ("length_m = 4.6", "length_m = 3.0", "$.geometry.length_m: 3.0: must be at least"),
    ("safe_deceleration_mps2 = 3.0", "safe_deceleration_mps2 = 7.0", "$.behavior.safe_deceleration_mps2: 7.0: must be at most 6.0"),
    ("stop_jerk_mps3 = 30.0", "", "$.behavior: stop_jerk_mps3 is missing"),
    ("stop_jerk_mps3 = 30.0", "stop_jerk_mps3 = 0.0", "$.behavior.stop_jerk_mps3: Expected float > 0"),
    ("stop_jerk_mps3 = 30.0", "stop_jerk_mps3 = 14.9", "$.behavior.stop_jerk_mps3: 14.9: must be at least safe_deceleration_mps2 / stop_release_time_constant_s = 15.0"),
    ("stop_release_time_constant_s = 0.2", "", "$.behavior: stop_release_time_constant_s is missing"),
    ("stop_release_time_constant_s = 0.2", "stop_release_time_constant_s = -0.2", "$.behavior.stop_release_time_constant_s: Expected float > 0"),
    ("hold_deceleration_mps2 = 0.0", "", "$.behavior: hold_deceleration_mps2 is missing"),
    ("hold_deceleration_mps2 = 0.0", "hold_deceleration_mps2 = -0.5", "$.behavior.hold_deceleration_mps2: Expected float >= 0"),
    ("hold_deceleration_mps2 = 0.0", "hold_deceleration_mps2 = nan", "$.behavior.hold_deceleration_mps2: nan: must be finite"),
    ('stop_steering = "straight"', 'stop_steering = "left"', "$.behavior.stop_steering: Invalid enum value 'left'; must be one of: straight, hold, track"),
    ("warning_s = 3.0", "", "$.handover: warning_s is missing"),
    ("warning_s = 3.0", "warning_s = 10.0", "$.handover.warning_s: 10.0: must be below $.timing.shutdown_s = 10.0"),
    ("warning_s = 3.0", "warning_s = -1.0", "$.handover.warning_s: Expected float >= 0"),
    ("profile = 1 ", "profile = 4 ", "$.e2e.profile: Invalid enum value 4"),
    ('stop_steering = "straight"', 'stop_steering = "strait"', "$.behavior.stop_steering: Invalid enum value 'strait'; must be one of: straight, hold, track; nearest: straight"),
    ("[5.0, 0.6], [10.0, 0.2]", "[5.0, -0.6], [10.0, 0.2]", "$.limits.front_wheel_angle_by_speed[1][1]: Expected float > 0.0, not -0.6"),
    ("POSE = 0x110", "POSE = 70000", "$.e2e.data_ids.POSE: Expected int <= 65535, not 70000"),
    ('data_id_mode = "BOTH"', 'data_id_mode = "HIGH"', "$.e2e.data_id_mode: Invalid enum value 'HIGH'"),
    ("max_counter_step = 3", "max_counter_step = 0", "$.e2e.max_counter_step: Expected int >= 1"),
    ("POSE = 0x110", "POSE = 0x11000", "$.e2e.data_ids"),
    ('"POSE.POS_X"', '"POS_X"', "$.state.signals.x_m: 'POS_X': must be MESSAGE.SIGNAL"),
    ('x_m = "POSE.POS_X"', "", "$.state.signals: x_m is missing"),
    ('mode = "VEHICLE_STATUS.MODE"', "", "$.status.signals: mode is missing"),
    ('enable = ["DRIVE_COMMAND.ENABLE", "STEER_COMMAND.ENABLE"]', "enable = []", "$.command.signals.enable: must name at least one"),
    ('sample = ["POSE", "MOTION", "CHASSIS"]', "sample = []", "$.state.sample: Expected array of length >= 1"),
    ("bitrate = 500000", "bitrate = 500000.5", "$.bus.bitrate: Expected int, got float"),
    ("reviewed = false", "reviewd = false", "$.reviewd: unknown key; did you mean 'reviewed'?"),
    ("reviewed = false", 'file = "x"', "$.file: unknown key"),
    ("constants = {}", 'constants = {"BODY_COMMAND.HORN" = nan}', "$.constants.BODY_COMMAND.HORN: nan: must be finite"),
    ("[geometry]", "[geometry", "not TOML: "),
    ("[limits]", "[limitz]", "$.limitz: unknown key; did you mean 'limits'?"),
    ("ignored = []", 'ignored = ["POSE"]', "$.ignored: 'POSE': must be MESSAGE.SIGNAL"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "text"), FAULTS, ids=[new or f"without {old}" for old, new, _ in FAULTS])
def test_a_fault_is_refused_with_file_and_place(edited: Edit, old: str, new: str, text: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load_profile(edited(old, new))
    assert str(refused.value).startswith(f"reference.toml: {text}")


def test_every_fault_is_reported_at_once(tmp_path: Path) -> None:
    path = tmp_path / "reference.toml"
    text = REFERENCE.replace("reviewed = false", "reviewd = false").replace("warning_s = 3.0", "warning_s = 10.0")
    path.write_text(
        text.replace("state_stale_s = 0.05", "state_stale_s = 0.7").replace("track_m = 1.6", "track_m = nan")
    )
    with pytest.raises(ConfigError) as refused:
        load_profile(path)
    assert str(refused.value).splitlines() == [
        "reference.toml: $.geometry.track_m: nan: must be finite",
        "reference.toml: $.reviewd: unknown key; did you mean 'reviewed'?",
        "reference.toml: $.timing.state_silent_s: 0.5: must be above state_stale_s = 0.7",
        "reference.toml: $.handover.warning_s: 10.0: must be below $.timing.shutdown_s = 10.0",
    ]
    path.write_text(path.read_text(encoding="utf-8").replace("track_m = nan", "track_m = 1.6"), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        load_profile(path)
    assert [line.split(": ")[1] for line in str(refused.value).splitlines()] == [
        "$.reviewd",
        "$.timing.state_silent_s",
        "$.handover.warning_s",
    ]


@pytest.mark.parametrize(
    ("old", "new"), [("stop_jerk_mps3 = 30.0", "stop_jerk_mps3 = 15.0"), ("warning_s = 3.0", "warning_s = 9.9")]
)
def test_at_the_bound_of_two_numbers_a_profile_is_taken(edited: Edit, old: str, new: str) -> None:
    assert load_profile(edited(old, new)).name == "reference"
