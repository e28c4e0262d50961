"""A DBC and a profile that do not fit one another, or a DBC that is not whole, are refused before the first frame."""

import math
import re

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codec.conftest import DBC_FOLDER
from vehicle_iface.codec.database import Role, load_database
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile
from vehicle_iface.state import VehicleState

TEXT = (DBC_FOLDER / "reference.dbc").read_text(encoding="utf-8")


def line_of(text):
    """The line of the reference DBC in which a text first stands."""
    return TEXT[: TEXT.index(text)].count("\n") + 1


def test_the_reference_vehicle_is_bound(database):
    assert [message.name for message in database.sample] == ["POSE", "MOTION", "CHASSIS"]
    assert database.status.name == "VEHICLE_STATUS"
    assert database.extra == ()
    assert [message.name for message in database.commands] == ["DRIVE_COMMAND", "STEER_COMMAND"]
    assert (database.body.name, database.report.name) == ("BODY_COMMAND", "CONTROLLER_STATUS")
    assert [message.role for message in database.sent] == [Role.COMMAND, Role.COMMAND, Role.BODY, Role.REPORT]
    assert database.frames == {0: "odom", 1: "map"}


def test_every_number_of_the_state_has_a_signal(database):
    bound = {field for message in database.received for field in message.fields}
    wanted = set(VehicleState.__dataclass_fields__) - {"stamp_ns", "frame_id"}
    assert wanted | {"pose_frame", "pose_valid"} <= bound


def test_fields_stand_at_their_values(database):
    motion = database.sample[1]
    assert motion.codec.names == ("CRC", "COUNTER", "HEADING", "SPEED", "YAW_RATE")
    assert motion.fields == ("", "", "heading_rad", "speed_mps", "yaw_rate_radps")


def test_the_resolution_is_the_commands_step_on_the_wire(database):
    assert database.resolutions["accel_mps2"] == 0.001
    assert database.resolutions["front_wheel_angle_rad"] == 0.0001
    assert database.resolutions["enable"] == 1
    assert "torque_nm" not in database.resolutions


