"""Everything that is wrong with a profile or a DBC is found at once, each with its line; the shipped ones are clean."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from vehicle_iface import cli
from vehicle_iface.codec.dbc_findings import ERROR, WARNING
from vehicle_iface.codec.lint import LintFinding, check_file
from vehicle_iface.errors import ConfigError

from .conftest import DBC_FOLDER

SHIPPED = ("reference.dbc", "reference.toml", "reference_fd.dbc", "reference_fd.toml")


Copy = Callable[..., Path]
"""The file to look at, and edits: file, old text, new text."""


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    """A copy of the reference vehicle's files with texts replaced; the path of one of them."""

    def write(name: str, *edits: tuple[str, str, str]) -> Path:
        for file in SHIPPED:
            text = (DBC_FOLDER / file).read_text(encoding="utf-8")
            for which, old, new in edits:
                if which == file:
                    assert old in text, f"{old!r} is not in {file}"
                    text = text.replace(old, new, 1)
            (tmp_path / file).write_text(text, encoding="utf-8")
        return tmp_path / name

    return write


def line_of(path: Path, text: str) -> int:
    """The line of a file in which a text first stands."""
    content = path.read_text(encoding="utf-8")
    return content[: content.index(text)].count("\n") + 1


def found_in(findings: list[LintFinding], text: str) -> LintFinding:
    fitting = [finding for finding in findings if text in finding.text]
    assert len(fitting) == 1, "\n".join(map(str, findings))
    return fitting[0]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_profiles_are_clean(name: str) -> None:
    assert check_file(DBC_FOLDER / name) == []


# what is replaced by what, what is said of it, and a text of the line that is named
# ruff: noqa: E501
IN_THE_DBC = [
    ("BO_ 273 MOTION", "BO_ 272 MOTION", ERROR, "MOTION: id 272 is already in line", "BO_ 272 MOTION"),
    ("SG_ YAW_RATE ", "SG_ HEADING ", ERROR, "MOTION.HEADING: is already in line", "SG_ HEADING : 48"),
    ("SPEED : 32|16", "SPEED : 31|16", ERROR, "MOTION.SPEED: overlapping: shares bits with HEADING", "SPEED : 31"),
    (
        "YAW_RATE : 48|16",
        "YAW_RATE : 56|16",
        ERROR,
        "MOTION.YAW_RATE: bits 56|16 do not fit into 8 bytes",
        "YAW_RATE : 56",
    ),
    (
        "YAW_RATE : 48|16@1- (0.0002,0)",
        "YAW_RATE : 48|16@1- (0,0)",
        ERROR,
        "MOTION.YAW_RATE: factor 0",
        "YAW_RATE : 48",
    ),
    ("[-6.5536|6.5534]", "[6.5|-6.5]", ERROR, "MOTION.YAW_RATE: range [6.5|-6.5] has swapped ends", "YAW_RATE : 48"),
    ("[-6.5536|6.5534]", "[-7|7]", WARNING, "range [-7|7]: 16 bits express [-6.5536|6.5534]", "YAW_RATE : 48"),
]
BOTH_WAYS = [
    ("[-6.5536|6.5534]", "[7|8]", ERROR, "MOTION.YAW_RATE: no value lies in its range", "YAW_RATE : 48"),
    ('BA_ "GenMsgCycleTime" BO_ 273 10;', "", WARNING, "MOTION: no cycle time", "BO_ 273"),
]
BY_ITSELF = [
    ("[-6.5536|6.5534]", "[0|0]", WARNING, "MOTION.YAW_RATE: no range", "YAW_RATE : 48"),
    (
        '[-6.5536|6.5534] "rad/s"',
        '[-6.5536|6.5534] "deg/fortnight"',
        WARNING,
        "unit 'deg/fortnight' is not known",
        "YAW_RATE : 48",
    ),
    ('[-6.5536|6.5534] "rad/s"', '[-6.5536|6.5534] "furlong"', WARNING, "unit 'furlong' is not known", "YAW_RATE : 48"),
    ('[-6.5536|6.5534] "rad/s"', '[-6.5536|6.5534] ""', WARNING, "a scaled number without a unit", "YAW_RATE : 48"),
]
WITH_THE_PROFILE = [
    ('[-6.5536|6.5534] "rad/s"', '[-6.5536|6.5534] "km/h"', ERROR, "unit 'km/h' is of speed: yaw_rate_radps must be in 'rad/s'", "YAW_RATE : 48"),
    ('[-6.5536|6.5534] "rad/s"', '[-6.5536|6.5534] ""', ERROR, "MOTION.YAW_RATE: has no unit, and yaw_rate_radps is in 'rad/s'", "YAW_RATE : 48"),
    ("BO_ 273 MOTION: 8 VEHICLE", "BO_ 273 MOTION: 8 CONTROLLER", ERROR, "MOTION: is received, but its sender", "BO_ 273"),
    (' 17 "NOT_ENGAGED"', "", ERROR, "DRIVE_COMMAND.REASON: VAL_ table without NOT_ENGAGED", "SG_ REASON"),
    ("COUNTER : 8|4@1+ (1,0) [0|14]", "COUNTER : 9|3@1+ (1,0) [0|7]", ERROR, "COUNTER: bits 9|3, but E2E profile 1 has 8|4", "COUNTER : 9"),
]  # fmt: skip


