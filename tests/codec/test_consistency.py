"""A DBC and a profile that do not fit one another are refused before the first frame, with all their faults."""

import pytest

from vehicle_iface.errors import ConfigError

from .conftest import Variant, line_of

# ruff: noqa: E501
PROFILE_FAULTS = [
    ("POSE.POS_X", "POSE.POSX", r"\$\.state\.signals\.x_m: no signal 'POSX' in POSE; nearest: POS_X"),
    ("MOTION.SPEED", "MOTON.SPEED", r"\$\.state\.signals\.speed_mps: no message 'MOTON' in .*; nearest: MOTION"),
    ('"MOTION.SPEED"', '"MOTION.HEADING"', r"speed_mps: MOTION\.HEADING is already bound to heading_rad"),
    ("ignored = []", 'ignored = ["POSE.POS_X"]', r"\$\.ignored: POSE\.POS_X is bound to x_m"),
    ("ignored = []", 'ignored = ["POSE.NONE"]', r"\$\.ignored: no signal 'NONE' in POSE"),
    ("constants = {}", 'constants = {"NONE.X" = 1}', r"\$\.constants: no message 'NONE'"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = 1.2", r"\$\.limits\.front_wheel_angle_rad: 1\.2: STEER"),
    ("accel_max_mps2 = 3.0", "accel_max_mps2 = 30.0", r"\$\.limits\.accel_max_mps2: 30\.0: .*\[-20, 20\]"),
    ("accel_min_mps2 = -6.0", "accel_min_mps2 = -60.0", r"\$\.limits\.accel_min_mps2: -60"),
    ("speed_max_mps = 20.0", "speed_max_mps = 200.0", r"\$\.limits\.speed_max_mps: 200"),
    ("accel_rate_mps3 = 30.0", "accel_rate_mps3 = 0.09", r"\$\.limits\.accel_rate_mps3: 0\.09: accel_mps2 may change by 0\.0009 in 0\.01 s, less than one count of DRIVE_COMMAND\.ACCEL_REQUEST \(0\.001\)"),
    ("front_wheel_rate_radps = 0.8", "front_wheel_rate_radps = 0.009", r"\$\.limits\.front_wheel_rate_radps: 0\.009: front_wheel_angle_rad may change by 9e-05"),
    ("rear_wheel_angle_rad = 0.0", "rear_wheel_angle_rad = 0.1", r"\$\.limits\.rear_wheel_rate_radps: 0\.0: rear_wheel_angle_rad may change by 0 in"),
    ("sample_period_s = 0.01", "sample_period_s = 0.005", r"\$\.timing\.sample_period_s: 0\.005 s, but POSE has a cycle of 10"),
    ("command_period_s = 0.01", "command_period_s = 0.1", r"\$\.timing\.command_period_s"),
    ("body_period_s = 0.1", "body_period_s = 0.2", r"\$\.timing\.body_period_s"),
    ("report_period_s = 0.1", "report_period_s = 0.2", r"\$\.timing\.report_period_s"),
    ("status_period_s = 0.02", "status_period_s = 0.01", r"\$\.timing\.status_period_s"),
    ("POSE = 0x110", "POSE = 0x111", r"\$\.e2e\.data_ids\.POSE: 0x111, but E2EDataId is 0x110"),
    ("POSE = 0x110", "POOSE = 0x110", r"\$\.e2e\.data_ids\.POOSE: no message"),
    ("POSE = 0x110\n", "", r"\$\.e2e\.data_ids\.POSE: missing; the other parts of the sample have"),
    ("[state.signals]", 'trigger = "POSES"\n[state.signals]', r"\$\.state\.trigger: 'POSES': must be one of: POSE, MOTION, CHASSIS"),
    ("[state.signals]", 'assemble = "counter"\nmax_age_s = 0.1\n[state.signals]', r"\$\.state\.max_age_s: has an effect only with"),
    ("[state.signals]", "max_age_s = { POES = 0.1 }\n[state.signals]", r"\$\.state\.max_age_s\.POES: must be one of"),
    ("[status.modes]", '[status.modes]\nRAEDY = "MANUAL"', r"\$\.status\.modes\.RAEDY: not in VEHICLE_STATUS\.MODE; nearest: READY"),
    ("[status.modes]", '[status.modes]\nMANUAL = "HAND"', r"\$\.status\.modes\.MANUAL: 'HAND': must be one of: MANUAL"),
    ("[status.modes]", '[status.modes]\nREADY = "MANUAL"', r"MODE: VAL_ table without READY; \[status\.modes\] may"),
    ("constants = {}", "[messages.POES]\ncycle_ms = 10", r"\$\.messages\.POES: no message 'POES'"),
    ("constants = {}", '[messages.POSE]\nsender = "controller"', r"\$\.messages\.POSE\.sender: 'controller', but the profile uses POSE"),
    ("constants = {}", "[messages.POSE]\ncycle_ms = 20", r"\$\.timing\.sample_period_s: 0\.01 s, but POSE has a cycle of 20 ms below \[messages\.POSE\]"),
    ("constants = {}", '[signals."POSE.POSX"]\nscale = 2', r"\$\.signals\.POSE\.POSX: no signal 'POSX'"),
    ("constants = {}", '[signals."MOTION.SPEED"]\nunit = "deg"', r"MOTION\.SPEED: unit 'deg' is of angle: speed_mps must be in 'm/s'"),
    ("constants = {}", '[signals."MOTION.SPEED"]\nunit = "furlong"', r"MOTION\.SPEED: unit 'furlong' is not known"),
    ("constants = {}", '[signals."MOTION.SPEED"]\nunit = ""', r"MOTION\.SPEED: has no unit, and speed_mps is in 'm/s'"),
    ('crc_signal = "CRC"', 'crc_signal = "CHECK"', r"\$\.e2e\.crc_signal: no signal 'CHECK'"),
    ("profile = 1 ", "profile = 5 ", r"CRC: bits 0\|8, but E2E profile 5 has 0\|16"),
    ("profile = 1 ", "profile = 2 ", r"profile 2 needs a list of 16 bytes"),
    ("max_counter_step = 3", "max_counter_step = 14", r"\$\.e2e\.max_counter_step: 14: must be at most 13"),
    ('data_id_mode = "BOTH"', 'data_id_mode = "NIBBLE"', r"bits 12\|4 hold the data id's nibble"),
    ('ODOM = "odom"', 'ODO = "odom"', r"\$\.state\.frames\.ODO: not in POSE\.POSE_FRAME; nearest: ODOM"),
    ('ODOM = "odom"', "", r"\$\.state\.frames: POSE\.POSE_FRAME = 0 'ODOM' has no frame"),
    ('"POSE", "MOTION", "CHASSIS"]', '"POSE", "POSE"]', r"\$\.state\.sample\[1\]: POSE is listed twice"),
    ('"CHASSIS"]', '"CHASSIS", "STEER_COMMAND"]', r"STEER_COMMAND is a message of sample, too"),
    ('"POSE", "MOTION", "CHASSIS"]', '"POSE", "CHASSIS"]', r"\$\.state\.signals\.heading_rad: MOTION\.HEADING: must be in a message of the sample: POSE, CHASSIS"),
    ('"POSE", "MOTION", "CHASSIS"]', '"MOTION", "CHASSIS"]', r"\$\.state\.signals\.x_m: POSE\.POS_X: must be in"),
    ('MAP = "map"', 'MAP = ""', r"\$\.state\.frames\.MAP: frame of reference = '': must be the name"),
    ('MAP = "map"', f'MAP = "{"m" * 65}"', r"\$\.state\.frames\.MAP: .* must be at most 64 bytes"),
    ("[state.signals]", 'frame_id = ""\n[state.signals]', r"\$\.state\.frame_id: .* must be the name"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "text"), PROFILE_FAULTS, ids=[text for *_, text in PROFILE_FAULTS])
def test_a_profile_that_does_not_fit_is_refused(variant: Variant, old: str, new: str, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        variant(toml=((old, new),))


@pytest.mark.parametrize(
    ("old", "new"),
    [("accel_rate_mps3 = 30.0", "accel_rate_mps3 = 0.1"), ("wheel_rate_radps = 0.8", "wheel_rate_radps = 0.01")],
)
def test_one_count_from_sample_to_sample_is_enough(variant: Variant, old: str, new: str) -> None:
    assert variant(toml=((old, new),)).resolutions["accel_mps2"] == 0.001


def test_all_faults_of_a_profile_are_reported_at_once(variant: Variant) -> None:
    edits = (("POSE.POS_X", "POSE.POSX"), ("speed_max_mps = 20.0", "speed_max_mps = 200.0"))
    with pytest.raises(ConfigError) as refused:
        variant(toml=edits)
    assert str(refused.value).splitlines() == [
        "reference.toml: $.state.signals.x_m: no signal 'POSX' in POSE; nearest: POS_X, POS_Y, POSE_VALID",
        "reference.toml: $.limits.speed_max_mps: 200.0: DRIVE_COMMAND.SPEED_REQUEST is in [-100, 100]",
    ]


DBC_FAULTS = [
    ("BO_ 273 MOTION", "BO_ 272 MOTION", r"reference\.dbc:\d+: MOTION: id 272 is already in line"),
    ("BO_ 273 MOTION", "BO_ 273 POSE", r"reference\.dbc:\d+: POSE: is already in line"),
    ("SG_ SPEED ", "SG_ HEADING ", r"reference\.dbc:\d+: MOTION\.HEADING: is already in line"),
    ("SPEED : 32|16", "SPEED : 31|16", r"reference\.dbc:\d+: .*overlapping"),
    ("YAW_RATE : 48|16", "YAW_RATE : 56|16", r"reference\.dbc:\d+: .*do not fit"),
    ("YAW_RATE : 48|16@1- (0.0002,0)", "YAW_RATE : 48|16@1- (0,0)", r"MOTION\.YAW_RATE: factor 0"),
    ("[-6.5536|6.5534]", "[6.5|-6.5]", r"MOTION\.YAW_RATE: range .* swapped ends"),
    ("[-6.5536|6.5534]", "[7|8]", r"MOTION\.YAW_RATE: no value lies in its range"),
    ("BO_ 273 MOTION: 8 VEHICLE", "BO_ 273 MOTION: 8 CONTROLLER", r"MOTION: is received, but its sender CONTROLLER"),
    ("BO_ 273 MOTION", "BO_ 273 MOTOIN", r"no message 'MOTION' in reference\.dbc; nearest: MOTOIN"),
    ('1 "READY" ', "", r"VEHICLE_STATUS\.MODE: VAL_ table without READY"),
    (' 17 "NOT_ENGAGED"', "", r"REASON: VAL_ table without NOT_ENGAGED"),
    (' 7 "NO_REQUEST"', "", r"GEAR_REQUEST: VAL_ table without NO_REQUEST; .* no gear_request: \[command\.values\]"),
    ("GEAR_REQUEST : 56|3@1+ (1,0) [0|7]", "GEAR_REQUEST : 56|3@1+ (1,0) [0|4]",
     r"GEAR_REQUEST: 7 means NO_REQUEST, and the range is \[0, 4\]"),
    ("VAL_ 256 MODE", "VAL_ 256 MOED", r"reference\.dbc"),
    ("VAL_ 384 STATE", 'VAL_ 384 DEADLINE_MISSES 0 "NONE" 1 "ONE" ;\nVAL_ 384 STATE', r"MISSES: is a count, but .* only 2 of"),
    ("CRC : 0|8@1+ (1,0) [0|255]", "CRC : 4|4@1+ (1,0) [0|15]", r"CRC: bits 4\|4, but E2E profile 1 has 0\|8"),
    ('SG_ POS_Y : 40|24@1- (0.005,0)', 'SG_ POS_Y : 40|24@1- 0.005,0)', rf"reference\.dbc:{line_of('SG_ POS_Y')}: "),
    (' SG_ HEADING : 16|16@1-', ' SG_ HEADING m3 : 16|16@1-', r"MOTION\.HEADING: is multiplexed, but MOTION has no multiplexer"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "text"), DBC_FAULTS, ids=[new or old for old, new, _ in DBC_FAULTS])
def test_a_dbc_that_is_not_sound_is_refused(variant: Variant, old: str, new: str, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        variant(dbc=((old, new),))


def test_a_message_outside_the_sample_that_comes_too_seldom_to_be_fresh_is_refused(variant: Variant) -> None:
    rest = ("BO_ 384 CONTROLLER_STATUS", 'BO_ 259 REAR: 8 VEHICLE\n SG_ FAULT : 16|8@1+ (1,0) [0|255] "" CONTROLLER\n\n'
            'BO_ 384 CONTROLLER_STATUS')  # fmt: skip
    toml = (("VEHICLE_STATUS.FAULT_CODE", "REAR.FAULT"), ("ignored = []", 'ignored = ["VEHICLE_STATUS.FAULT_CODE"]'))
    for cycle_ms, fits in ((99, True), (100, False)):
        cycle = (
            'BA_ "GenMsgCycleTime" BO_ 384',
            f'BA_ "GenMsgCycleTime" BO_ 259 {cycle_ms};\nBA_ "GenMsgCycleTime" BO_ 384',
        )
        if fits:
            assert [message.name for message in variant(toml=toml, dbc=(rest, cycle)).auxiliary] == ["REAR"]
        else:
            with pytest.raises(ConfigError, match=r"\$\.timing\.status_stale_s: 0\.1 s: must be above .* REAR, 100 ms"):
                variant(toml=toml, dbc=(rest, cycle))