# ruff: noqa: E501
PROFILE_FAULTS = [
    ("POSE.POS_X", "POSE.POSX", r"\$\.state\.signals\.x_m: no signal 'POSX' in POSE; nearest: POS_X"),
    ("MOTION.SPEED", "MOTON.SPEED", r"\$\.state\.signals\.speed_mps: no message 'MOTON' in .*; nearest: MOTION"),
    ('"MOTION.SPEED"', '"MOTION.HEADING"', r"speed_mps: MOTION\.HEADING is already bound to heading_rad"),
    ('gear = "VEHICLE_STATUS.GEAR"', "", r"reference\.dbc:\d+: VEHICLE_STATUS\.GEAR: means nothing to"),
    ('horn = "BODY_COMMAND.HORN"', "", r"BODY_COMMAND\.HORN: means nothing .* under constants"),
    ("ignored = []", 'ignored = ["POSE.POS_X"]', r"\$\.ignored: POSE\.POS_X is bound to x_m"),
    ("ignored = []", 'ignored = ["POSE.NONE"]', r"\$\.ignored: no signal 'NONE' in POSE"),
    ("constants = {}", 'constants = {"NONE.X" = 1}', r"\$\.constants: no message 'NONE'"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = 1.2", r"\$\.limits\.front_wheel_angle_rad: 1\.2: STEER"),
    ("accel_max_mps2 = 3.0", "accel_max_mps2 = 30.0", r"\$\.limits\.accel_max_mps2: 30\.0: .*\[-20, 20\]"),
    ("accel_min_mps2 = -6.0", "accel_min_mps2 = -60.0", r"\$\.limits\.accel_min_mps2: -60"),
    ("speed_max_mps = 20.0", "speed_max_mps = 200.0", r"\$\.limits\.speed_max_mps: 200"),
    ("accel_rate_mps3 = 30.0", "accel_rate_mps3 = 0.09", r"\$\.limits\.accel_rate_mps3: 0\.09: moves accel_mps2 by 0\.0009 in 0\.01 s, and a count of DRIVE_COMMAND\.ACCEL_REQUEST is 0\.001"),
    ("front_wheel_rate_radps = 0.8", "front_wheel_rate_radps = 0.009", r"\$\.limits\.front_wheel_rate_radps: 0\.009: moves front_wheel_angle_rad by 9e-05"),
    ("rear_wheel_angle_rad = 0.0", "rear_wheel_angle_rad = 0.1", r"\$\.limits\.rear_wheel_rate_radps: 0\.0: moves rear_wheel_angle_rad by 0 in"),
    ("sample_period_s = 0.01", "sample_period_s = 0.02", r"\$\.timing\.sample_period_s: 0\.02 s, but POSE has a cycle of 10"),
    ("command_period_s = 0.01", "command_period_s = 0.1", r"\$\.timing\.command_period_s"),
    ("body_period_s = 0.1", "body_period_s = 0.2", r"\$\.timing\.body_period_s"),
    ("report_period_s = 0.1", "report_period_s = 0.2", r"\$\.timing\.report_period_s"),
    ("status_period_s = 0.02", "status_period_s = 0.01", r"\$\.timing\.status_period_s"),
    ("POSE = 0x110", "POSE = 0x111", r"\$\.e2e\.data_ids\.POSE: 0x111, but E2EDataId is 0x110"),
    ("POSE = 0x110", "POOSE = 0x110", r"\$\.e2e\.data_ids\.POOSE: no message"),
    ("POSE = 0x110\n", "", r"\$\.e2e\.data_ids\.POSE: missing; the parts of a sample"),
    ("STEER_COMMAND = 0x081\n", "", r"STEER_COMMAND\.CRC: means nothing"),
    ('crc_signal = "CRC"', 'crc_signal = "CHECK"', r"\$\.e2e\.crc_signal: no signal 'CHECK'"),
    ("profile = 1 ", "profile = 5 ", r"CRC: bits 0\|8, but E2E profile 5 has 0\|16"),
    ("profile = 1 ", "profile = 2 ", r"profile 2 needs a list of 16 bytes"),
    ("max_counter_step = 3", "max_counter_step = 14", r"\$\.e2e\.max_counter_step: 14: must be at most 13"),
    ('data_id_mode = "BOTH"', 'data_id_mode = "NIBBLE"', r"bits 12\|4 hold the data id's nibble"),
    ('ODOM = "odom"', 'ODO = "odom"', r"\$\.state\.frames\.ODO: not in POSE\.POSE_FRAME; nearest: ODOM"),
    ('ODOM = "odom"', "", r"\$\.state\.frames: POSE\.POSE_FRAME = 0 'ODOM' has no frame"),
    ('"POSE", "MOTION", "CHASSIS"]', '"POSE", "POSE"]', r"\$\.state\.sample\[1\]: POSE is there twice"),
    ('"CHASSIS"]', '"CHASSIS", "VEHICLE_STATUS"]', r"\$\.status\.signals\.mode: VEHICLE_STATUS is a part of"),
    ('"CHASSIS"]', '"CHASSIS", "STEER_COMMAND"]', r"STEER_COMMAND is already a message of sample"),
    ('"POSE", "MOTION", "CHASSIS"]', '"POSE", "CHASSIS"]', r"\$\.state\.signals\.heading_rad: MOTION\.HEADING: must be in a message of the sample: POSE, CHASSIS"),
    ('"POSE", "MOTION", "CHASSIS"]', '"MOTION", "CHASSIS"]', r"\$\.state\.signals\.x_m: POSE\.POS_X: must be in"),
    ('MAP = "map"', 'MAP = ""', r"\$\.state\.frames\.MAP: frame of reference = '': must be the name"),
    ('MAP = "map"', f'MAP = "{"m" * 65}"', r"\$\.state\.frames\.MAP: .* must be at most 64 bytes"),
    ("[state.signals]", 'frame_id = ""\n[state.signals]', r"\$\.state\.frame_id: .* must be the name"),
    ("[status.modes]", '[status.modes]\nREADY = "MANUAL"', r"1 'READY': MANUAL has two numbers"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "text"), PROFILE_FAULTS, ids=[text for *_, text in PROFILE_FAULTS])
def test_a_profile_that_does_not_fit_is_refused(variant, old, new, text):
    with pytest.raises(ConfigError, match=text):
        variant(toml=((old, new),))


@pytest.mark.parametrize(
    ("old", "new"),
    [("accel_rate_mps3 = 30.0", "accel_rate_mps3 = 0.1"), ("wheel_rate_radps = 0.8", "wheel_rate_radps = 0.01")],
)
def test_one_count_from_sample_to_sample_is_enough(variant, old, new):
    assert variant(toml=((old, new),)).resolutions["accel_mps2"] == 0.001


DBC_FAULTS = [
    ("BO_ 273 MOTION", "BO_ 272 MOTION", r"reference\.dbc:\d+: message MOTION: id 272 is already in line"),
    ("BO_ 273 MOTION", "BO_ 273 POSE", r"reference\.dbc:\d+: message POSE is already in line"),
    ("SG_ SPEED ", "SG_ HEADING ", r"reference\.dbc:\d+: signal MOTION\.HEADING is already in line"),
    ("SPEED : 32|16", "SPEED : 31|16", r"reference\.dbc:\d+: .*overlapping"),
    ("YAW_RATE : 48|16", "YAW_RATE : 56|16", r"reference\.dbc:\d+: .*does not fit"),
    ("YAW_RATE : 48|16@1- (0.0002,0)", "YAW_RATE : 48|16@1- (0,0)", r"MOTION\.YAW_RATE: factor 0"),
    ("[-6.5536|6.5534]", "[0|0]", r"MOTION\.YAW_RATE: no range"),
    ("[-6.5536|6.5534]", "[6.5|-6.5]", r"MOTION\.YAW_RATE: range .* upside down"),
    ("[-6.5536|6.5534]", "[7|8]", r"MOTION\.YAW_RATE: no value lies in its range"),
    ("BO_ 273 MOTION: 8 VEHICLE", "BO_ 273 MOTION: 8 CONTROLLER", r"MOTION: is received, but its sender CONTROLLER"),
    ("BO_ 273 MOTION", "BO_ 273 MOTOIN", r"no message 'MOTION' in reference\.dbc; nearest: MOTOIN"),
    ('1 "READY" ', "", r"VEHICLE_STATUS\.MODE: VAL_ table without READY"),
    ('4 "EMERGENCY_STOP"', '4 "PANIC"', r"4 'PANIC' means nothing; must be one of: MANUAL"),
    (' 17 "NOT_ENGAGED"', "", r"REASON: VAL_ table without NOT_ENGAGED"),
    ("VAL_ 256 MODE", "VAL_ 256 MOED", r"reference\.dbc"),
    ("VAL_ 384 STATE", 'VAL_ 384 DEADLINE_MISSES 255 "OR_MORE" ;\nVAL_ 384 STATE', r"MISSES: is a count, but .* only 1 of"),
    ("CRC : 0|8@1+ (1,0) [0|255]", "CRC : 4|4@1+ (1,0) [0|15]", r"CRC: bits 4\|4, but E2E profile 1 has 0\|8"),
    ('SG_ POS_Y : 40|24@1- (0.005,0)', 'SG_ POS_Y : 40|24@1- 0.005,0)', rf"reference\.dbc:{line_of('SG_ POS_Y')}: "),
    (' SG_ HEADING : 16|16@1-', ' SG_ HEADING m3 : 16|16@1-', r"MOTION\.HEADING is multiplexed, but MOTION has no multiplexer"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "text"), DBC_FAULTS, ids=[new or old for old, new, _ in DBC_FAULTS])
def test_a_dbc_that_is_not_sound_is_refused(variant, old, new, text):
    with pytest.raises(ConfigError, match=text):
        variant(dbc=((old, new),))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(TEXT.rstrip()) - 1))
