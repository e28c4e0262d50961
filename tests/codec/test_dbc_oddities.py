"""DBC files as editors and public collections have them: each oddity is read or left out, and harms nothing else."""

import re
from pathlib import Path
from typing import NamedTuple

import pytest
from cantools.database import Message
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface import cli
from vehicle_iface.codec import MessageCodec
from vehicle_iface.codec.database import load_database
from vehicle_iface.codec.dbc_file import DbcFile, read_dbc
from vehicle_iface.codec.dbc_findings import ERROR, WARNING
from vehicle_iface.codec.lint import check_file
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile

from .conftest import DBC_FOLDER, REFERENCE_DBC

HEAD = 'VERSION ""\n\nNS_ :\n\tCM_\n\tBA_DEF_\n\tVAL_\n\nBS_: 500000 : 0,0\n\nBU_: ECU GW\n\n'
SOUND = 'BO_ 256 SOUND: 8 ECU\n SG_ V : 0|16@1+ (0.01,0) [0|655.35] "m/s" GW\n'
CYCLE = 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\nBA_ "GenMsgCycleTime" BO_ 256 10;\n'
ODD = 'BO_ 512 ODD: 8 ECU\n SG_ S : 0|8@1+ (1,0) [0|255] "" GW\n'


class Oddity(NamedTuple):
    """What real files have, beside a sound message."""

    message: str
    """Among the messages."""
    notes: str = ""
    """After them."""
    severity: str = ""
    """Of the finding; empty where nothing is said."""
    text: str = ""
    """In the finding."""


