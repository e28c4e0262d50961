"""A vehicle on two buses: a car and an INS that both have a message STATUS of id 256, with the reference's numbers."""

import re
from collections.abc import Mapping
from pathlib import Path

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

_REFERENCE = (Path(__file__).parents[2] / "dbc/reference.toml").read_text(encoding="utf-8")
_MODES = 'VAL_ 256 MODE 0 "MANUAL" 1 "READY" 2 "AUTONOMOUS" 3 "FAULT" 4 "EMERGENCY_STOP" ;\n'
CAR = f"""\
BU_: PC CAR

BO_ 128 CMD: 8 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ ECHO : 8|8@1+ (1,0) [0|255] "" CAR
 SG_ ACC : 16|16@1- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ STEER : 32|16@1- (0.0001,0) [-1|1] "rad" CAR

BO_ 272 WHEELS: 4 CAR
 SG_ V : 0|16@1- (0.01,0) [-50|50] "m/s" PC

BO_ 256 STATUS: 2 CAR
 SG_ MODE : 0|3@1+ (1,0) [0|7] "" PC
 SG_ BRAKE : 3|1@1+ (1,0) [0|1] "" PC
 SG_ ALIVE : 8|8@1+ (1,0) [0|255] "" PC

{_MODES}"""
INS = """\
BU_: INS LOGGER

BO_ 1537 INS_POS: 8 INS
 SG_ N : 0|32@1- (0.0001,0) [-200000|200000] "m" LOGGER
 SG_ E : 32|32@1- (0.0001,0) [-200000|200000] "m" LOGGER

BO_ 1543 INS_ATT: 2 INS
 SG_ YAW : 0|16@1- (0.0001,0) [-3.2|3.2] "rad" LOGGER

BO_ 256 STATUS: 1 INS
 SG_ FIX : 0|2@1+ (1,0) [0|3] "" LOGGER

BO_ 1539 INS_POS_AID: 1 LOGGER
 SG_ ON : 0|1@1+ (1,0) [0|1] "" INS
"""
BUSES = """
[buses.vehicle]
dbc = "car.dbc"
bitrate = 500000
[buses.ins]
dbc = "ins.dbc"
bitrate = 1000000
"""
SIGNALS = """
[state]
sample = ["INS_POS", "INS_ATT", "WHEELS"]
assemble = "newest"
max_age_s = { INS_ATT = 0.03, WHEELS = 0.03 }
[state.pose]
valid = { signal = "ins:STATUS.FIX", equals = 3 }
[state.signals]
x_m = "INS_POS.E"
y_m = "INS_POS.N"
heading_rad = "INS_ATT.YAW"
speed_mps = "WHEELS.V"
[status.signals]
mode = "vehicle:STATUS.MODE"
driver_brake = "vehicle:STATUS.BRAKE"
[command.signals]
enable = "CMD.EN"
accel_mps2 = "CMD.ACC"
front_wheel_angle_rad = "CMD.STEER"
[command.values]
"CMD.ECHO" = { echo = "vehicle:STATUS.ALIVE" }
"""


def write_vehicle(folder: Path, edits: Mapping[str, str] | None = None) -> Path:
    """Write `v.toml`, `car.dbc` and `ins.dbc`; `edits` replace texts of the profile."""
    head = re.sub(r"^dbc = .*\n", "", _REFERENCE[: _REFERENCE.index("[bus]")], flags=re.MULTILINE)
    toml = head + BUSES + SIGNALS
    for old, new in (edits or {}).items():
        assert old in toml, old
        toml = toml.replace(old, new)
    (folder / "car.dbc").write_text(CAR, encoding="utf-8")
    (folder / "ins.dbc").write_text(INS, encoding="utf-8")
    (folder / "v.toml").write_text(toml, encoding="utf-8")
    return folder / "v.toml"


def load_vehicle(folder: Path, edits: Mapping[str, str] | None = None) -> VehicleDatabase:
    """The vehicle of `write_vehicle`, bound and checked."""
    return load_database(load_profile(write_vehicle(folder, edits)))
