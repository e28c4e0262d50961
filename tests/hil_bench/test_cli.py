"""The bench's command line."""

import json
import re
from pathlib import Path

import pytest
from hil_bench import cli
from hil_bench.cases import catalogue_for
from scenes import WIRE

ROOT = Path(__file__).resolve().parents[2]


def test_bad_command_lines_are_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "index.html").write_text("")
    for arguments, why in (
        (["--channel", "vcan9", "--out", str(tmp_path / "old")], "is not empty"),
        (["--channel", "vcan9", "--out", str(tmp_path / "new"), "--case", "no-such"], "no such case or tag: no-such"),
        (["--channel", "vcan9", "--out", str(tmp_path / "new"), "--compare", "no.json"], "--compare no.json"),
        (["--out", str(tmp_path / "new")], "--channel and --out"),
        (["--channel", "vcan9", "--out", str(tmp_path / "new"), "--device", "sh -c 'x"], "--device: No closing quot"),
        (["--channel", "vcan9", "--out", str(tmp_path / "new"), "--rearm", "x ${A}"], "--rearm: {A} is not known"),
    ):
        assert cli.main(arguments) == cli.BAD_USAGE
        assert why in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        (["--chanel", "vcan9"], "hil-bench: unrecognized arguments: --chanel vcan9; did you mean --channel?"),
        (["--repeat", "0"], "hil-bench: argument --repeat: 0: must be a number above 0; see hil-bench --help"),
    ],
)
def test_a_mistake_on_the_command_line_is_reported_in_one_line(
    wrong: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(wrong)
    assert end.value.code == cli.BAD_USAGE
    assert capsys.readouterr().err == f"{line}\n"


def test_every_option_of_the_guide_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    known = set(re.findall(r"--[a-z][a-z-]+", capsys.readouterr().out))
    used = set(re.findall(r"--[a-z][a-z-]+", (ROOT / "docs" / "bench.md").read_text(encoding="utf-8")))
    of_the_controllers = {"--arm", "--trajectory", "--speed-cap", "--show"}
    assert of_the_controllers < used
    assert used <= known | of_the_controllers


def test_the_list_names_every_case_and_what_it_proves(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--list", "--json"]) == cli.PASSED
    listed = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in listed] == [case.name for case in catalogue_for(WIRE)]
    assert cli.main(["--list"]) == cli.PASSED
    text = capsys.readouterr().out
    assert all(case.name in text and case.proves in text for case in catalogue_for(WIRE))