ODDITIES = {
    "nothing": Oddity(ODD),
    "a point before the first digit": Oddity(ODD.replace("(1,0)", "(.25,-.5)")),
    "blanks in a signal": Oddity(ODD.replace("0|8@1+ (1,0) [0|255]", " 0 | 8@1+  ( 1 , 0 )[0|255]")),
    "no receiver": Oddity(ODD.replace(' "" GW', ' ""')),
    "receivers on the next line": Oddity(ODD.replace(' "" GW', ' "" GW,\n  ABS')),
    "a remark": Oddity(f"// not ours\n{ODD}"),
    "an extended id without its flag": Oddity(
        ODD.replace("512", "316495015"), 'VAL_ 316495015 S 0 "A" ;\n', WARNING, "ODD: id 0x12dd54a7 is above 0x7ff"
    ),
    "an id that is none": Oddity(ODD.replace("512", "1075054137"), "", ERROR, "ODD: id 1075054137: must be at most"),
    "an id of 11 digits": Oddity(ODD.replace("512", "51200000000"), "", ERROR, "ODD: was not understood: 'BO_ 512"),
    "names that begin with a digit": Oddity(ODD.replace("ODD", "2017_5").replace("SG_ S", "SG_ 64_BIT")),
    "a name that is a keyword": Oddity(ODD.replace("SG_ S", "SG_ FILTER")),
    "a name beyond ASCII": Oddity(ODD.replace("SG_ S", "SG_ Größe")),
    "a signal like nothing": Oddity(f"{ODD} SG_ T : 8|8@1+ 1,0) [0|1]\n", "", ERROR, "ODD.T: was not understood: 'SG_"),
    "a line like nothing": Oddity(f"{ODD} SGG_ T : 8|8@1+\n", "", ERROR, "ODD: was not understood: 'SGG_ T"),
    "a statement that no one knows": Oddity(
        f'{ODD}SIG_MAXIMUM_ 512 S 5;\n SG_ T : 8|8@1+ (1,0) [0|1] "" GW\n', "", WARNING, "keyword SIG_MAXIMUM_ is not"
    ),
    "a message like nothing": Oddity(ODD.replace(": 8 ECU", " 8"), "", ERROR, "ODD: was not understood: 'BO_ 512 ODD"),
    "a quotation mark too few": Oddity(ODD.replace('""', '"'), "", ERROR, "ODD.S: was not understood"),
    "a signal beyond its message": Oddity(ODD.replace("0|8", "60|8"), "", ERROR, "ODD.S: bits 60|8 do not fit into 8"),
    "a big-endian one beyond it": Oddity(ODD.replace("0|8@1", "56|8@0"), "", ERROR, "ODD.S: bits 56|8 do not fit"),
    "a signal without bits": Oddity(ODD.replace("0|8", "0|0"), "", ERROR, "ODD.S: has no bits"),
    "a factor of 0": Oddity(ODD.replace("(1,0)", "(0,0)"), "", ERROR, "ODD.S: factor 0"),
    "a factor without end": Oddity(ODD.replace("(1,0)", "(1e999,0)"), "", ERROR, "ODD.S: a number that is not finite"),
    "swapped range": Oddity(ODD.replace("[0|255]", "[255|0]"), "", ERROR, "ODD.S: range [255|0] has swapped ends"),
    "overlapping signals": Oddity(f'{ODD} SG_ T : 4|8@1+ (1,0) [0|9] "" GW\n', "", ERROR, "ODD.T: overlapping: shares"),
    "a signal twice": Oddity(f'{ODD} SG_ S : 8|8@1+ (1,0) [0|9] "" GW\n', "", ERROR, "ODD.S: is already in line"),
    "a message twice": Oddity(ODD + ODD.replace("512", "513"), "", ERROR, "ODD: is already in line"),
    "an id twice": Oddity(ODD + ODD.replace("ODD", "EVEN"), "", ERROR, "EVEN: id 512 is already in line"),
    "9 bytes": Oddity(ODD.replace(": 8", ": 9"), "", ERROR, "ODD: 9 bytes: no frame has this length"),
    "12 bytes": Oddity(ODD.replace(": 8", ": 12"), "", WARNING, "ODD: 12 bytes, but no VFrameFormat marks it"),
    "more than a frame": Oddity(
        ODD.replace(": 8", ": 39"),
        'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
        'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\nBA_ "VFrameFormat" BO_ 256 0;\n',
        ERROR,
        "ODD: 39 bytes are more than one frame",
    ),
    "a marker without a multiplexer": Oddity(ODD.replace("S :", "S m1 :"), "", ERROR, "ODD.S: is multiplexed, but"),
    "a marker that is none": Oddity(ODD.replace("S :", "S m :"), "", ERROR, "ODD.S: was not understood"),
    "a value table of nothing": Oddity(ODD, 'VAL_ 512 NONE 0 "A" ;\n', WARNING, "VAL_ table of ODD.NONE, which is not"),
    "a value table of no message": Oddity(ODD, 'VAL_ 77 S 0 "A" ;\n', WARNING, "VAL_ table of id 77.S, which is"),
    "a value table of a variable": Oddity(ODD, 'VAL_ Variable 0 "A" ;\n'),
    "a value table without end": Oddity(ODD, 'VAL_ 512 S 0 "A"\n', WARNING, "VAL_ without a semicolon"),
    "a value table like nothing": Oddity(ODD, 'VAL_ 512 S 0 "A" 1 ;\n', ERROR, "ODD.S: was not understood: 'VAL_"),
    "two value tables": Oddity(
        ODD, 'VAL_ 512 S 0 "A" ;\nVAL_ 512 S 0 "B" ;\n', ERROR, "ODD.S: has another VAL_ table in line"
    ),
    "the same value table twice": Oddity(ODD, 'VAL_ 512 S 0 "A" ;\n' * 2),
    "a number with two names": Oddity(ODD, 'VAL_ 512 S 1 "A" 1 "B" ;\n', ERROR, "ODD.S: its VAL_ table names 1 twice"),
    "a value table by its name": Oddity(ODD, 'VAL_TABLE_ Names 0 "A" ;\nVAL_ 512 S Names ;\n'),
    "a comment of a signal without its name": Oddity(ODD, 'CM_ SG_ 512 "all";\n', WARNING, "a comment that belongs to"),
    "a comment without a keyword": Oddity(ODD, 'CM_ 145 "all";\n', WARNING, "a comment that belongs to"),
    "a comment with quotation marks": Oddity(ODD, 'CM_ BO_ 512 "the "odd" one";\n'),
    "a comment without its end": Oddity(ODD, 'CM_ BO_ 512 "the odd one;\n', WARNING, "ODD: was not understood: 'CM_"),
    "a comment among messages": Oddity(f'CM_ "Front target"\n{ODD}', "", WARNING, "CM_ without a semicolon"),
    "an attribute that nothing defines": Oddity(
        ODD, 'BA_ "GenSigStartValue" SG_ 512 S 10;\n', WARNING, "GenSigStartValue has no BA_DEF_"
    ),
    "an attribute that nobody reads": Oddity(ODD, 'BA_ "GenMsgSendType" BO_ 512 "Event";\nBA_ "SPN" SG_ 512 S 1.5;\n'),
    "an attribute as text": Oddity(ODD, 'BA_ "GenMsgCycleTime" BO_ 512 "20";\n'),
    "an attribute that is no number": Oddity(
        ODD, 'BA_ "GenMsgCycleTime" BO_ 512 "soon";\n', ERROR, "ODD: was not understood: 'BA_ \"GenMsgCycleTime\""
    ),
    "an attribute twice": Oddity(
        ODD, 'BA_ "GenMsgCycleTime" BO_ 512 1;\nBA_ "GenMsgCycleTime" BO_ 512 2;\n', ERROR, "ODD: has another Gen"
    ),
    "a float of odd width": Oddity(ODD, "SIG_VALTYPE_ 512 S : 1;\n", ERROR, "ODD.S: a float of 8 bits"),
    "a type of nothing": Oddity(ODD, "SIG_VALTYPE_ 512 T : 1;\n", WARNING, "SIG_VALTYPE_ of ODD.T, which is not there"),
    "statements of no use": Oddity(ODD, 'EV_ X: 0 [0|1] "" 0 1 DUMMY_NODE_VECTOR0 ECU;\nBA_REL_ "X" BU_SG_REL_ Y 1;\n'),
    "signals that are in no message": Oddity(
        ODD + ODD.replace("512 ODD", "3221225472 VECTOR__INDEPENDENT_SIG_MSG"), 'CM_ SG_ 3221225472 S "spare";\n'
    ),
}  # fmt: skip


