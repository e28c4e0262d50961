"""A vehicle without protection, as text: the reference vehicle's numbers, another DBC, and what a test adds to both."""

from collections.abc import Mapping
from pathlib import Path

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

_REFERENCE = (Path(__file__).parents[1] / "dbc/reference.toml").read_text(encoding="utf-8")
_HEAD = _REFERENCE[: _REFERENCE.index("[e2e]")].replace('"reference.dbc"', '"v.dbc"')
_DBC = """\
BU_: PC CAR

BO_ 272 POSE: 8 CAR
 SG_ X : 0|16@1- (0.01,0) [-327|327] "m" PC
 SG_ Y : 16|16@1- (0.01,0) [-327|327] "m" PC
 SG_ YAW : 32|16@1- (0.0001,0) [-3.2|3.2] "rad" PC
 SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s" PC

BO_ 256 STATUS: 2 CAR
 SG_ MODE : 0|3@1+ (1,0) [0|7] "" PC
 SG_ BRAKE : 3|1@1+ (1,0) [0|1] "" PC
 SG_ HANDSHAKE : 4|1@1+ (1,0) [0|1] "" PC
 SG_ ALIVE : 8|8@1+ (1,0) [0|255] "" PC

"""
COMMAND = """\
BO_ 128 CMD: 8 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ ACC : 16|16@1- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ STEER : 32|16@1- (0.0001,0) [-1|1] "rad" CAR
"""
_MODES = '\nVAL_ 256 MODE 0 "MANUAL" 1 "READY" 2 "AUTONOMOUS" 3 "FAULT" 4 "EMERGENCY_STOP" ;\n'
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
SIGNALS = {"enable": "CMD.EN", "accel_mps2": "CMD.ACC", "front_wheel_angle_rad": "CMD.STEER"}


def write_vehicle(
    folder: Path,
    more: str = "",
    *,
    command: str = COMMAND,
    signals: Mapping[str, str] = SIGNALS,
    edits: Mapping[str, str] | None = None,
) -> Path:
    """Write `v.dbc` and `v.toml`; `more` is TOML behind `[command.signals]`, `edits` replace lines before it."""
    bound = "".join(f'{field} = "{name}"\n' for field, name in signals.items())
    head = _HEAD
    for old, new in (edits or {}).items():
        assert old in head, old
        head = head.replace(old, new)
    (folder / "v.toml").write_text(f"{head}{_SIGNALS}[command.signals]\n{bound}{more}", encoding="utf-8")
    (folder / "v.dbc").write_text(f"{_DBC}{command}{_MODES}", encoding="utf-8")
    return folder / "v.toml"


def load_vehicle(
    folder: Path,
    more: str = "",
    *,
    command: str = COMMAND,
    signals: Mapping[str, str] = SIGNALS,
    edits: Mapping[str, str] | None = None,
) -> VehicleDatabase:
    """The vehicle of `write_vehicle`, bound and checked."""
    return load_database(load_profile(write_vehicle(folder, more, command=command, signals=signals, edits=edits)))