@pytest.mark.parametrize("case", IN_THE_DBC + BOTH_WAYS + BY_ITSELF, ids=lambda case: case[3])
def test_a_fault_of_a_dbc_is_found_in_its_line(copy: Copy, case: tuple[str, ...]) -> None:
    old, new, severity, text, place = case
    path = copy("reference.dbc", ("reference.dbc", old, new))
    finding = found_in(check_file(path), text)
    assert (finding.severity, finding.file) == (severity, str(path))
    assert finding.line == line_of(path, place)


@pytest.mark.parametrize("case", IN_THE_DBC + BOTH_WAYS + WITH_THE_PROFILE, ids=lambda case: case[3])
def test_a_fault_of_a_profiles_dbc_is_found_in_the_dbcs_line(copy: Copy, case: tuple[str, ...]) -> None:
    old, new, severity, text, place = case
    path = copy("reference.toml", ("reference.dbc", old, new))
    finding = found_in(check_file(path), text)
    assert (finding.severity, finding.file) == (severity, str(path.with_suffix(".dbc")))
    assert finding.line == line_of(path.with_suffix(".dbc"), place)


IN_THE_PROFILE = [
    ("reviewed = false", "reviewd = false", "$.reviewd: unknown key", "reviewd"),
    ("front_wheel_angle_rad = 0.6", 'front_wheel_angle_rad = "0.6"', "$.limits.front_wheel_angle_rad: Expected float, got str", 'front_wheel_angle_rad = "0.6'),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = nan", "$.limits.front_wheel_angle_rad: nan: must be finite", "front_wheel_angle_rad = nan"),
    ("front_wheel_angle_rad = 0.6", "", "$.limits: front_wheel_angle_rad is missing", "[limits]"),
    ("front_wheel_angle_rad = 0.6", "front_wheel_angle_rad = 1.2", "$.limits.front_wheel_angle_rad: 1.2: STEER_COMMAND", "front_wheel_angle_rad = 1.2"),
    ("accel_max_mps2 = 3.0", "accel_max_mps2 = 30.0", "$.limits.accel_max_mps2: 30.0: DRIVE_COMMAND.ACCEL_REQUEST", "accel_max_mps2"),
    ("POSE.POS_X", "POSE.POSX", "$.state.signals.x_m: no signal 'POSX' in POSE; nearest: POS_X", "x_m ="),
    ('"MOTION.SPEED"', '"MOTION.HEADING"', "$.state.signals.speed_mps: MOTION.HEADING is already bound", "speed_mps = \"MOTION"),
    ('"POSE.POS_X"', '"POS_X"', "$.state.signals.x_m: 'POS_X': must be MESSAGE.SIGNAL", "x_m ="),
    ("sample_period_s = 0.01", "sample_period_s = 0.02", "$.timing.sample_period_s: 0.02 s, but MOTION", "sample_period_s"),
    ("state_stale_s = 0.05", "state_stale_s = 0.7", "$.timing.state_silent_s: 0.5: must be above", "state_silent_s"),
    ("POSE = 0x110", "POSE = 0x111", "$.e2e.data_ids.POSE: 0x111, but E2EDataId is 0x110", "POSE = 0x111"),
    ("POSE = 0x110\n", "", "$.e2e.data_ids.POSE: missing", "[e2e.data_ids]"),
    ('ODOM = "odom"', 'ODO = "odom"', "$.state.frames.ODO: not in POSE.POSE_FRAME", "ODO ="),
    ('sample = ["POSE", "MOTION", "CHASSIS"]', 'sample = ["POSE", "POSE", "CHASSIS"]', "$.state.sample[1]: POSE is listed twice", "sample ="),
    ('dbc = "reference.dbc"', 'dbc = ""', "$.dbc: '': must be a file's name", 'dbc = ""'),
    ("[geometry]", '[signals."POSE.POS_X"]\nnot_available = [-16777215]\n[geometry]', "$.signals.POSE.POS_X.not_available: -16777215: must be a raw value of 24 bits, in [-8388608, 16777215]", "not_available ="),
    ("[geometry]", '[signals."VEHICLE_STATUS.MODE"]\nnames = { one = "MANUAL", 9 = "READY" }\n[geometry]', "$.signals.VEHICLE_STATUS.MODE.names: 'one': must be a whole number", "names ="),
    ("[geometry]", '[signals."VEHICLE_STATUS.MODE"]\nnames = { one = "MANUAL", 9 = "READY" }\n[geometry]', "$.signals.VEHICLE_STATUS.MODE.names: 9: must be a number of 3 bits, in [0, 7]", "names ="),
    ('"STEER_COMMAND.ENABLE"]', '"STEER_COMMAND.ENABLE", "STEER_COMMAND.ENABLE"]', "$.command.signals.enable: STEER_COMMAND.ENABLE is listed twice", "enable ="),
    ("command_period_s = 0.01", "command_period_s = inf", "$.timing.command_period_s: inf: must be finite", "command_period_s"),
    ('dbc = "reference.dbc"', 'dbc = "reference_fd.dbc"', "$.bus.fd: false, but VEHICLE_STATUS is an FD frame", "fd = false"),
]  # fmt: skip