def write(path: Path, *oddities: Oddity, head: str = HEAD) -> Path:
    messages = "\n".join([*(one.message for one in oddities), SOUND])
    path.write_text(head + messages + "".join(one.notes for one in oddities) + CYCLE, encoding="utf-8")
    return path


def line_of(path: Path, text: str) -> int:
    content = path.read_text(encoding="utf-8")
    return content[: content.index(text)].count("\n") + 1


def find(file: DbcFile, name: str) -> Message:
    return file.messages[name]


def check_sound(file: DbcFile) -> None:
    """The sound message is as it would be alone."""
    message = find(file, "SOUND")
    assert (message.frame_id, message.is_extended_frame, message.length, message.is_fd) == (256, False, 8, False)
    assert (message.cycle_time, message.senders) == (10, ["ECU"])
    assert MessageCodec(message).decode(bytes.fromhex("1027000000000000")) == (100.0,)
    assert not [finding for finding in file.findings if finding.message == "SOUND"]
    for message in file.messages.values():
        MessageCodec(message)


@pytest.mark.parametrize("name", ODDITIES)
def test_an_oddity_is_named_with_its_line_and_leaves_the_sound_message_alone(tmp_path: Path, name: str) -> None:
    oddity = ODDITIES[name]
    path = write(tmp_path / "odd.dbc", oddity)
    file = read_dbc(path)
    check_sound(file)
    assert [(one.severity, one.text.startswith(oddity.text)) for one in file.findings] == [
        (oddity.severity, True)
    ] * bool(oddity.text)
    own = (oddity.message + oddity.notes).split()
    for finding in file.findings:
        assert path.read_text(encoding="utf-8").splitlines()[finding.line - 1].split()[0] in own
    assert cli.main(["check-dbc", str(path)]) == (2 if oddity.severity == ERROR else 0)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.sampled_from(sorted(ODDITIES)), max_size=6), st.booleans(), st.booleans())
def test_no_mixture_of_oddities_harms_a_sound_message(
    tmp_path_factory: pytest.TempPathFactory, names: list[str], has_line_end: bool, has_nodes: bool
) -> None:
    head = HEAD if has_nodes else HEAD[: HEAD.index("NS_")]
    path = write(tmp_path_factory.mktemp("odd") / "ODD.DBC", *(ODDITIES[name] for name in names), head=head)
    if not has_line_end:
        path.write_bytes(path.read_bytes().rstrip())
    check_sound(read_dbc(path))
    check_file(path)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.lists(st.sampled_from(sorted(ODDITIES)), min_size=1, max_size=6))
