"""What a draft says beside its bindings, and that nothing in it can be driven by before a person has filled it in."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.vehicles.profiles import DBC as CAR
from vehicle_iface.codec import lint
from vehicle_iface.codec.database import load_database
from vehicle_iface.drafting import draft_profile, write_draft
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile
from vehicle_iface.profile.forms import FieldForm

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
REFERENCE = ROOT / "dbc" / "reference.dbc"


def draft_text(folder: Path, *edits: tuple[str, str], dbc: str = CAR) -> str:
    """The text of the draft for a DBC, with texts replaced; each must be there."""
    for old, new in edits:
        assert old in dbc, old
        dbc = dbc.replace(old, new)
    path = folder / "car.dbc"
    path.write_text(dbc, encoding="utf-8")
    return write_draft(draft_profile(path), folder / "car.toml")


def draft_of(name: str, folder: Path) -> str:
    return write_draft(draft_profile(HERE / f"{name}.dbc"), folder / f"{name}.toml")


def check(text: str, folder: Path, name: str = "car") -> list[str]:
    """What `check-dbc` finds in it, as `severity: text`."""
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    return [f"{one.severity}: {one.text}" for one in lint.check_file(path)]


def line_of(text: str, beginning: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(beginning))


# --- nothing is invented


def test_check_dbc_lists_every_number_that_a_draft_leaves_out(tmp_path: Path) -> None:
    text = draft_text(tmp_path)
    found = check(text, tmp_path)
    for key in ("wheelbase_m", "speed_max_mps", "state_stale_s", "safe_deceleration_mps2", "bitrate", "frozen_time_s"):
        assert any(one.startswith("error: ") and f": {key} is missing" in one for one in found), key
    with pytest.raises(ConfigError, match="wheelbase_m is missing"):
        load_profile(tmp_path / "car.toml")


def test_a_draft_is_complete_once_its_examples_are_accepted(tmp_path: Path) -> None:
    text = write_draft(draft_profile(REFERENCE), tmp_path / "reference.toml")
    (tmp_path / "reference.toml").write_text(re.sub(r"^# TODO (?=\w+ = )", "", text, flags=re.MULTILINE))
    drafted, known = load_profile(tmp_path / "reference.toml"), load_profile("reference")
    assert load_database(drafted).received[0].name == "POSE"
    assert not drafted.reviewed
    for table in ("state", "status", "command", "body", "report", "bus", "e2e", "timing"):
        assert getattr(drafted, table) == getattr(known, table), table


def test_the_numbers_of_a_dbc_are_in_its_draft(tmp_path: Path) -> None:
    document = tomllib.loads(draft_of("control_unit", tmp_path))
    assert document["timing"] == {
        "sample_period_s": 0.02,
        "status_period_s": 0.02,
        "command_period_s": 0.02,
        "body_period_s": 0.1,
        "report_period_s": 0.1,
    }
    assert document["reviewed"] is False
    assert {"geometry", "limits", "behavior"} <= document.keys()
    assert document["geometry"] == {}


def test_a_signal_that_is_named_unclearly_is_a_question(tmp_path: Path) -> None:
    text = draft_text(tmp_path, ("SG_ YAW :", "SG_ ANGLE_Q :"), ("SG_ BRAKE :", "SG_ BRAKE_TEST_ABC :"))
    assert line_of(text, "# missing: heading_rad").endswith("TODO needed: the heading")
    assert line_of(text, "# driver_brake = …").endswith("TODO no signal is named clearly enough:")
    assert "heading_rad" not in tomllib.loads(text)["state"]["signals"]


def test_between_two_signals_that_fit_alike_a_person_chooses(tmp_path: Path) -> None:
    second = 'BO_ 300 POSE_B: 2 CAR\n SG_ V : 0|16@1- (0.01,0) [-50|50] "m/s" PC\n\nBO_ 256'
    text = draft_text(
        tmp_path,
        ("BO_ 256", second),
        ('SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s"', 'SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s"'),
    )
    assert line_of(text, "# speed_mps = …").endswith("TODO 2 signals fit equally well; choose one:")
    assert '#   or "POSE.V"' in text
    assert '#   or "POSE_B.V"' in text


def test_between_two_enables_in_messages_of_their_own_a_person_chooses(tmp_path: Path) -> None:
    alone = "".join(
        f'BO_ {number} SET_{name}: 1 PC\n SG_ ENABLE : 0|1@1+ (1,0) [0|1] "" CAR\n\n'
        for number, name in ((140, "ONE"), (141, "TWO"))
    )
    text = draft_text(tmp_path, (' SG_ EN : 0|1@1+ (1,0) [0|1] "" CAR\n', ""), ("BO_ 128", f"{alone}BO_ 128"))
    assert line_of(text, "# enable = …").endswith("TODO several signals fit equally well; choose one:")


def test_no_command_is_drafted_where_nothing_is_received_from_a_controller(tmp_path: Path) -> None:
    text = draft_text(tmp_path, (CAR[CAR.index("BO_ 128") : CAR.index("VAL_")], ""))
    assert "command" not in tomllib.loads(text)
    assert "this profile only watches" in line_of(text, "# missing: [command]")


# --- reasons


def test_each_binding_names_its_line_and_its_reason(tmp_path: Path) -> None:
    text = draft_text(tmp_path)
    number = next(n for n, line in enumerate(CAR.splitlines(), start=1) if " SG_ YAW " in line)
    assert line_of(text, "heading_rad").endswith(f'# line {number}: named "yaw", in rad, -3.2 … 3.2')
    assert line_of(text, "mode").endswith("its table has AUTONOMOUS, MANUAL")


def test_further_candidates_stand_below_their_field(tmp_path: Path) -> None:
    lines = draft_of("truck", tmp_path).splitlines()
    place = next(n for n, line in enumerate(lines) if line.startswith("gear = "))
    assert lines[place + 1].startswith('#   or "ETC2.TransSelectedGear"')


def test_a_field_without_candidate_describes_the_signal_it_needs(tmp_path: Path) -> None:
    assert line_of(draft_text(tmp_path), "# missing: yaw_rate_radps").endswith(
        '# optional: a number in rad/s, named like "yaw rate"'
    )


# --- forms


def test_without_a_speed_of_the_vehicle_the_rear_wheels_mean_is_taken(tmp_path: Path) -> None:
    wheels = "".join(
        f' SG_ {name} : {bit}|16@1+ (0.01,0) [0|900] "rpm" PC\n' for name, bit in (("RL", 0), ("RR", 16), ("FL", 32))
    )
    text = draft_text(
        tmp_path,
        (' SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s" PC\n', f"BO_ 288 WHEEL_SPEEDS: 8 CAR\n{wheels}"),
    )
    draft = draft_profile(tmp_path / "car.dbc")
    assert draft.fields["state", "speed_mps"].value == FieldForm(mean=("WHEEL_SPEEDS.RL", "WHEEL_SPEEDS.RR"))
    assert any("$.signals.WHEEL_SPEEDS.RL.scale" in one for one in check(text, tmp_path))


@pytest.mark.parametrize(
    ("name", "source"), [("inertial", "geographic"), ("production", "odometry"), ("control_unit", "local")]
)
def test_the_pose_comes_from_what_the_bus_has(tmp_path: Path, name: str, source: str) -> None:
    assert tomllib.loads(draft_of(name, tmp_path))["state"].get("pose", {}).get("source", "local") == source


def test_messages_without_a_common_counter_are_a_sample_by_time(tmp_path: Path) -> None:
    text = draft_of("control_unit", tmp_path)
    state = tomllib.loads(text)["state"]
    assert (state["assemble"], state["trigger"]) == ("newest", "LOC_Pos")
    assert "ESC_Sts = 0.05" in line_of(text, "# max_age_s")


def test_flags_of_subsystems_become_conditions_and_ready_stays_a_question(tmp_path: Path) -> None:
    text = draft_of("by_wire", tmp_path)
    assert tomllib.loads(text)["status"]["when"].keys() == {"fault", "manual", "autonomous"}
    assert "TODO" in line_of(text, "# ready =")


def test_modes_and_gears_are_translated_and_unknown_names_are_questions(tmp_path: Path) -> None:
    text = draft_of("control_unit", tmp_path)
    status = tomllib.loads(text)["status"]
    assert status["modes"] == {
        "Manual Mode": "MANUAL",
        "Standby": "READY",
        "Auto Mode": "AUTONOMOUS",
        "Fault": "FAULT",
    }
    gears = {"P": "PARK", "R": "REVERSE", "N": "NEUTRAL", "D": "DRIVE", "No Request": "NO_REQUEST"}
    assert status["gears"] == gears
    assert line_of(text, "# Invalid = ").endswith("TODO what does this name mean?")


def test_the_form_of_the_command_follows_from_its_signals(tmp_path: Path) -> None:
    text = draft_of("tractor", tmp_path)
    assert re.search(r'^(# )?longitudinal = "speed"', text, re.MULTILINE)
    assert re.search(r'^(# )?lateral = "curvature"', text, re.MULTILINE)
    assert re.search(r'^(# )?curvature_per_m = "GuidanceSystemCommand.CurvatureCommand"', text, re.MULTILINE)


def test_commands_of_torque_and_brake_in_percent_are_pedals(tmp_path: Path) -> None:
    pedals = "".join(
        f' SG_ {name}_REQ : {bit}|8@1+ (0.5,0) [0|100] "%" CAR\n' for name, bit in (("TORQUE", 16), ("BRAKE", 24))
    )
    text = draft_text(
        tmp_path,
        (' SG_ ACC : 16|16@1- (0.001,0) [-10|10] "m/s^2" CAR\n', pedals),
        (' SG_ SPD : 48|16@1- (0.01,0) [-50|50] "m/s" CAR\n', ""),
    )
    command = tomllib.loads(text)["command"]
    assert command["longitudinal"] == "pedals"
    assert (command["signals"]["throttle"], command["signals"]["brake"]) == ("CMD.TORQUE_REQ", "CMD.BRAKE_REQ")


@pytest.mark.parametrize(("more", "is_bound"), [("", False), (' 7 "NO_REQUEST"', True)])
def test_a_gear_request_is_bound_where_a_value_may_request_no_gear(tmp_path: Path, more: str, is_bound: bool) -> None:
    request = ' SG_ GEAR_REQ : 1|3@1+ (1,0) [0|7] "" CAR\n SG_ STEER'
    names = f'VAL_ 128 GEAR_REQ 0 "P" 1 "R" 2 "N" 3 "D"{more} ;\nVAL_'
    text = draft_text(tmp_path, (" SG_ STEER", request), ("VAL_", names))
    assert ("gear_request" in tomllib.loads(text)["command"]["signals"]) is is_bound
    assert ("none of its names means NO_REQUEST" in text) is not is_bound


@pytest.mark.parametrize(("command_ms", "trigger"), [(10, "MOTION"), (50, "POSE"), (100, "POSE")])
def test_each_command_finds_a_new_sample(tmp_path: Path, command_ms: int, trigger: str) -> None:
    motion = "\nBO_ 273 MOTION: 8 CAR\n SG_ YAW : 32"
    periods = f'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\nBA_ "GenMsgCycleTime" BO_ 272 50;\n\
BA_ "GenMsgCycleTime" BO_ 273 10;\nBA_ "GenMsgCycleTime" BO_ 128 {command_ms};\nVAL_'
    text = draft_text(tmp_path, (" SG_ YAW : 32", motion), ("VAL_", periods))
    assert tomllib.loads(text)["state"]["trigger"] == trigger


def test_a_frame_of_reference_that_is_not_known_is_a_question(tmp_path: Path) -> None:
    frame = ' SG_ POSE_FRAME : 4|2@1+ (1,0) [0|3] "" PC\n SG_ BRAKE'
    text = draft_text(tmp_path, (" SG_ BRAKE", frame), ("VAL_ 256", 'VAL_ 256 POSE_FRAME 0 "MAP" 1 "YARD" ;\nVAL_ 256'))
    assert tomllib.loads(text)["state"]["frames"] == {"MAP": "map"}
    assert line_of(text, "# YARD = ").endswith("TODO which frame of reference is this?")


def test_names_of_values_are_understood_behind_a_beginning_that_all_share(tmp_path: Path) -> None:
    text = draft_text(
        tmp_path,
        ('0 "MANUAL" 1 "READY" 2 "AUTONOMOUS"', '0 "DRV_ST_HUMAN" 1 "DRV_ST_IDLE" 2 "DRV_ST_AUTO"'),
        ('3 "FAULT" 4 "EMERGENCY_STOP"', '3 "DRV_ST_ERR"'),
    )
    assert tomllib.loads(text)["status"]["modes"] == {
        "DRV_ST_HUMAN": "MANUAL",
        "DRV_ST_IDLE": "READY",
        "DRV_ST_AUTO": "AUTONOMOUS",
        "DRV_ST_ERR": "FAULT",
    }


def test_a_mode_of_which_no_name_fits_is_not_bound(tmp_path: Path) -> None:
    names = '0 "ECO" 1 "SPORT" 2 "SNOW"'
    text = draft_text(tmp_path, ('0 "MANUAL" 1 "READY" 2 "AUTONOMOUS" 3 "FAULT" 4 "EMERGENCY_STOP"', names))
    assert line_of(text, "# mode = …").endswith("TODO no signal is named clearly enough:")


def test_a_command_in_a_branch_of_a_multiplexer_needs_the_branch(tmp_path: Path) -> None:
    text = draft_text(
        tmp_path,
        ("SG_ ACC :", "SG_ ACC m2 :"),
        ("SG_ EN :", 'SG_ MODE_ENABLE M : 4|3@1+ (1,0) [0|7] "" CAR\n SG_ EN :'),
    )
    assert tomllib.loads(text)["command"]["signals"]["enable"] == "CMD.EN"
    assert "# TODO [constants] must say which branch is sent, by CMD.MODE_ENABLE" in text


# --- questions about signals


def test_the_angle_of_a_steering_wheel_cannot_be_used_before_its_ratio_is_given(tmp_path: Path) -> None:
    text = draft_of("control_unit", tmp_path)
    assert tomllib.loads(text)["signals"]["EPS_Sts.EPS_StrAng"] == {"scale": "TODO"}
    (tmp_path / "control_unit.dbc").write_bytes((HERE / "control_unit.dbc").read_bytes())
    wanted = "error: $.signals.EPS_Sts.EPS_StrAng.scale: is still TODO; replace it by a number"
    assert wanted in check(text, tmp_path, "control_unit")


def test_a_compass_heading_cannot_be_used_before_its_direction_is_given(tmp_path: Path) -> None:
    text = draft_text(tmp_path, ("(0.0001,0) [-3.2|3.2]", "(0.0001,0) [0|6.2832]"))
    assert "clockwise from north" in line_of(text, 'scale = "TODO"')
    assert 'scale = "TODO"' not in draft_text(tmp_path)


def test_a_comment_about_north_makes_a_heading_a_question(tmp_path: Path) -> None:
    comment = 'CM_ SG_ 272 YAW "Clockwise from true north.";\nVAL_'
    assert 'scale = "TODO"' in draft_text(tmp_path, ("VAL_", comment))


def test_a_signal_without_unit_is_asked_for_it(tmp_path: Path) -> None:
    text = draft_text(tmp_path, ('(0.0001,0) [-1|1] "rad"', '(0.01,0) [-300|300] ""'))
    lines = text.splitlines()
    place = lines.index('# [signals."CMD.STEER"]')
    assert lines[place + 1].endswith('TODO "rad" or "deg": the DBC has none; its range is -300 … 300')


def test_checksums_and_counters_are_suggested_by_name(tmp_path: Path) -> None:
    text = draft_of("control_unit", tmp_path)
    assert '# checksum = { signal = "ADCU_DrvChkSum", kind = … }' in text
    assert '# counter = { signal = "ADCU_DrvRollCnt" }' in text
    assert "# likewise VCU_ChkSum and VCU_RollCnt of VCU_Sts" in text
    assert "protection" not in tomllib.loads(text)


def test_one_node_that_sends_in_both_directions_gets_notes(tmp_path: Path) -> None:
    text = draft_text(
        tmp_path, ("STATUS: 2 CAR", "STATUS: 2 BOX"), ("POSE: 8 CAR", "POSE: 8 XXX"), ("CMD: 8 PC", "CMD: 8 XXX")
    )
    messages = tomllib.loads(text)["messages"]
    assert messages == {"POSE": {"sender": "vehicle"}, "CMD": {"sender": "controller"}}


# --- the file


def test_the_dbc_is_named_relative_to_the_draft(tmp_path: Path) -> None:
    (tmp_path / "profiles").mkdir()
    (tmp_path / "car.dbc").write_text(CAR)
    text = write_draft(draft_profile(tmp_path / "car.dbc"), tmp_path / "profiles" / "my car.toml")
    document = tomllib.loads(text)
    assert (document["name"], document["dbc"]) == ("my car", "../car.dbc")


def test_quotation_marks_in_names_of_values_leave_a_draft_readable(tmp_path: Path) -> None:
    text = draft_text(tmp_path, ('0 "MANUAL"', '0 "by \\"hand\\""'))
    assert line_of(text, '# "by \\"hand\\""').endswith("TODO what does this name mean?")


def test_a_draft_is_the_same_whatever_the_hash_seed() -> None:
    program = (
        "from pathlib import Path; from vehicle_iface.drafting import draft_profile, write_draft\n"
        f"for path in sorted(Path({str(HERE)!r}).glob('*.dbc')): print(write_draft(draft_profile(path)))"
    )
    texts = {
        subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(texts) == 1
