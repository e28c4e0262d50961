"""Vehicles with an INS, wheel speeds and a steering wheel: latitudes, compass headings, degrees, ratios."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.kinematics import SensorNoise, drive_route
from tests.vehicles.profiles import BASE, DBC
from vehicle_iface import VehicleState
from vehicle_iface.codec.database import load_database
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.drivable import build_route
from vehicle_iface.frame import CanFrame
from vehicle_iface.pose import Pose
from vehicle_iface.pose.build import build_pose_sensor
from vehicle_iface.profile import load_profile
from vehicle_iface.review.findings import Judgement
from vehicle_iface.review.review import Review, review_drive
from vehicle_iface.review.series import read_drive
from vehicle_iface.status import VehicleMode

from .drives import write_log

MESSAGES = """\
BO_ 512 INS_POS: 8 CAR
 SG_ LAT : 0|32@1- (1e-07,0) [-90|90] "deg" PC
 SG_ LON : 32|32@1- (1e-07,0) [-180|180] "deg" PC

BO_ 513 INS_ATT: 6 CAR
 SG_ HEADING : 0|16@1+ (0.01,0) [0|360] "" PC
 SG_ MODE : 16|8@1+ (1,0) [0|255] "" PC
 SG_ CHECKSUM : 40|8@1+ (1,0) [0|255] "" PC

BO_ 514 WHEELS: 4 CAR
 SG_ RL : 0|16@1+ (0.01,0) [0|300] "km/h" PC
 SG_ RR : 16|16@1+ (0.01,0) [0|300] "km/h" PC

BO_ 515 EPS: 4 CAR
 SG_ ANGLE : 0|16@1- (0.1,0) [-720|720] "deg" PC

BO_ 516 ESP: 4 CAR
 SG_ YAW : 0|16@1- (0.01,0) [-300|300] "deg/s" PC
 SG_ AX : 16|16@1- (0.001,0) [-2|2] "g" PC

BO_ 256"""
SIGNALS = """sample = ["INS_POS", "INS_ATT", "WHEELS", "EPS", "ESP"]

[state.pose]
source = "geographic"
origin = [52.0601, 5.1102]
mount = { x_m = 1.2 }
valid = { signal = "INS_ATT.MODE", equals = 4 }