def test_a_profile_of_sound_messages_is_usable_whatever_else_its_dbc_has(
    tmp_path_factory: pytest.TempPathFactory, names: list[str]
) -> None:
    folder = tmp_path_factory.mktemp("foreign")
    (folder / "reference.toml").write_text((DBC_FOLDER / "reference.toml").read_text(encoding="utf-8"))
    messages = "\n".join(ODDITIES[name].message for name in names)
    notes = "".join(line for name in names for line in ODDITIES[name].notes.splitlines(keepends=True) if "512" in line)
    text = REFERENCE_DBC.replace("BO_ 256 ", f"{messages}\nBO_ 256 ", 1).replace("VAL_ 130 ", f"{notes}VAL_ 130 ", 1)
    (folder / "reference.dbc").write_text(text, encoding="utf-8")
    database = load_database(load_profile(folder / "reference.toml"))
    assert [message.can_id for message in database.sample] == [272, 273, 274]
    assert not [finding for finding in check_file(folder / "reference.toml") if finding.severity == ERROR]


def test_the_parts_of_a_message_with_odd_names_have_these_names(tmp_path: Path) -> None:
    signals = ' SG_ 2MUX M : 0|8@1+ (1,0) [0|1] "" GW\n SG_ BO_ m1 : 8|8@1+ (1,0) [0|255] "" GW\n'
    file = read_dbc(write(tmp_path / "odd.dbc", Oddity(f"BO_ 512 2017_5: 2 2ECU\n{signals}", 'VAL_ 512 BO_ 3 "A" ;\n')))
    codec = MessageCodec(find(file, "2017_5"))
    assert codec.names == ("2MUX", "BO_")
    assert codec.decode(bytes([1, 3])) == (1, 3)
    assert file.lines["2017_5.BO_"] == file.lines["2017_5"] + 2


def test_long_names_are_those_of_the_attributes(tmp_path: Path) -> None:
    signals = ' SG_ MUX_0001 M : 0|8@1+ (1,0) [0|1] "" GW\n SG_ PART_0001 m1 : 8|8@1+ (1,0) [0|255] "" GW\n'
    notes = (
        'BA_DEF_ BO_ "SystemMessageLongSymbol" STRING ;\nBA_ "SystemMessageLongSymbol" BO_ 512 "FEEDBACK_FRONT_LEFT";\n'
    )
    notes += 'BA_ "SystemSignalLongSymbol" SG_ 512 MUX_0001 "MULTIPLEXER";\n'
    notes += 'BA_ "SystemSignalLongSymbol" SG_ 512 PART_0001 "PART_OF_LEFT";\nVAL_ 512 PART_0001 3 "A" ;\n'
    file = read_dbc(write(tmp_path / "long.dbc", Oddity(f"BO_ 512 FEEDBACK_0001: 2 ECU\n{signals}", notes)))
    assert not file.findings
    message = find(file, "FEEDBACK_FRONT_LEFT")
    assert MessageCodec(message).names == ("MULTIPLEXER", "PART_OF_LEFT")
    assert MessageCodec(message).decode(bytes([1, 3])) == (1, 3)
    assert message.get_signal_by_name("PART_OF_LEFT").choices == {3: "A"}
    assert file.lines["FEEDBACK_FRONT_LEFT.PART_OF_LEFT"] == file.lines["FEEDBACK_FRONT_LEFT"] + 2


def test_extended_ids_without_the_flag_are_extended_in_all_messages(tmp_path: Path) -> None:
    notes = 'VAL_ 316495015 S 0 "A" ;\nBA_ "GenMsgCycleTime" BO_ 316495015 20;\nSIG_VALTYPE_ 316495015 F : 1;\n'
    odd = f'{ODD.replace("512", "316495015")} SG_ F : 32|32@1- (1,0) [0|0] "" GW\n'
    message = find(read_dbc(write(tmp_path / "odd.dbc", Oddity(odd, notes))), "ODD")
    assert (message.frame_id, message.is_extended_frame, message.cycle_time) == (316495015, True, 20)
    assert message.get_signal_by_name("S").choices == {0: "A"}
    assert message.get_signal_by_name("F").is_float


MULTIPLEXED = (
    'BO_ 512 ODD: 8 ECU\n SG_ MUX M : 0|8@1+ (1,0) [0|255] "" GW\n SG_ WIDE M : 8|32@1+ (1,0) [0|0] "" GW\n'
    ' SG_ S m0 : 40|8@1+ (1,0) [0|255] "" GW\n'
)


