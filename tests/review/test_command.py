"""`vehicle-iface review`: its exit status, text, JSON and page."""

import json
import re
from pathlib import Path

import pytest

from tests.review.drives import note, record_noisily, review, write_log
from vehicle_iface import cli

WRONG = note("MOTION.SPEED", 'unit = "km/h"')


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A noisy drive along a figure of eight."""
    return write_log(tmp_path_factory.mktemp("log") / "drive.log", record_noisily("figure8"))


def test_a_sound_profile_ends_in_status_0(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["review", str(log), "--profile", "reference"]) == 0
    assert "nothing contradicts the profile; " in capsys.readouterr().out


def test_a_contradiction_ends_in_status_1_and_is_in_text_json_and_page(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    review(tmp_path, record_noisily("figure8"), WRONG)  # writes the profile
    page, numbers = tmp_path / "review.html", tmp_path / "review.json"
    options = ["--profile", str(tmp_path / "profile.toml"), "--html", str(page), "--json", str(numbers)]
    assert cli.main(["review", str(log), *options]) == 1
    sentence = "MOTION.SPEED is in m/s, not in km/h"
    assert f"contradiction: {sentence}" in capsys.readouterr().out
    document = json.loads(numbers.read_text())
    assert [one["text"] for one in document["findings"] if one["level"] == "contradiction"] == [sentence]
    distance = next(one for one in document["relations"] if one["key"] == "distance")
    assert distance["slope"] == pytest.approx(3.6 / 1.015, rel=0.02)
    speed = next(one for one in document["bindings"] if one["field"] == "speed_mps")
    assert (speed["signal"], speed["verdict"]) == ("MOTION.SPEED", "contradicted")
    assert {one["name"]: one["period_ms"] for one in document["messages"]}["POSE"] == pytest.approx(10.0)
    assert sentence in page.read_text()


def test_the_page_has_a_plot_of_each_relation_and_needs_nothing_from_elsewhere(log: Path, tmp_path: Path) -> None:
    page = tmp_path / "review.html"
    assert cli.main(["review", str(log), "--profile", "reference", "--html", str(page)]) == 0
    text = page.read_text()
    relations = set(re.findall(r'<a href="#(\w+)">', text))
    assert relations == set(re.findall(r'<figure id="(\w+)">', text))
    assert len(relations) == 9
    assert text.count("<svg viewBox") == 2 * (len(relations) + 1)
    assert re.findall(r"<script|<link|<img|url\(|https?://|@import", text) == []
    assert "nan" not in text.lower()


@pytest.mark.parametrize("count", [1, 2, 5, 40, 300])
def test_of_a_short_log_nothing_is_claimed(tmp_path: Path, count: int, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "drive.log", record_noisily("figure8")[:count])
    cli.main(["review", str(log), "--profile", "reference", "--html", str(tmp_path / "review.html")])
    said = capsys.readouterr().out.splitlines()
    assert all(line.endswith("in this log") for line in said if line.startswith("contradiction: ")), said


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nothing.log", "--profile", "reference"], "nothing.log: cannot be read"),
        (["{log}", "--profile", "reference", "--channel", "can7"], "--channel can7: must be one of"),
        (["{log}", "--profile", "docs/examples/06_own_vehicle/rover.toml"], "no frame of the profile's messages"),
        (["{log}", "--profile", "reference", "--html", "/nowhere/x.html"], "--html /nowhere/x.html: cannot be written"),
    ],
)
def test_a_log_that_cannot_be_reviewed_ends_with_status_2_and_a_hint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    log = write_log(tmp_path / "drive.log", record_noisily("figure8")[:200])
    assert cli.main(["review", *(one.format(log=log) for one in arguments)]) == 2
    assert complaint in capsys.readouterr().err


def test_frames_on_two_channels_need_a_choice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "drive.log", record_noisily("figure8")[:400])
    text = log.read_text()
    log.write_text(text + text.replace(" can0 ", " can1 "))
    assert cli.main(["review", str(log), "--profile", "reference"]) == 2
    assert "--channel can0 (400 frames), --channel can1 (400 frames)" in capsys.readouterr().err
    assert cli.main(["review", str(log), "--profile", "reference", "--channel", "can1"]) == 0
