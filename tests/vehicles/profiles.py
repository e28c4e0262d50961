"""Vehicles of other makers, each a small DBC and a TOML: a base, and what is different."""

from collections.abc import Iterable
from pathlib import Path

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

DBC = """VERSION ""
NS_ :
BS_:
BU_: PC CAR

BO_ 272 POSE: 8 CAR
 SG_ X : 0|16@1- (0.01,0) [-327|327] "m" PC
 SG_ Y : 16|16@1- (0.01,0) [-327|327] "m" PC
 SG_ YAW : 32|16@1- (0.0001,0) [-3.2|3.2] "rad" PC
 SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s" PC

BO_ 256 STATUS: 2 CAR
 SG_ MODE : 0|3@1+ (1,0) [0|7] "" PC
 SG_ BRAKE : 3|1@1+ (1,0) [0|1] "" PC

BO_ 128 CMD: 8 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ ACC : 16|16@1- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ STEER : 32|16@1- (0.0001,0) [-1|1] "rad" CAR
 SG_ SPD : 48|16@1- (0.01,0) [-50|50] "m/s" CAR

VAL_ 256 MODE 0 "MANUAL" 1 "READY" 2 "AUTONOMOUS" 3 "FAULT" 4 "EMERGENCY_STOP" ;
"""
BASE = """name = "v"
dbc = "v.dbc"
reviewed = true

[geometry]
wheelbase_m = 2.7
length_m = 4.6
width_m = 1.9
height_m = 1.5
rear_overhang_m = 0.95
track_m = 1.6
wheel_radius_m = 0.33

[limits]
front_wheel_angle_rad = 0.5
front_wheel_angle_by_speed = [[0.0, 0.5], [5.0, 0.5], [20.0, 0.05]]
front_wheel_rate_radps = 0.5
front_wheel_deviation_rad = 0.3
lateral_accel_mps2 = 3.0
lateral_jerk_mps3 = 5.0
rear_wheel_angle_rad = 0.0
rear_wheel_rate_radps = 0.0
accel_max_mps2 = 2.0
accel_max_by_speed = [[0.0, 2.0]]
accel_min_mps2 = -3.5
accel_rate_mps3 = 30.0
speed_max_mps = 15.0
gear_change_speed_mps = 0.5
driver_steer_torque_nm = 3.0

[limits.while_engaging]
front_wheel_rate_radps = 0.3
accel_max_mps2 = 1.0

[timing]
sample_period_s = 0.02
status_period_s = 0.02
command_period_s = 0.02
body_period_s = 0.1
report_period_s = 0.1
state_stale_s = 0.1
state_silent_s = 0.5
max_command_age_s = 0.1
status_stale_s = 0.3
engage_settle_s = 0.5
engage_timeout_s = 3.0
shutdown_s = 10.0
controller_budget_s = 0.05

[behavior]
safe_deceleration_mps2 = 3.0
time_step_s = 0.1
stop_jerk_mps3 = 30.0
stop_release_time_constant_s = 0.2
hold_deceleration_mps2 = 0.5

[handover]
warning_s = 3.0

[deviation]
lateral_warn_m = 1.0
lateral_stop_m = 3.0
heading_stop_rad = 0.8
overspeed_mps = 1.0
rollback_mps = 0.5

[plausibility]
speed_mps = 40.0
accel_mps2 = 20.0
speed_tolerance_mps = 0.5
position_tolerance_m = 0.5
yaw_rate_radps = 3.0
heading_tolerance_rad = 0.2
yaw_rate_tolerance_radps = 0.8
frozen_distance_m = 0.5
frozen_time_s = 0.2
frozen_min_speed_mps = 0.5

[bus]
bitrate = 500000

[state]
sample = ["POSE"]

[state.signals]
x_m = "POSE.X"
y_m = "POSE.Y"
heading_rad = "POSE.YAW"
speed_mps = "POSE.V"

[status.signals]
mode = "STATUS.MODE"
driver_brake = "STATUS.BRAKE"

[command.signals]
enable = "CMD.EN"
accel_mps2 = "CMD.ACC"
front_wheel_angle_rad = "CMD.STEER"
speed_mps = "CMD.SPD"
"""
Edits = Iterable[tuple[str, str]]


def write_vehicle(folder: Path, *, dbc: Edits = (), toml: Edits = (), more: str = "") -> Path:
    """The profile's file, the base with texts replaced, and `more` at its end; each text must be there."""
    (folder / "v.dbc").write_text(_edit(DBC, dbc))
    (folder / "v.toml").write_text(_edit(BASE, toml) + more)
    return folder / "v.toml"


def load_vehicle(folder: Path, *, dbc: Edits = (), toml: Edits = (), more: str = "") -> VehicleDatabase:
    """That vehicle, bound; `ConfigError` when it does not fit."""
    return load_database(load_profile(write_vehicle(folder, dbc=dbc, toml=toml, more=more)))


def _edit(text: str, edits: Edits) -> str:
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    return text
