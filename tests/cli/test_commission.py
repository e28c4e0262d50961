"""`commission` on its command line: what it asks, what it ends with, and when it writes into the profile."""

import json
import os
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.commission.walks import BEGINS, DeafBus, Person, write_profile
from tests.harness import START_NS, Clock, reference
from tests.review.drives import note
from vehicle_iface import cli
from vehicle_iface.arming import report_review
from vehicle_iface.cli import commission as command
from vehicle_iface.commission.readings import Moment
from vehicle_iface.commission.report import Commissioning
from vehicle_iface.commission.steps import Step
from vehicle_iface.commission.walk import StepResult
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.status import VehicleMode

WHEEL = "CHASSIS.FRONT_WHEEL_ANGLE"


class PersonAtTerminal(Person):
    """Does what the terminal asks."""

    terminal: command.TerminalPresenter

    def begin(self, step: Step, number: int, count: int) -> None:
        self.terminal.begin(step, number, count)
        super().begin(step, number, count)

    def show(self, step: Step, moment: Moment) -> None:
        self.terminal.show(step, moment)
        super().show(step, moment)

    def end(self, result: StepResult) -> None:
        self.terminal.end(result)


@pytest.fixture(autouse=True)
def vehicle(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Clock:
    """The bus of every command here, in simulated time, with a person who does what is asked."""
    clock = Clock()
    car = simulated_vehicle(reference(), start_ns=START_NS, mode=VehicleMode.MANUAL)
    bus = DeafBus(car, clock.now_ns, clock.sleep_until)
    walk_and_review = command.walk_and_review

    def walk(*arguments: object, **options: object) -> Commissioning:
        binding, listener, presenter, record = arguments
        assert isinstance(presenter, command.TerminalPresenter)
        person = PersonAtTerminal(car)
        person.terminal = presenter
        person.ends = presenter.wants_to_end
        return walk_and_review(binding, listener, person, record, **options, now_ns=clock.now_ns)  # type: ignore[arg-type]

    monkeypatch.setattr(command, "walk_and_review", walk)
    monkeypatch.setattr(command, "open_buses", lambda *_, **__: bus)
    monkeypatch.chdir(tmp_path)
    return clock


def commission(profile: Path | str, *options: str) -> int:
    return cli.main(["commission", "--channel", "can0", "--profile", str(profile), "--step-timeout", "12", *options])


def test_a_sound_walk_succeeds_and_writes_only_on_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    profile = write_profile(tmp_path)
    before = profile.read_text(encoding="utf-8")
    assert commission(profile) == 0
    shown = capsys.readouterr()
    assert "2/12  Turn the wheel left and hold it there.\n" in shown.out
    assert f"     seen: {WHEEL} rises by 0.11 rad when the wheel is turned left\n" in shown.out
    assert "\x1b" not in shown.out  # no terminal: nothing is shown in place
    assert shown.out.endswith("writes reviewed = true and the record of the walk into the profile\n")
    assert "nothing is sent" in shown.err
    assert profile.read_text(encoding="utf-8") == before
    assert len(list(tmp_path.glob("reference-walk-*.log"))) == 1


def test_a_walk_on_a_virtual_bus_is_never_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    profile = write_profile(tmp_path)
    before = profile.read_text(encoding="utf-8")
    words = ["commission", "--channel", "vcan0", "--profile", str(profile), "--step-timeout", "12", "--write"]
    assert cli.main(words) == 0
    assert "not written: vcan0: a walk on a virtual bus proves nothing about the vehicle" in capsys.readouterr().out
    assert profile.read_text(encoding="utf-8") == before


def test_with_write_the_record_fits_log_profile_and_dbc(tmp_path: Path) -> None:
    profile = write_profile(tmp_path)
    page, numbers = tmp_path / "report.html", tmp_path / "report.json"
    assert commission(profile, "--write", "--record", "w.log", "--out", str(page), "--json", str(numbers)) == 0
    read = load_profile(profile)
    assert read.reviewed
    assert read.review is not None
    assert read.review.log == "w.log"
    assert len(read.review.checks) == len(BEGINS)
    report = report_review(read)
    assert report.changes == ()
    assert "12 checks (w.log, SHA-256 " in report.text
    document = json.loads(numbers.read_text())
    assert (document["is_sound"], document["is_written"]) == (True, True)
    assert document["log_sha256"] == read.review.log_sha256
    assert [step["verdict"] for step in document["steps"]] == ["seen"] * 12
    assert document["review"]["contradictions"] == 0
    html = page.read_text(encoding="utf-8")
    assert "All 12 steps were seen, and nothing contradicts the profile" in html
    assert read.review.log_sha256 in html
    assert "<h2>Relations</h2>" in html


def test_a_contradiction_ends_in_status_1_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profile = write_profile(tmp_path, note(WHEEL, "scale = -1.0"))
    page = tmp_path / "report.html"
    assert commission(profile, "--write", "--out", str(page)) == 1
    text = f"{WHEEL} falls when the wheel is turned left: its sign is reversed"
    assert f"contradiction: {text}" in capsys.readouterr().out
    assert text in page.read_text(encoding="utf-8")
    assert tomllib.loads(profile.read_text(encoding="utf-8"))["reviewed"] is False


def test_a_step_that_is_not_seen_ends_in_status_5_and_writes_nothing(tmp_path: Path) -> None:
    profile = write_profile(tmp_path)
    assert cli.main(["commission", "--profile", str(profile), "--step-timeout", "0.5", "--write"]) == 5
    assert load_profile(profile).review is None


def test_a_profile_of_the_package_is_refused_before_the_walk_with_write_and_after_it_without(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert commission("reference", "--write") == 2
    shown = capsys.readouterr()
    assert (shown.out, list(tmp_path.iterdir())) == ("", [])
    assert "reference.toml: is part of vehicle-iface and not written; copy it and its DBC" in shown.err
    assert commission("reference") == 0
    assert "not written: " in capsys.readouterr().out


def test_a_profile_that_changes_during_the_walk_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    profile = write_profile(tmp_path)
    confirm: Callable[[str], bool] = lambda _: bool(  # noqa: E731
        profile.write_text(profile.read_text(encoding="utf-8").replace("length_m = 4.6", "length_m = 4.7"))
    )
    monkeypatch.setattr(command, "_confirm", confirm)
    assert commission(profile) == 2
    assert "profile.toml: changed during the walk, nothing was written; walk again" in capsys.readouterr().err
    assert load_profile(profile).review is None


@pytest.mark.parametrize(("answer", "is_written"), [("y\n", True), ("\n", False), ("", False)])
def test_on_a_terminal_it_prompts_and_enter_means_no(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str, is_written: bool
) -> None:
    asked: list[str] = []

    class Terminal:
        def isatty(self) -> bool:
            return bool(asked)  # not yet while it walks: nothing is pressed then

        def readline(self) -> str:
            return answer

    def say(text: str, *, end: str = "\n") -> None:  # noqa: ARG001
        if "all 12 steps were seen" in text or "[y/N]" in text:
            asked.append(text)

    monkeypatch.setattr(command, "print_safely", say)
    monkeypatch.setattr("sys.stdin", Terminal())
    profile = write_profile(tmp_path)
    assert commission(profile) == 0
    assert asked[-1].startswith(f"Write reviewed = true and the record of this walk into {profile}? [y/N]")
    assert load_profile(profile).reviewed is is_written


def test_enter_skips_a_step_and_the_end_of_input_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    with open(reader, encoding="utf-8") as keys:
        monkeypatch.setattr(keys, "isatty", lambda: True, raising=False)
        monkeypatch.setattr("sys.stdin", keys)
        presenter = command.TerminalPresenter(is_ended=lambda: False)
        assert not presenter.wants_to_skip()
        os.write(writer, b"\n")
        assert presenter.wants_to_skip()
        assert not presenter.wants_to_skip()
        os.close(writer)
        assert not presenter.wants_to_skip()
        assert not presenter.wants_to_skip()


def test_on_a_terminal_what_is_seen_stands_on_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "60")
    assert commission(write_profile(tmp_path)) == 0
    out = capsys.readouterr().out
    parts = [part.partition("\n")[0] for part in out.split("\r\x1b[2K")[1:]]
    assert any("front_wheel_angle_rad +0.11 rad (left positive)" in part for part in parts)
    in_place = [part for part in parts if "seen:" not in part]
    assert max(map(len, in_place)) <= 59


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--interface", "embedded"], "nobody can move that vehicle; for a try use vehicle-iface sim"),
        (["--out", "/nowhere/x.html"], "--out /nowhere/x.html: cannot be written"),
        (["--json", "/nowhere/x.json"], "--json /nowhere/x.json: cannot be written"),
        (["--record", "/nowhere/x.log"], "--record /nowhere/x.log: cannot be written"),
    ],
)
def test_an_impossible_walk_is_refused_before_it_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], complaint: str
) -> None:
    assert commission(write_profile(tmp_path), *options) == 2
    shown = capsys.readouterr()
    assert (complaint in shown.err, shown.out) == (True, ""), shown.err
