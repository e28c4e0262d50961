"""Vehicles that obey other commands than acceleration and wheel angle: the DBC and the end of the profile of each."""

from pathlib import Path

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

_REFERENCE = (Path(__file__).parents[2] / "dbc/reference.toml").read_text(encoding="utf-8")
LIMITS = {
    "front_wheel_angle_rad = 0.6": "front_wheel_angle_rad = 0.5",
    "accel_max_mps2 = 3.0": "accel_max_mps2 = 2.0",
    "accel_min_mps2 = -6.0": "accel_min_mps2 = -3.5",
    "speed_max_mps = 20.0": "speed_max_mps = 4.5",
    "sample_period_s = 0.01": "sample_period_s = 0.02",
    "command_period_s = 0.01": "command_period_s = 0.02",
    "state_silent_s = 0.5": "state_silent_s = 3.0",
    "hold_deceleration_mps2 = 0.0": "hold_deceleration_mps2 = 0.5",
    "frozen_time_s = 0.09": "frozen_time_s = 0.2",
    '"reference.dbc"': '"v.dbc"',
}
_RECEIVED = """\
BU_: PC CAR

BO_ 272 POSE: 8 CAR
 SG_ X : 0|16@1- (0.01,0) [-327|327] "m" PC
 SG_ Y : 16|16@1- (0.01,0) [-327|327] "m" PC
 SG_ YAW : 32|16@1- (0.0001,0) [-3.2|3.2] "rad" PC
 SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s" PC

BO_ 256 STATUS: 2 CAR
 SG_ MODE : 0|3@1+ (1,0) [0|7] "" PC
 SG_ BRAKE : 3|1@1+ (1,0) [0|1] "" PC
 SG_ GEAR : 4|3@1+ (1,0) [0|7] "" PC

"""
_NAMES = """
VAL_ 256 MODE 0 "MANUAL" 1 "READY" 2 "AUTONOMOUS" 3 "FAULT" 4 "EMERGENCY_STOP" ;
VAL_ 256 GEAR 0 "PARK" 1 "REVERSE" 2 "NEUTRAL" 3 "DRIVE" ;
"""
_GEARS = 'VAL_ 128 GEAR 0 "PARK" 1 "REVERSE" 2 "NEUTRAL" 3 "DRIVE" 7 "NO_REQUEST" ;\n'
_SIGNALS = """
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
"""

ROVER = (
    """\
BO_ 273 MOVE: 8 PC
 SG_ V : 7|16@0- (0.001,0) [-4.8|4.8] "m/s" CAR
 SG_ STEER : 55|16@0- (0.001,0) [-0.58|0.58] "rad" CAR

BO_ 1057 SET_MODE: 1 PC
 SG_ CTRL : 0|8@1+ (1,0) [0|1] "" CAR
""",
    """
[command]
longitudinal = "speed"
[command.signals]
enable = "SET_MODE.CTRL"
speed_mps = "MOVE.V"
front_wheel_angle_rad = "MOVE.STEER"
""",
)
PEDALS = (
    """\
BO_ 128 CMD: 8 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ THROTTLE : 8|10@1+ (0.1,0) [0|100] "%" CAR
 SG_ BRAKE : 24|10@1+ (0.1,0) [0|100] "%" CAR
 SG_ STEER : 40|16@1- (0.0001,0) [-1|1] "rad" CAR
""",
    """
[command]
longitudinal = "pedals"
[command.signals]
enable = "CMD.EN"
throttle = "CMD.THROTTLE"
brake = "CMD.BRAKE"
front_wheel_angle_rad = "CMD.STEER"
[command.pedals]
throttle = [[0.0, 0.0], [1.0, 15.0], [2.0, 40.0]]
brake = [[0.0, 0.0], [4.0, 60.0]]
""",
)
DRIVE_AND_BRAKE = (
    """\
BO_ 128 CMD: 8 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ DRIVE : 8|10@1+ (0.01,0) [0|10] "m/s^2" CAR
 SG_ DECEL : 24|10@1+ (0.01,0) [0|10] "m/s^2" CAR
 SG_ STEER : 40|16@1- (0.0001,0) [-1|1] "rad" CAR
""",
    """
[command]
longitudinal = "drive_and_brake"
[command.signals]
enable = "CMD.EN"
drive_mps2 = "CMD.DRIVE"
brake_mps2 = "CMD.DECEL"
front_wheel_angle_rad = "CMD.STEER"
""",
)
CURVATURE = (
    """\
BO_ 128 CMD: 8 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ GEAR : 1|3@1+ (1,0) [0|7] "" CAR
 SG_ DRIVE : 8|10@1+ (0.01,0) [0|10] "m/s^2" CAR
 SG_ DECEL : 24|10@1+ (0.01,0) [0|10] "m/s^2" CAR
 SG_ BEND : 40|16@1- (0.00002,0) [-0.3|0.3] "1/m" CAR
""",
    """
gear = "STATUS.GEAR"
[command]
longitudinal = "drive_and_brake"
lateral = "curvature"
[command.signals]
enable = "CMD.EN"
drive_mps2 = "CMD.DRIVE"
brake_mps2 = "CMD.DECEL"
gear_request = "CMD.GEAR"
curvature_per_m = "CMD.BEND"
""",
)
TWIST = (
    """\
BO_ 128 CMD: 8 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ V : 8|16@1- (0.001,0) [-5|5] "m/s" CAR
 SG_ TURN : 40|16@1- (0.0001,0) [-2|2] "rad/s" CAR
""",
    """
[command]
longitudinal = "speed"
lateral = "yaw_rate"
[command.signals]
enable = "CMD.EN"
speed_mps = "CMD.V"
yaw_rate_radps = "CMD.TURN"
""",
)
Edits = tuple[tuple[str, str], ...]


def write_vehicle(folder: Path, kind: tuple[str, str], toml: Edits = (), dbc: Edits = ()) -> Path:
    """Write `v.dbc` and `v.toml` of a vehicle with texts replaced."""
    command, end = kind
    text = _REFERENCE[: _REFERENCE.index("[e2e]")] + _SIGNALS + end
    layout = _RECEIVED + command + _NAMES
    for old, new in (*LIMITS.items(), *toml):
        assert old in text, old
        text = text.replace(old, new)
    for old, new in dbc:
        assert old in layout, old
        layout = layout.replace(old, new)
    layout += _GEARS if layout.count("SG_ GEAR ") == 2 else ""
    (folder / "v.toml").write_text(text, encoding="utf-8")
    (folder / "v.dbc").write_text(layout, encoding="utf-8")
    return folder / "v.toml"


def load_vehicle(folder: Path, kind: tuple[str, str], toml: Edits = (), dbc: Edits = ()) -> VehicleDatabase:
    """The vehicle of `write_vehicle`, bound and checked."""
    return load_database(load_profile(write_vehicle(folder, kind, toml, dbc)))