@pytest.mark.parametrize("case", IN_THE_PROFILE, ids=lambda case: case[2])
def test_a_fault_of_a_profile_is_found_with_its_path_and_line(copy: Copy, case: tuple[str, ...]) -> None:
    old, new, text, place = case
    path = copy("reference.toml", ("reference.toml", old, new))
    finding = found_in(check_file(path), text)
    assert (finding.severity, finding.file) == (ERROR, str(path))
    assert finding.line == line_of(path, place)


def test_an_old_key_of_a_profile_is_a_warning_in_its_line(copy: Copy) -> None:
    path = copy("reference.toml", ("reference.toml", "stop_release_time_constant_s", "stop_ease_s"))
    finding = found_in(check_file(path), "$.behavior.stop_ease_s: renamed to stop_release_time_constant_s")
    assert (finding.severity, finding.file) == (WARNING, str(path))
    assert finding.line == line_of(path, "stop_ease_s")


def test_a_counter_that_the_profile_claims_and_the_dbc_lacks_is_found_in_each_message(copy: Copy) -> None:
    path = copy("reference.toml", ("reference.toml", 'counter_signal = "COUNTER"', 'counter_signal = "ALIVE"'))
    missing = [finding.text for finding in check_file(path) if "no signal 'ALIVE'" in finding.text]
    assert len(missing) == 8
    assert all(text.startswith("$.e2e.counter_signal: ") for text in missing)


def test_messages_without_protection_are_a_warning(copy: Copy) -> None:
    path = copy("reference_fd.toml", ("reference_fd.toml", "COMMAND = 0x080\n", ""))
    assert found_in(check_file(path), "COMMAND: no counter and no checksum").severity == WARNING


def test_all_faults_are_found_at_once(copy: Copy) -> None:
    every = [("reference.dbc", old, new) for old, new, *_ in (IN_THE_DBC[2], IN_THE_DBC[4], WITH_THE_PROFILE[3])]
    every += [
        ("reference.toml", old, new) for old, new, *_ in (IN_THE_PROFILE[0], IN_THE_PROFILE[5], IN_THE_PROFILE[6])
    ]
    findings = check_file(copy("reference.toml", *every))
    for case in (IN_THE_DBC[2], IN_THE_DBC[4], WITH_THE_PROFILE[3]):
        found_in(findings, case[3])
    for in_the_profile in (IN_THE_PROFILE[0], IN_THE_PROFILE[5], IN_THE_PROFILE[6]):
        found_in(findings, in_the_profile[2])


@pytest.mark.parametrize(
    ("content", "text", "line"),
    [
        (b"", "the file is empty", 1),
        (b'VERSION ""\n\x00', "a NUL byte", 2),
        (b'VERSION "', "ends in the middle of this statement", 1),
        (b'VERSION ""\nBO_ 1 A: 8 X\n SG_ B : 0|8@1+ (1', "ends in the middle of this statement", 3),
        (b'VERSION ""\n', "no message in it", 0),
        (b'VERSION ""\nBO_ nonsense\n', "", 2),
    ],
)
def test_a_file_that_is_no_dbc_is_one_finding_or_two(tmp_path: Path, content: bytes, text: str, line: int) -> None:
    path = tmp_path / "bad.dbc"
    path.write_bytes(content)
    errors = [finding for finding in check_file(path) if finding.severity == ERROR]
    assert any(text in error.text and error.line == line for error in errors), errors


