"""A command that does not fit its form, its limits or its signals is refused, each fault with its place."""

from pathlib import Path

import pytest

from vehicle_iface.codec.command_faults import greatest_yaw_rate_radps
from vehicle_iface.errors import ConfigError

from .vehicles import CURVATURE, DRIVE_AND_BRAKE, PEDALS, ROVER, TWIST, load_vehicle

# ruff: noqa: E501
PROFILE_FAULTS = [
    (ROVER, 'longitudinal = "speed"', "", r"\$\.command\.signals: accel_mps2 is missing; a vehicle that is commanded otherwise has \$\.command\.longitudinal = \"speed\" or \"drive_and_brake\" or \"pedals\""),
    (ROVER, 'speed_mps = "MOVE.V"', "", r'\$\.command\.signals: speed_mps is missing; \$\.command\.longitudinal = "speed" needs it'),
    (ROVER, 'front_wheel_angle_rad = "MOVE', 'accel_mps2 = "MOVE', r'signals\.accel_mps2: MOVE\.STEER: belongs to longitudinal = "acceleration", and \$\.command\.longitudinal is "speed"'),
    (ROVER, 'front_wheel_angle_rad = "MOVE', 'curvature_per_m = "MOVE', r'signals\.curvature_per_m: MOVE\.STEER: belongs to lateral = "curvature", and \$\.command\.lateral is "wheel_angle"'),
    (ROVER, '"speed"', '"torque"', r"\$\.command\.longitudinal: Invalid enum value 'torque'"),
    (ROVER, "speed_max_mps = 4.5", "speed_max_mps = 4.9", r"\$\.limits\.speed_max_mps: 4\.9: MOVE\.V is in \[-4\.8, 4\.8\]"),
    (ROVER, "[command.signals]", "[command.pedals]\nthrottle = [[0, 0], [3, 1]]\nbrake = [[0, 0], [5, 1]]\n[command.signals]", r'\$\.command\.pedals: only with longitudinal = "pedals", and it is "speed"'),
    (PEDALS, 'brake = "CMD.BRAKE"', "", r'\$\.command\.signals: brake is missing; \$\.command\.longitudinal = "pedals" needs it'),
    (PEDALS, "[2.0, 40.0]]", "[1.9, 40.0]]", r"\$\.limits\.accel_max_mps2: 2\.0: \$\.command\.pedals\.throttle ends at 1\.9 m/s²"),
    (PEDALS, "[4.0, 60.0]]", "[3.0, 60.0]]", r"\$\.limits\.accel_min_mps2: -3\.5: \$\.command\.pedals\.brake ends at 3\.0 m/s²"),
    (PEDALS, "[2.0, 40.0]]", "[2.0, 140.0]]", r"\$\.command\.pedals\.throttle\[2\]\[1\]: 140\.0: CMD\.THROTTLE is in \[0, 100\], in its own unit %"),
    (PEDALS, "[1.0, 15.0]", "[2.0, 15.0]", r"\$\.command\.pedals\.throttle\[2\]\[0\]: 2\.0: must be above the row before it, 2\.0"),
    (PEDALS, "[1.0, 15.0]", "[1.0, 45.0]", r"\$\.command\.pedals\.throttle\[2\]\[1\]: 40\.0: must be above the row before it, 45\.0"),
    (PEDALS, "brake = [[0.0, 0.0]", "brake = [[0.1, 0.0]", r"\$\.command\.pedals\.brake\[0\]\[0\]: 0\.1: the first row must be for an acceleration of 0"),
    (PEDALS, "[4.0, 60.0]]", "[4.0, 0.05]]", r"\$\.command\.pedals\.brake: 0\.04375 at 3\.5 m/s² is less than one count of CMD\.BRAKE \(0\.1\)"),
    (PEDALS, "[4.0, 60.0]]", "[4.0, 60.0]]\nfeedback = { kp = 0.1 }", r"\$\.command\.pedals\.feedback: \$\.state\.signals\.accel_mps2 is missing"),
    (PEDALS, "[command.pedals]", "[command.pedal]", r"\$\.command\.pedal: unknown key; did you mean 'pedals'\?"),
    (DRIVE_AND_BRAKE, "accel_max_mps2 = 2.0", "accel_max_mps2 = 12.0", r"\$\.limits\.accel_max_mps2: 12\.0: CMD\.DRIVE is in \[0, 10\]"),
    (DRIVE_AND_BRAKE, "accel_min_mps2 = -3.5", "accel_min_mps2 = -12.0", r"\$\.limits\.accel_min_mps2: -12\.0: CMD\.DECEL is in \[0, 10\]"),
    (DRIVE_AND_BRAKE, "accel_rate_mps3 = 30.0", "accel_rate_mps3 = 0.4", r"\$\.limits\.accel_rate_mps3: 0\.4: drive_mps2 may change by 0\.008 in 0\.02 s, less than one count of CMD\.DRIVE \(0\.01\)"),
    (CURVATURE, 'gear = "STATUS.GEAR"', "", r'\$\.status\.signals: gear is missing; longitudinal = "drive_and_brake" with a gear_request needs the gear that is in'),
]  # fmt: skip

