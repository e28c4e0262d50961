"""Two drives side by side: the table, and the data of the page in both alignments."""

from pathlib import Path

import numpy as np
import pytest

from tests.export.recorded import Recorded, record_drive
from tests.export.unpacked import curve, read_page, unpack
from tests.harness import Drive
from vehicle_iface.cli import main
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import Snapshot


def wait_before_driving(drive: Drive) -> None:
    """The vehicle is ready only after a second."""
    now_s = round(drive.now_s, 1)
    if now_s in (0.1, 1.5):
        drive.send_line(f"brake {int(now_s == 0.1)}")


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[Recorded]:
    home = tmp_path_factory.mktemp("both")
    return [
        record_drive(home, 4.0, name="first"),
        record_drive(home, 5.0, name="second", act=wait_before_driving),
        record_drive(home, 1.0, name="other", route="circle"),
    ]


def engaged_s(shown: list[Snapshot]) -> float:
    begin = next(one for one in shown if one.controller_state == ControllerState.ENGAGED)
    return (begin.published_ns - shown[0].published_ns) / 1e9


def test_the_table_has_the_figures_of_both(drives: list[Recorded], capsys: pytest.CaptureFixture[str]) -> None:
    folders = [str(drive.folder) for drive in drives[:2]]
    assert main(["compare", *folders]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split() == folders
    values = {line[:33].strip(): line[33:].split() for line in lines}
    assert values["Commands"] == [f"{drive.driven.loop.summary().commands:,}" for drive in drives[:2]]
    assert values["Stops"] == ["none", "none"]


def test_both_are_aligned_by_the_beginning_of_driving_and_by_way(drives: list[Recorded], tmp_path: Path) -> None:
    first, second = drives[:2]
    assert main(["compare", str(first.folder), str(second.folder), "--html", str(tmp_path / "b.html")]) == 0
    page = read_page(tmp_path / "b.html")
    assert engaged_s(second.shown) > engaged_s(first.shown) + 0.5
    for number, drive in enumerate((first, second)):
        assert unpack(page.drives[number].time)[0] == pytest.approx(-engaged_s(drive.shown), abs=1e-4)
    ways = [unpack(one.way) for one in page.drives if one.way is not None]
    speeds = [curve(page, "speed_mps", number) for number in range(2)]
    for way_m in (1.0, 3.0):
        there = [float(np.interp(way_m, way, speed)) for way, speed in zip(ways, speeds, strict=True)]
        assert there[0] == pytest.approx(there[1], abs=0.05)
    assert {one.color for plot in page.plots for one in plot.curves} == {"drive-a", "drive-b"}


def test_drives_on_other_paths_are_said_to_be_so(drives: list[Recorded], tmp_path: Path) -> None:
    far = record_drive(tmp_path, 1.0, name="far", start_x_m=100.0)
    assert main(["compare", str(drives[2].folder), str(far.folder), "--html", str(tmp_path / "b.html")]) == 0
    assert "Neither drive begins on" in (tmp_path / "b.html").read_text()


@pytest.mark.parametrize(("arguments", "said"), [(["x"], "not a recording"), (["--html", "NOWHERE/x"], "cannot be")])
def test_bad_usage_is_refused(
    drives: list[Recorded], arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(drives[0].folder), *([] if arguments == ["x"] else [str(drives[1].folder)]), *arguments]
    assert main(["compare", *given]) == 2
    assert said in capsys.readouterr().err