def test_a_dbc_cut_short_anywhere_is_refused(tmp_path_factory, end):
    folder = tmp_path_factory.mktemp("cut")
    (folder / "reference.toml").write_text((DBC_FOLDER / "reference.toml").read_text(encoding="utf-8"))
    for ending in ("", "\n"):
        (folder / "reference.dbc").write_text(TEXT[:end] + ending)
        with pytest.raises(ConfigError, match=r"^reference\.(dbc|toml):"):
            load_database(load_profile(folder / "reference.toml"))


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", r"bad\.dbc:1: the file is empty"),
        (b"\n\n", "the file is empty"),
        (TEXT.encode("utf-16"), "NUL byte"),
        (b'VERSION ""\n\x81\n', r"bad\.dbc:2: byte 0x81"),
        (b"\x89PNG\r\n\x1a\n" + bytes(8), "NUL byte"),
        (b"PK nonsense\n", r"bad\.dbc"),
        (b'VERSION "\n', "inside a string"),
        (b'VERSION ""\n', "no message in it"),
        (TEXT.encode()[:3000], "middle of a line"),
    ],
)
def test_a_file_that_is_not_a_dbc_is_refused(tmp_path, data, text):
    path = tmp_path / "bad.dbc"
    path.write_bytes(data)
    with pytest.raises(ConfigError, match=text):
        read_dbc(path)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200) | st.text(alphabet='BO_SG:|@+-()[]" \n0123456789M', max_size=200).map(str.encode))