DBC_FAULTS = [
    (ROVER, "(0.001,0) [-4.8|4.8]", "(1.5,0) [-4.8|4.8]", r"\$\.limits\.accel_max_mps2: 2\.0: the speed may be 1 m/s ahead, less than one count of MOVE\.V \(1\.5\)"),
    (PEDALS, '[0|100] "%" CAR\n SG_ BRAKE', '[2|100] "%" CAR\n SG_ BRAKE', r"\$\.command\.pedals\.throttle: released it is 0: CMD\.THROTTLE is in \[2, 100\]"),
    (CURVATURE, "[-0.3|0.3]", "[-0.2|0.2]", r"\$\.limits\.front_wheel_angle_rad: 0\.5: curvature_per_m may be ±0\.2023 1/m, but CMD\.BEND is in \[-0\.2, 0\.2\]"),
    (CURVATURE, "(0.00002,0) [-0.3|0.3]", "(0.25,0) [-0.3|0.3]", r"curvature_per_m may be ±0\.2023 1/m, less than one count of CMD\.BEND \(0\.25\)"),
    (CURVATURE, '"1/m"', '"rad"', r"CMD\.BEND: unit 'rad' is of angle: curvature_per_m must be in '1/m'"),
    (TWIST, "[-2|2]", "[-0.7|0.7]", r"\$\.limits\.front_wheel_angle_rad: 0\.5: yaw_rate_radps may be ±0\.77\d* rad/s, but CMD\.TURN is in \[-0\.7, 0\.7\]"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "old", "new", "text"), PROFILE_FAULTS, ids=[text for *_, text in PROFILE_FAULTS])
def test_a_profile_that_does_not_fit_its_form_is_refused(
    tmp_path: Path, kind: tuple[str, str], old: str, new: str, text: str
) -> None:
    with pytest.raises(ConfigError, match=text):
        load_vehicle(tmp_path, kind, ((old, new),))


@pytest.mark.parametrize(("kind", "old", "new", "text"), DBC_FAULTS, ids=[text for *_, text in DBC_FAULTS])
def test_a_dbc_that_cannot_carry_what_the_limits_allow_is_refused(
    tmp_path: Path, kind: tuple[str, str], old: str, new: str, text: str
) -> None:
    with pytest.raises(ConfigError, match=text):
        load_vehicle(tmp_path, kind, dbc=((old, new),))


def test_a_pedal_without_a_table_is_one_fault(tmp_path: Path) -> None:
    command, end = PEDALS
    kind = command, end[: end.index("[command.pedals]")]
    with pytest.raises(ConfigError) as refused:
        load_vehicle(tmp_path, kind)
    text = '$.command: pedals is missing; $.command.longitudinal = "pedals" needs its tables throttle and brake'
    assert str(refused.value).splitlines() == [f"v.toml: {text}"]


def test_the_greatest_yaw_rate_is_that_of_the_sharpest_bend_at_any_speed(tmp_path: Path) -> None:
    limits = (("speed_max_mps = 4.5", "speed_max_mps = 4.99"), ("lateral_accel_mps2 = 3.0", "lateral_accel_mps2 = 2.0"))
    profile = load_vehicle(tmp_path, TWIST, limits).profile
    curvature_per_m = 0.5463024898437905 / 2.7  # tan(0.5) / wheelbase
    assert greatest_yaw_rate_radps(profile) == pytest.approx((2.0 * curvature_per_m) ** 0.5, rel=0.01)


def test_a_pedal_in_newton_metres_or_as_a_ratio_keeps_its_unit(tmp_path: Path) -> None:
    dbc = (('(0.1,0) [0|100] "%" CAR\n SG_ BRAKE', '(0.001,0) [0|1] "ratio" CAR\n SG_ BRAKE'), ('"%"', '"Nm"'))
    table = (("[1.0, 15.0], [2.0, 40.0]", "[2.0, 0.4]"),)
    ranges = load_vehicle(tmp_path, PEDALS, table, dbc).command_ranges
    assert ranges["throttle"] == (0.0, 1.0, 0.001)
    assert ranges["brake"] == (0.0, 100.0, 0.1)