@pytest.mark.parametrize(
    ("content", "text", "line"),
    [("[limits", "not TOML", 1), ("a = 1\nb = = 2\n", "not TOML", 2), ("", "name is missing", 1)],
)
def test_a_file_that_is_no_profile_is_reported(tmp_path: Path, content: str, text: str, line: int) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(content)
    assert any(text in finding.text and finding.line == line for finding in check_file(path))


def test_a_profile_that_is_not_whole_still_has_its_dbc_checked(copy: Copy) -> None:
    path = copy(
        "reference.toml",
        ("reference.toml", 'x_m = "POSE.POS_X"', ""),
        ("reference.dbc", "SPEED : 32|16", "SPEED : 31|16"),
    )
    findings = check_file(path)
    found_in(findings, "$.state.signals: x_m is missing")
    found_in(findings, "MOTION.SPEED: overlapping: shares bits with HEADING")


def test_multiplexed_signals_may_share_their_bits(tmp_path: Path) -> None:
    path = tmp_path / "mux.dbc"
    text = (
        'VERSION ""\nBU_: A\nBO_ 1 M: 8 A\n SG_ MUX M : 0|8@1+ (1,0) [0|1] "" A\n'
        ' SG_ X m0 : 8|8@1+ (1,0) [0|255] "" A\n SG_ Y m{} : 8|8@1+ (1,0) [0|255] "" A\n'
    )
    path.write_text(text.format(1))
    assert not [finding for finding in check_file(path) if finding.severity == ERROR]
    path.write_text(text.format(0))
    assert found_in(check_file(path), "overlapping").line == 6


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"must end in \.dbc or \.toml"):
        check_file(tmp_path / "a.arxml")


def test_the_command_prints_each_finding_and_exits_with_2_only_for_errors(
    copy: Copy, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["check-dbc", str(DBC_FOLDER / "reference.toml")]) == 0
    assert capsys.readouterr().out == ""
    path = copy("reference.dbc", ("reference.dbc", "[-6.5536|6.5534]", "[-7|7]"))
    assert cli.main(["check-dbc", str(path)]) == 0
    assert capsys.readouterr().out.startswith(f"{path}:{line_of(path, 'SG_ YAW_RATE')}: warning: MOTION.YAW_RATE: ")
    path = copy("reference.dbc", ("reference.dbc", "SPEED : 32|16", "SPEED : 31|16"))
    assert cli.main(["check-dbc", "--json", str(path)]) == 2
    (finding,) = json.loads(capsys.readouterr().out)
    assert (finding["severity"], finding["line"]) == ("error", line_of(path, "SPEED : 31"))


def test_a_field_of_either_sign_that_is_never_negative_is_warned_of(tmp_path: Path) -> None:
    text = (DBC_FOLDER / "mqb_by_wire.toml").read_text(encoding="utf-8")
    yaw = '{ value = "VEHICLE_DYNAMICS.YAW_RATE", negative_if = "VEHICLE_DYNAMICS.YAW_RATE_SIGN" }'
    assert yaw in text
    profile = tmp_path / "car.toml"
    profile.write_text(
        text.replace(yaw, '"VEHICLE_DYNAMICS.YAW_RATE"').replace(
            "mqb_by_wire.dbc", str(DBC_FOLDER / "mqb_by_wire.dbc")
        ),
        encoding="utf-8",
    )
    found = found_in(check_file(profile), "yaw_rate_radps is never negative")
    assert (found.severity, found.line) == (WARNING, line_of(DBC_FOLDER / "mqb_by_wire.dbc", "SG_ YAW_RATE :"))
    assert not [finding for finding in check_file(DBC_FOLDER / "mqb_by_wire.toml") if "is never" in finding.text]


def test_a_missing_key_or_a_wrong_type_hides_no_other_fault_and_makes_none(copy: Copy) -> None:
    edits = {
        "speed_max_mps = 20.0": "speed_max_mps = -1.0",
        "sample_period_s = 0.01\n": "\n",
        "profile = 1 ": "profile = 4 ",
        "wheelbase_m = 2.7": "wheelbase = 2.7",
        '"POSE.POS_X"': '"POSE.POSX"',
        "accel_max_mps2 = 3.0": "accel_max_mps2 = 30.0",
        'ODOM = "odom"': 'ODO = "odom"',
    }
    path = copy("reference.toml", *(("reference.toml", old, new) for old, new in edits.items()))
    found = [finding.text.partition(": ")[0] for finding in check_file(path) if finding.severity == ERROR]
    assert sorted(found) == [
        "$.e2e.profile",
        "$.geometry.wheelbase",
        "$.limits.accel_max_mps2",
        "$.limits.speed_max_mps",
        "$.state.frames",
        "$.state.frames.ODO",
        "$.state.signals.x_m",
        "$.timing",
    ]
