"""Which drives keep their stops, and where."""

from pathlib import Path

import pytest

from vehicle_iface.cli import recording
from vehicle_iface.cli.parser import build_parser
from vehicle_iface.recorder.black_box import default_place


@pytest.fixture
def is_real(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "is_virtual", lambda _, channel: channel != "can0")


@pytest.mark.usefixtures("is_real")
@pytest.mark.parametrize(
    ("channel", "options", "place"),
    [
        ("can0", ["--arm"], str(default_place())),
        ("can0", [], ""),
        ("vcan0", ["--arm"], ""),
        ("vcan0", ["--black-box", "boxes"], "boxes"),
        ("vcan0", ["--record", "drive"], str(Path("drive/events"))),
        ("vcan0", ["--record", "drive", "--black-box", "boxes"], "boxes"),
        ("can0", ["--arm", "--no-black-box"], ""),
        ("can0", ["--arm", "--record", "drive", "--no-black-box"], ""),
    ],
)
def test_the_place_of_the_black_boxes(channel: str, options: list[str], place: str) -> None:
    given = build_parser().parse_args(["run", "--route", "circle", *options])
    assert recording.find_black_box(given, {"": channel}) == place


def test_a_place_and_none_at_all_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        build_parser().parse_args(["run", "--route", "circle", "--black-box", "x", "--no-black-box"])
    assert "not allowed with" in capsys.readouterr().err
