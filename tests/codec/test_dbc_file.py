"""A DBC that is not whole is refused with file and line, and so is a file that is none."""

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface.codec.database import load_database
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile

from .conftest import DBC_FOLDER, REFERENCE_DBC, Variant, line_of


def test_all_faults_of_a_dbc_are_reported_at_once(variant: Variant) -> None:
    edits = (("BO_ 273 MOTION", "BO_ 272 MOTION"), ("[-6.5536|6.5534]", "[6.5|-6.5]"))
    with pytest.raises(ConfigError) as refused:
        variant(dbc=edits)
    assert str(refused.value).splitlines() == [
        f"reference.dbc:{line_of('BO_ 273')}: MOTION: id 272 is already in line {line_of('BO_ 272')}, of POSE",
        f"reference.dbc:{line_of('SG_ YAW_RATE')}: MOTION.YAW_RATE: range [6.5|-6.5] has swapped ends",
    ]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(REFERENCE_DBC.rstrip("; \n")) - 1))
def test_a_dbc_cut_short_anywhere_is_refused(tmp_path_factory: pytest.TempPathFactory, end: int) -> None:
    folder = tmp_path_factory.mktemp("cut")
    (folder / "reference.toml").write_text((DBC_FOLDER / "reference.toml").read_text(encoding="utf-8"))
    for ending in ("", "\n"):
        (folder / "reference.dbc").write_text(REFERENCE_DBC[:end] + ending)
        with pytest.raises(ConfigError, match=r"^reference\.(dbc|toml):"):
            load_database(load_profile(folder / "reference.toml"))


def test_a_dbc_that_ends_in_the_middle_of_a_statement_is_refused_although_nothing_in_use_is_missing(
    tmp_path: Path,
) -> None:
    (tmp_path / "cut.dbc").write_text(REFERENCE_DBC + '\nCM_ "the rest of the fi')
    with pytest.raises(ConfigError, match=r"cut\.dbc:\d+: the file ends in the middle of this statement"):
        read_dbc(tmp_path / "cut.dbc")


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", r"bad\.dbc:1: the file is empty"),
        (b"\n\n", "the file is empty"),
        (REFERENCE_DBC.encode("utf-16"), "NUL byte"),
        (b'VERSION ""\n\x81\n', r"bad\.dbc:2: byte 0x81"),
        (b"\x89PNG\r\n\x1a\n" + bytes(8), "NUL byte"),
        (b"PK nonsense\n", r"bad\.dbc"),
        (b'VERSION "\n', "no message in it"),
        (b'VERSION ""\n', "no message in it"),
        (REFERENCE_DBC.encode()[:3000], "middle of this statement"),
    ],
)
def test_a_file_that_is_not_a_dbc_is_refused(tmp_path: Path, data: bytes, text: str) -> None:
    path = tmp_path / "bad.dbc"
    path.write_bytes(data)
    with pytest.raises(ConfigError, match=text):
        read_dbc(path)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200) | st.text(alphabet='BO_SG:|@+-()[]" \n0123456789M', max_size=200).map(str.encode))
def test_garbage_raises_nothing_but_our_error(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.mktemp("garbage") / "bad.dbc"
    path.write_bytes(data)
    with pytest.raises(ConfigError):
        read_dbc(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.dbc: cannot be read: No such file"):
        read_dbc(tmp_path / "none.dbc")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_units_are_read_in_both_encodings(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "units.dbc"
    path.write_bytes(REFERENCE_DBC.replace('"m/s^2"', '"m/s²"').encode(encoding))
    message = read_dbc(path).messages["CHASSIS"]
    assert message.get_signal_by_name("ACCEL").unit == "m/s²"


def test_keywords_inside_a_comment_are_text(tmp_path: Path) -> None:
    path = tmp_path / "comment.dbc"
    comment = 'CM_ BO_ 273 "first\nBO_ 273 MOTION: 8 VEHICLE\n SG_ X : said \\"so\\"";\n'
    path.write_text(REFERENCE_DBC.replace("CM_ BO_ 273 ", comment + "CM_ BO_ 274 ", 1))
    said = read_dbc(path).messages["MOTION"].comment
    assert said is not None
    assert "first" in said


def test_lines_are_those_of_an_editor() -> None:
    file = read_dbc(DBC_FOLDER / "reference.dbc")
    for dotted, line in file.lines.items():
        name = dotted.rpartition(".")[2]
        assert re.search(rf"\b{name}\b", REFERENCE_DBC.splitlines()[line - 1])