@pytest.mark.parametrize(
    ("ranges", "text"),
    [
        ("MUX 0-4294967295", ""),
        ("MUX 1-3, 5-9999999", ""),
        ("WIDE 0-4294967295", ""),
        ("WIDE 0-4000000000", "ODD.S: is there for 4000000001 values of WIDE; must be 1 to 4096, or all"),
        ("MUX 256-300", "ODD.S: is there for 0 values of MUX"),
        ("OTHER 0-1", "ODD.S: is multiplexed, but no SG_MUL_VAL_ says by which of 2 multiplexers"),
    ],
)
def test_wide_ranges_of_a_multiplexer_are_not_counted_out(tmp_path: Path, ranges: str, text: str) -> None:
    file = read_dbc(write(tmp_path / "odd.dbc", Oddity(MULTIPLEXED, f"SG_MUL_VAL_ 512 S {ranges};\n")))
    check_sound(file)
    assert [one.text.startswith(text) for one in file.findings] == [True] * bool(text)
    names = MessageCodec(find(file, "ODD")).names
    assert names == (("MUX", "WIDE") if text else ("MUX", "WIDE", "S"))


def test_signals_that_depend_on_one_another_are_left_out(tmp_path: Path) -> None:
    signals = ' SG_ A m0M : 0|8@1+ (1,0) [0|1] "" GW\n SG_ B m0M : 8|8@1+ (1,0) [0|1] "" GW\n'
    notes = "SG_MUL_VAL_ 512 A B 0-0;\nSG_MUL_VAL_ 512 B A 0-0;\n"
    file = read_dbc(write(tmp_path / "odd.dbc", Oddity(f"BO_ 512 ODD: 8 ECU\n{signals}", notes)))
    assert [one.text for one in file.findings] == ["ODD.A: depends on itself", "ODD.B: depends on itself"]
    assert find(file, "ODD").signals == []


@pytest.mark.parametrize("stated", ["15", '"ExtendedCAN_FD"', '"15"'])
def test_a_frame_format_is_understood_by_number_and_by_name(tmp_path: Path, stated: str) -> None:
    notes = f'BA_DEF_ BO_ "VFrameFormat" INT 0 15;\nBA_ "VFrameFormat" BO_ 512 {stated};\n'
    file = read_dbc(write(tmp_path / "odd.dbc", Oddity(ODD, notes)))
    assert not file.findings
    assert find(file, "ODD").is_fd
    check_sound(file)


FOREIGN = 'BO_ 1008 HUD: 2 VEHICLE\n SG_ A : 0|8@1+ (1,0) [0|255] "" X\n SG_ B : 4|4@1+ (1,0) [0|15] "" X\n\n'


@pytest.fixture
def profile_path(tmp_path: Path) -> Path:
    """The reference vehicle's profile, beside a DBC with ten faulty messages that it does not use."""
    more = "".join(FOREIGN.replace("1008 HUD", f"{1008 + index} HUD{index}") for index in range(10))
    (tmp_path / "reference.dbc").write_text(REFERENCE_DBC.replace("BO_ 256 ", f"{more}BO_ 256 ", 1))
    (tmp_path / "reference.toml").write_text((DBC_FOLDER / "reference.toml").read_text(encoding="utf-8"))
    return tmp_path / "reference.toml"


def test_many_faults_of_one_kind_in_messages_that_are_not_used_are_one_warning(profile_path: Path) -> None:
    (warning,) = check_file(profile_path)
    line = line_of(profile_path.with_suffix(".dbc"), "SG_ B : 4")
    assert (warning.severity, warning.line) == (WARNING, line)
    examples = ", ".join(f"HUD{index}.B (line {line + 4 * index})" for index in range(3))
    assert warning.text == f"overlapping signals: 10 times; first: {examples}"
    load_database(load_profile(profile_path))


def test_faults_of_used_messages_are_never_summed_up(tmp_path: Path) -> None:
    text = REFERENCE_DBC.replace('BA_ "GenMsgCycleTime"', '// BA_ "GenMsgCycleTime"')
    (tmp_path / "reference.dbc").write_text(text)
    (tmp_path / "reference.toml").write_text((DBC_FOLDER / "reference.toml").read_text(encoding="utf-8"))
    without_cycle = [one.text for one in check_file(tmp_path / "reference.toml") if "no cycle time" in one.text]
    assert len(without_cycle) == 8
    (summary,) = (one.text for one in check_file(tmp_path / "reference.dbc") if "no cycle time" in one.text)
    assert summary.startswith("no cycle time: 8 times; first: DRIVE_COMMAND (line ")


