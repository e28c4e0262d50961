"""A vehicle of three messages with a protection of its own: the reference vehicle's numbers, another DBC."""

from pathlib import Path

from vehicle_iface.codec.database import BoundMessage, VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

_REFERENCE = (Path(__file__).parents[2] / "dbc/reference.toml").read_text(encoding="utf-8")
POSE = """\
BO_ 272 POSE: 8 CAR
 SG_ X : 0|16@1- (0.01,0) [-327|327] "m" PC
 SG_ Y : 16|16@1- (0.01,0) [-327|327] "m" PC
 SG_ YAW : 32|12@1- (0.002,0) [-3.2|3.2] "rad" PC
 SG_ V : 44|12@1- (0.02,0) [-40|40] "m/s" PC
 SG_ SUM : 56|8@1+ (1,0) [0|255] "" PC
"""
COMMAND = """\
BO_ 401 CMD: 8 PC
 SG_ EN : 0|1@0+ (1,0) [0|1] "" CAR
 SG_ COUNTER : 6|6@0+ (1,0) [0|63] "" CAR
 SG_ ACC : 15|16@0- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ STEER : 31|16@0- (0.0001,0) [-1|1] "rad" CAR
 SG_ CHECKSUM : 63|8@0+ (1,0) [0|255] "" CAR
"""
_STATUS = """\
BO_ 256 STATUS: 2 CAR
 SG_ MODE : 0|3@1+ (1,0) [0|7] "" PC

"""
_MODES = 'VAL_ 256 MODE 0 "MANUAL" 1 "READY" 2 "AUTONOMOUS" 3 "FAULT" 4 "EMERGENCY_STOP" ;\n'
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
[command.signals]
enable = "CMD.EN"
accel_mps2 = "CMD.ACC"
front_wheel_angle_rad = "CMD.STEER"
"""
SUM = """
[protection.sum]
checksum = { signal = "SUM", kind = "sum" }
"""


def write_vehicle(
    folder: Path, protection: str, *, command: str = COMMAND, pose: str = POSE, ignored: tuple[str, ...] = ()
) -> Path:
    """Write `v.dbc` and `v.toml`; `protection` is TOML, tables included."""
    head = _REFERENCE[: _REFERENCE.index("[e2e]")].replace('"reference.dbc"', '"v.dbc"')
    head = head.replace("ignored = []", f"ignored = {list(ignored)}")
    (folder / "v.toml").write_text(head + protection + _SIGNALS, encoding="utf-8")
    (folder / "v.dbc").write_text(f"BU_: PC CAR\n\n{pose}\n{_STATUS}{command}\n{_MODES}", encoding="utf-8")
    return folder / "v.toml"


def load_vehicle(
    folder: Path, protection: str, *, command: str = COMMAND, pose: str = POSE, ignored: tuple[str, ...] = ()
) -> VehicleDatabase:
    """The vehicle of `write_vehicle`, bound and checked."""
    path = write_vehicle(folder, protection, command=command, pose=pose, ignored=ignored)
    return load_database(load_profile(path))


def load_command(folder: Path, protection: str, command: str) -> BoundMessage:
    """Its command message; the pose is unprotected."""
    return load_vehicle(folder, protection, command=command, ignored=("POSE.SUM",)).commands[0]
