"""Pages of recorded drives: each is written by the given command, and a command that fails says why."""

import sys
from pathlib import Path

import example_run
import msgspec
import pytest
from hil_bench import cli
from hil_bench.bench_config import BenchConfig
from hil_bench.cases import CATALOGUE
from hil_bench.device import OWN_EXPORT, Commands
from hil_bench.drive_pages import is_shown, write_pages
from hil_bench.peer.build import open_wire
from hil_bench.report import html
from hil_bench.result import Run

COPY = (
    f"{sys.executable} -c \"import shutil, sys; shutil.copy(sys.argv[1] + '/drive', sys.argv[2])\" {{record}} {{page}}"
)


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """A run of one case with a recording and one without."""
    first, second = example_run.run().cases[:2]
    (tmp_path / "cases" / "a.recording").mkdir(parents=True)
    (tmp_path / "cases" / "a.recording" / "drive").write_text("the drive")
    return example_run.run_of([msgspec.structs.replace(first, recording="cases/a.recording"), second])


def test_the_report_links_the_page_of_a_recorded_drive(run: Run, tmp_path: Path) -> None:
    written = write_pages(run, tmp_path, COPY)
    assert [case.page for case in written.cases] == ["cases/a.html", ""]
    assert (tmp_path / "cases" / "a.html").read_text() == "the drive"
    assert 'the drive on a page: <a href="./cases/a.html">' in html.write(written, tmp_path).read_text()


@pytest.mark.parametrize(
    ("command", "why"),
    [
        (f"{sys.executable} -c \"import sys; sys.exit('no such drive')\"", "exit status 1: no such drive"),
        (f"{sys.executable} -c pass", "wrote no cases/a.html"),
        ("/nowhere/export", "No such file or directory: '/nowhere/export'"),
    ],
)
def test_without_a_page_the_report_links_the_reason(run: Run, tmp_path: Path, command: str, why: str) -> None:
    written = write_pages(run, tmp_path, command)
    assert written.cases[0].page == "cases/a.page.log"
    assert why in (tmp_path / "cases" / "a.page.log").read_text()
    assert (
        'why there is no page of the drive: <a href="./cases/a.page.log">' in html.write(written, tmp_path).read_text()
    )


def test_without_a_command_and_after_an_interruption_nothing_is_written(run: Run, tmp_path: Path) -> None:
    assert write_pages(run, tmp_path, "") is run
    interrupted = msgspec.structs.replace(run, interrupted="in the second case")
    assert write_pages(interrupted, tmp_path, COPY) is interrupted


@pytest.mark.parametrize(("command", "shown"), [("", False), (OWN_EXPORT, True)])
def test_only_drives_without_a_fault_are_shown_and_only_with_a_command(
    tmp_path: Path, command: str, shown: bool
) -> None:
    commands = Commands(export=command)
    config = BenchConfig(
        wire=open_wire("reference"), channel="vcan9", commands=commands, folder=tmp_path, profile="reference"
    )
    cases = {case.name: case for case in CATALOGUE}
    assert is_shown(config, cases["drive-u-turn"]) is shown
    assert not any(is_shown(config, case) for case in CATALOGUE if case.recorded_mib or "process" in case.tags)


def test_a_device_that_cannot_record_has_no_pages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--channel", "vcan0", "--out", str(tmp_path / "r"), "--device", "my-controller", "--export", "x"]
    assert cli.main(given) == cli.BAD_USAGE
    assert (
        "--export requires a device that records its drive in {record}: --recording-device" in capsys.readouterr().err
    )