def test_garbage_raises_nothing_but_our_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("garbage") / "bad.dbc"
    path.write_bytes(data)
    with pytest.raises(ConfigError):
        read_dbc(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.dbc: cannot be read: No such file"):
        read_dbc(tmp_path / "none.dbc")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_units_are_read_in_both_encodings(tmp_path, encoding):
    path = tmp_path / "units.dbc"
    path.write_bytes(TEXT.replace('"m/s^2"', '"m/s²"').encode(encoding))
    message = read_dbc(path).database.get_message_by_name("CHASSIS")
    assert message.get_signal_by_name("ACCEL").unit == "m/s²"


def test_words_of_the_grammar_inside_a_comment_are_text(tmp_path):
    path = tmp_path / "comment.dbc"
    comment = 'CM_ BO_ 273 "first\nBO_ 273 MOTION: 8 VEHICLE\n SG_ X : said \\"so\\"";\n'
    path.write_text(TEXT.replace("CM_ BO_ 273 ", comment + "CM_ BO_ 274 ", 1))
    assert "first" in read_dbc(path).database.get_message_by_name("MOTION").comment


def test_lines_are_those_of_an_editor():
    file = read_dbc(DBC_FOLDER / "reference.dbc")
    for dotted, line in file.lines.items():
        name = dotted.rpartition(".")[2]
        assert re.search(rf"\b{name}\b", TEXT.splitlines()[line - 1])


def test_a_vehicle_without_optional_parts_is_bound(variant):
    database = variant(
        toml=(
            ('rear_wheel_angle_rad = "STEER_COMMAND.REAR_WHEEL_ANGLE_REQUEST"\n', ""),
            ('lateral_speed_mps = "CHASSIS.LATERAL_SPEED"\n', ""),
            ('fault_code = "VEHICLE_STATUS.FAULT_CODE"\n', ""),
            ("ignored = []", 'ignored = ["CHASSIS.LATERAL_SPEED", "VEHICLE_STATUS.FAULT_CODE"]'),
            ("constants = {}", 'constants = {"STEER_COMMAND.REAR_WHEEL_ANGLE_REQUEST" = 0.0}'),
            ('name = "reference"', 'name = "small"'),
        )
    )
    assert "rear_wheel_angle_rad" not in database.resolutions
    assert database.profile.name == "small"


def test_state_fields_may_come_from_a_message_of_their_own(variant):
    database = variant(
        dbc=(
            ("BO_ 384 CONTROLLER_STATUS", 'BO_ 259 REAR: 8 VEHICLE\n SG_ CRC : 0|8@1+ (1,0) [0|255] "" CONTROLLER\n'
             ' SG_ COUNTER : 8|4@1+ (1,0) [0|14] "" CONTROLLER\n'
             ' SG_ ANGLE : 16|16@1- (0.0001,0) [-1|1] "rad" CONTROLLER\n\nBO_ 384 CONTROLLER_STATUS'),
        ),
        toml=(
            ("VEHICLE_STATUS.REAR_WHEEL_ANGLE", "REAR.ANGLE"),
            ("ignored = []", 'ignored = ["VEHICLE_STATUS.REAR_WHEEL_ANGLE"]'),
            ("CHASSIS = 0x112", "CHASSIS = 0x112\nREAR = 0x103"),
        ),
    )  # fmt: skip
    assert [message.name for message in database.extra] == ["REAR"]
    assert database.extra[0].fields == ("", "", "rear_wheel_angle_rad")


def test_a_message_outside_the_sample_that_comes_too_seldom_to_be_fresh_is_refused(variant):
    rest = ("BO_ 384 CONTROLLER_STATUS", 'BO_ 259 REAR: 8 VEHICLE\n SG_ FAULT : 16|8@1+ (1,0) [0|255] "" CONTROLLER\n\n'
            'BO_ 384 CONTROLLER_STATUS')  # fmt: skip
    toml = (("VEHICLE_STATUS.FAULT_CODE", "REAR.FAULT"), ("ignored = []", 'ignored = ["VEHICLE_STATUS.FAULT_CODE"]'))
    for cycle_ms, fits in ((99, True), (100, False)):
        cycle = (
            'BA_ "GenMsgCycleTime" BO_ 384',
            f'BA_ "GenMsgCycleTime" BO_ 259 {cycle_ms};\nBA_ "GenMsgCycleTime" BO_ 384',
        )
        if fits:
            assert [message.name for message in variant(toml=toml, dbc=(rest, cycle)).extra] == ["REAR"]
        else:
            with pytest.raises(ConfigError, match=r"\$\.timing\.status_stale_s: 0\.1 s: must be above .* REAR, 100 ms"):
                variant(toml=toml, dbc=(rest, cycle))


def test_the_limits_are_finite_and_within_what_the_wire_can_say(database):
    limits = database.profile.limits
    numbers = [number for number in msgspec.structs.astuple(limits) if isinstance(number, float)]
    assert len(numbers) >= 13
    assert all(map(math.isfinite, numbers))
