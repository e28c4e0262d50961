"""`vehicle-iface new-profile`: where the draft goes, and what is never overwritten."""

import tomllib
from pathlib import Path

import pytest

from tests.cli.test_commands import refusal
from vehicle_iface import cli

DBC = Path(__file__).resolve().parents[2] / "dbc" / "reference.dbc"


def test_without_out_the_draft_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["new-profile", str(DBC)]) == 0
    assert tomllib.loads(capsys.readouterr().out)["state"]["sample"] == ["POSE", "MOTION", "CHASSIS"]


def test_out_writes_the_draft_and_prints_the_next_step(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.toml"
    assert cli.main(["new-profile", str(DBC), "--out", str(out)]) == 0
    assert tomllib.loads(out.read_text("utf-8"))["name"] == "mine"
    shown = capsys.readouterr().out
    counts = f"{out}: 34 fields bound, 0 to choose, numbers to fill in"
    assert shown == f"{counts}; next: complete each TODO, then vehicle-iface check-dbc {out}\n"
    assert cli.main(["check-dbc", str(out)]) == 2


def test_a_file_that_exists_is_overwritten_only_with_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.toml"
    out.write_text("precious")
    assert "exists already; --force overwrites it" in refusal(capsys, "new-profile", str(DBC), "--out", str(out))
    assert out.read_text() == "precious"
    assert cli.main(["new-profile", str(DBC), "--out", str(out), "--force"]) == 0
    assert out.read_text("utf-8").startswith("# A first draft")


def test_a_file_that_cannot_be_written_or_read_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "none" / "mine.toml"
    assert f"--out {out}: cannot be written" in refusal(capsys, "new-profile", str(DBC), "--out", str(out))
    assert "cannot be read" in refusal(capsys, "new-profile", str(tmp_path / "no.dbc"))
