"""Vehicles of other vendors, each as small as its point allows: NAME.dbc and NAME.toml, with the reference's numbers.

Unless its DBC has a CMD itself, a vehicle obeys the one below.
"""

from pathlib import Path

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

_FOLDER = Path(__file__).parent
_REFERENCE = (Path(__file__).parents[2] / "dbc/reference.toml").read_text(encoding="utf-8")
_COMMAND = """
BO_ 128 CMD: 8 PC
 SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR
 SG_ ACC : 16|16@1- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ STEER : 32|16@1- (0.0001,0) [-1|1] "rad" CAR
 SG_ SPD : 48|16@1- (0.01,0) [-50|50] "m/s" CAR

"""
_COMMAND_SIGNALS = """
[command.signals]
enable = "CMD.EN"
accel_mps2 = "CMD.ACC"
front_wheel_angle_rad = "CMD.STEER"
speed_mps = "CMD.SPD"
"""


def load_vehicle(name: str, folder: Path) -> VehicleDatabase:
    """The vehicle of that name, bound and checked."""
    toml, dbc = (((_FOLDER / name).with_suffix(kind)).read_text(encoding="utf-8") for kind in (".toml", ".dbc"))
    return load_text(toml, dbc, folder)


def load_text(toml: str, dbc: str, folder: Path) -> VehicleDatabase:
    """A vehicle of these texts, which are written to the folder."""
    head = _REFERENCE[: _REFERENCE.index("[e2e]")].replace('"reference.dbc"', '"v.dbc"')
    command = "" if " CMD:" in dbc else _COMMAND
    (folder / "v.dbc").write_text(f"BU_: PC CAR\n{command}\n{dbc}", encoding="utf-8")
    (folder / "v.toml").write_text(head + toml + _COMMAND_SIGNALS, encoding="utf-8")
    return load_database(load_profile(folder / "v.toml"))