[state.signals]
latitude_deg = "INS_POS.LAT"
longitude_deg = "INS_POS.LON"
heading_rad = "INS_ATT.HEADING"
speed_mps = { mean = ["WHEELS.RL", "WHEELS.RR"] }
yaw_rate_radps = "ESP.YAW"
accel_mps2 = "ESP.AX"
front_wheel_angle_rad = "EPS.ANGLE"
"""
COMPASS = 'unit = "deg"\nscale = -1.0\noffset = 1.5707963'
NOTES = {"INS_ATT.HEADING": COMPASS, "EPS.ANGLE": "scale = 0.0649351"}
"""A steering wheel that turns 15.4 times as far as the wheels."""
PERIODS = {"INS_POS": 2, "INS_ATT": 2, "WHEELS": 2, "EPS": 1, "ESP": 2}
"""In samples of 10 ms."""


def write_vehicle(folder: Path, notes: Mapping[str, str]) -> Path:
    """The profile with these notes instead of the right ones."""
    (folder / "v.dbc").write_text(DBC.replace("BO_ 256", MESSAGES))
    begin, end = BASE.index('sample = ["POSE"]'), BASE.index("[status.signals]")
    cycles = "".join(f"[messages.{name}]\ncycle_ms = {10 * period}\n" for name, period in PERIODS.items())
    lines = "".join(f'[signals."{signal}"]\n{text}\n' for signal, text in notes.items())
    (folder / "v.toml").write_text(BASE[:begin] + SIGNALS + BASE[end:] + cycles + lines)
    return folder / "v.toml"


@cache
def states() -> tuple[VehicleState, ...]:
    profile = load_profile("reference")
    return tuple(drive_route(build_route("figure8", profile), SensorNoise(speed_mps=0.03), 3))


def drive(folder: Path, late_ms: Mapping[str, int] | None = None) -> list[CanFrame]:
    """The frames of a drive of the vehicle as it is."""
    profile = load_profile(write_vehicle(folder, NOTES))
    database = load_database(profile)
    encoder, measure = Encoder(database.received), build_pose_sensor(profile)
    frames = []
    for tick, state in enumerate(states()):
        pose = measure(Pose(x_m=state.x_m, y_m=state.y_m, heading_rad=state.heading_rad))
        turn = (1.5707963 - (pose.heading_rad or 0.0)) % 6.283185
        values = SimpleNamespace(
            latitude_deg=pose.latitude_deg,
            longitude_deg=pose.longitude_deg,
            heading_rad=1.5707963 - turn,
            speed_mps=max(0.0, state.speed_mps),
            yaw_rate_radps=state.yaw_rate_radps,
            accel_mps2=state.accel_mps2,
            front_wheel_angle_rad=state.front_wheel_angle_rad,
            valid=4,
            mode=VehicleMode.READY,
            driver_brake=0,
        )
        for name in [*(name for name, period in PERIODS.items() if tick % period == 0), *(["STATUS"] * (tick % 2))]:
            frame = encoder.encode(name, values)
            stamp_ns = 10_000_000 * tick + 1_000_000 * (late_ms or {}).get(name, 0)
            if name == "INS_ATT":
                frame = frame._replace(data=frame.data[:5] + bytes([(sum(frame.data[:5]) + 2 + 1 + 6) % 256]))
            frames.append(frame._replace(stamp_ns=stamp_ns))
    return sorted(frames, key=lambda frame: frame.stamp_ns)


def review(folder: Path, notes: Mapping[str, str], late_ms: Mapping[str, int] | None = None) -> Review:
    log = write_log(folder / "drive.log", drive(folder, late_ms))
    return review_drive(read_drive(log, load_profile(write_vehicle(folder, notes))))


def texts(found: Review) -> list[str]:
    return [finding.text for finding in found.contradictions]


def test_nothing_is_invented_about_the_right_profile(tmp_path: Path) -> None:
    found = review(tmp_path, NOTES)
    assert texts(found) == []
    judged = {one.field for one in found.bindings if one.judgement is Judgement.AGREES}
    assert {"position", "heading_rad", "speed_mps", "yaw_rate_radps", "front_wheel_angle_rad", "accel_mps2"} <= judged


@pytest.mark.parametrize(
    ("signal", "lines", "text"),
    [
        ("INS_ATT.HEADING", 'unit = "deg"', "INS_ATT.HEADING is clockwise from north"),
        ("INS_ATT.HEADING", 'unit = "rad"\nscale = -1.0\noffset = 1.5707963', "INS_ATT.HEADING is in deg, not in rad"),
        ("EPS.ANGLE", "", "steering ratio is about 15."),
        ("EPS.ANGLE", "scale = 0.05", "steering ratio is about 15."),
        ("EPS.ANGLE", "scale = -0.0649351", "sign of EPS.ANGLE is reversed"),
        ('WHEELS.RL"]\nunit = "mph"\n[signals."WHEELS.RR', 'unit = "mph"', "WHEELS.RL/RR is in km/h, not in mph"),
        ("ESP.AX", 'unit = "m/s^2"', "ESP.AX is in g, not in m/s^2"),
        ("ESP.YAW", 'unit = "rad/s"', "ESP.YAW is in deg/s, not in rad/s"),
    ],
)
def test_a_wrong_note_is_named_and_nothing_else(tmp_path: Path, signal: str, lines: str, text: str) -> None:
    (found,) = texts(review(tmp_path, NOTES | {signal: lines}))
    assert found.startswith(text)


def test_an_ins_that_is_late_in_both_its_messages_is_named_with_its_delay(tmp_path: Path) -> None:
    found = review(tmp_path, NOTES, {"INS_POS": 80, "INS_ATT": 80}).contradictions
    assert {one.about for one in found} == {"INS_POS", "INS_ATT"}
    for one in found:
        assert float(one.text.split()[2]) == pytest.approx(80, abs=15)


def test_a_checksum_that_the_profile_does_not_check_is_a_note_with_the_lines_to_add(tmp_path: Path) -> None:
    (found,) = [finding for finding in review(tmp_path, NOTES).findings if finding.about == "INS_ATT.CHECKSUM"]
    assert found.text == "INS_ATT.CHECKSUM fits a sum over id, length and bytes; the profile does not check it"
    assert 'over = ["id", "length", "bytes"]' in found.fix