@pytest.mark.parametrize(
    ("old", "new", "is_used"),
    [
        (" SG_ FAULT_CODE : 48|8", " SG_ FAULT_CODE : 60|8", False),
        (" SG_ MODE : 16|3", " SG_ MODE : 70|3", True),
        (" SG_ HORN : 20|1", " SG_ HORN : 70|1", True),
    ],
)
def test_a_fault_of_a_received_signal_only_matters_where_the_signal_is_used(
    tmp_path: Path, old: str, new: str, is_used: bool
) -> None:
    toml = (DBC_FOLDER / "reference.toml").read_text(encoding="utf-8")
    for line in ('fault_code = "VEHICLE_STATUS.FAULT_CODE"\n', 'horn = "BODY_COMMAND.HORN"\n'):
        toml = toml.replace(line, "")
    toml = toml.replace("ignored = []", 'ignored = ["VEHICLE_STATUS.FAULT_CODE"]')
    (tmp_path / "reference.toml").write_text(toml)
    (tmp_path / "reference.dbc").write_text(REFERENCE_DBC.replace(old, new, 1))
    text = f"{new.split()[1]}: bits {new.split()[3]} do not fit into 8 bytes"
    assert [one.severity for one in check_file(tmp_path / "reference.toml") if text in one.text] == [
        ERROR if is_used else WARNING
    ]


def test_an_unknown_statement_leaves_the_message_above_it_intact(tmp_path: Path) -> None:
    statement = "SIG_MAXIMUM_ 512 S 5;"
    path = tmp_path / "reference.dbc"
    path.write_text(re.sub(r"(BO_ 272 POSE.*?\n)\n", rf"\1{statement}\n\n", REFERENCE_DBC, count=1, flags=re.DOTALL))
    assert statement in path.read_text()
    (tmp_path / "reference.toml").write_text((DBC_FOLDER / "reference.toml").read_text(encoding="utf-8"))
    assert load_database(load_profile(tmp_path / "reference.toml")).sample[0].name == "POSE"
    found = [(one.severity, one.line) for one in check_file(tmp_path / "reference.toml") if "SIG_MAXIMUM_" in one.text]
    assert found == [(WARNING, line_of(path, statement))]


@pytest.mark.parametrize("damaged", ["SGG_ EXTRA : 40|8@1+ (1,0) [0|1]", "40|8@1+ (1,0)"])
def test_a_damaged_signal_of_a_used_message_stays_an_error(tmp_path: Path, damaged: str) -> None:
    text = re.sub(r"(BO_ 272 POSE.*?\n)\n", rf"\1 {damaged}\n\n", REFERENCE_DBC, count=1, flags=re.DOTALL)
    (tmp_path / "reference.dbc").write_text(text)
    (tmp_path / "reference.toml").write_text((DBC_FOLDER / "reference.toml").read_text(encoding="utf-8"))
    with pytest.raises(ConfigError, match="POSE: was not understood"):
        load_database(load_profile(tmp_path / "reference.toml"))


def test_a_file_may_end_without_a_line_end(tmp_path: Path) -> None:
    path = tmp_path / "odd.dbc"
    path.write_text(HEAD + SOUND.rstrip("\n"))
    assert find(read_dbc(path), "SOUND").signals[0].unit == "m/s"
    assert not read_dbc(path).findings


def test_a_file_of_unsound_messages_only_is_refused_with_all_of_them(tmp_path: Path) -> None:
    path = tmp_path / "odd.dbc"
    path.write_text(f"{HEAD}BO_ 1 A 8\nBO_ 2 B 8\n")
    with pytest.raises(ConfigError) as refused:
        read_dbc(path)
    places = [line.partition(": ")[0] for line in str(refused.value).splitlines()]
    assert places == ["odd.dbc:12", "odd.dbc:13", "odd.dbc"]


def test_a_log_is_decoded_by_the_sound_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "ODD.DBC", ODDITIES["an id twice"])
    log = tmp_path / "one.log"
    log.write_text("(1.000000) can0 100#1027000000000000\n(1.000000) can0 200#0500000000000000\n")
    arguments = ["decode", str(log), "--dbc", str(path), "--out", str(tmp_path / "out.npz")]
    assert cli.main(arguments) == 0
    said = capsys.readouterr()
    assert "SOUND: 1 frames" in said.out
    assert "ODD" not in said.out
    assert "EVEN: id 512 is already in line" in said.err
    assert cli.main([*arguments, "--message", "ODD"]) == 0
    assert "ODD: 1 frames" in capsys.readouterr().out
