"""An interrupted run is continued: what was executed is kept, if it is about the same device and profile."""

import sys
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from hil_bench import bench, cli, identity, journal, options, result, resume, run_case
from hil_bench.bench_config import BenchConfig
from hil_bench.case import Case
from hil_bench.cases.files import FILES
from hil_bench.device import Commands
from hil_bench.judge_case import unjudged_result
from hil_bench.report import html
from hil_bench.result import CaseResult, Run, Verdict
from scenes import WIRE

NEWS = ("on_run_start", "on_case_start", "on_case_end", "on_run_end")
DEVICE = identity.Device(command="my-loop", version="1.2", hash="a" * 64)
CASES = FILES[:4]
PASSES, STOPS = Verdict.PASS, KeyboardInterrupt


def header(**other: object) -> journal.Header:
    base = journal.Header(
        arguments=["--seed", "3"],
        folder="/",
        began="2026-11-22T07:12:09+00:00",
        device=DEVICE,
        bench_hash="b" * 64,
        profile="reference",
        profile_hash="c" * 64,
        seed=3,
        channel="vcan9",
    )
    return msgspec.structs.replace(base, **other)


class Runner:
    """Runs a plan whose cases end as they are told, and counts them."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.executed = folder, list[str]()
        self.config = BenchConfig(
            wire=WIRE, channel="vcan9", commands=Commands(), folder=folder / "cases", profile="reference", seed=3
        )
        self.ends: dict[str, Verdict | type[BaseException]] = {}
        monkeypatch.setattr(run_case, "run", self._run_case)

    def run(self, written: journal.Journal) -> Run:
        plan = bench.Plan(config=self.config, cases=CASES, journal=written)
        return bench.run(plan, SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))

    def _run_case(self, config: BenchConfig, case: Case, repetition: int) -> CaseResult:
        self.executed.append(case.name)
        end = self.ends.get(case.name, PASSES)
        if not isinstance(end, Verdict):
            raise end
        return unjudged_result(config, case, repetition, "", end)


@pytest.fixture
def runner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Runner:
    return Runner(tmp_path / "report", monkeypatch)


def test_a_continued_run_executes_only_what_is_missing(runner: Runner) -> None:
    runner.ends = {CASES[0].name: Verdict.FAIL, CASES[1].name: Verdict.NOT_EXECUTED, CASES[2].name: STOPS}
    first = runner.run(journal.Journal.begin(runner.folder, header()))
    assert [case.verdict for case in first.cases] == [Verdict.FAIL, *[Verdict.NOT_EXECUTED] * 3]
    runner.ends, runner.executed = {}, []
    second = runner.run(journal.Journal.resume(runner.folder, header(began="2027-01-01T00:00:00+00:00")))
    assert runner.executed == [case.name for case in CASES[1:]]
    assert [case.verdict for case in second.cases] == [Verdict.FAIL, PASSES, PASSES, PASSES]
    assert second.cases[0] == first.cases[0]
    assert (second.interrupted, second.verdict) == ("", Verdict.FAIL)
    assert second.began == "2026-11-22T07:12:09+00:00"
    assert (second.device_version, second.device_hash) == ("1.2", "a" * 64)


def test_results_survive_a_bench_that_is_killed_while_it_writes(runner: Runner) -> None:
    written = journal.Journal.begin(runner.folder, header())
    runner.ends = {CASES[2].name: STOPS}
    runner.run(written)
    with open(runner.folder / journal.NAME, "ab") as file:
        file.write(b'{"name": "half of a li')
    kept = journal.read_journal(runner.folder)[1]
    assert [case.name for case in kept] == [case.name for case in CASES[:3]]


def test_a_complete_run_leaves_nothing_to_be_continued(runner: Runner) -> None:
    runner.run(journal.Journal.begin(runner.folder, header()))
    journal.remove_journal(runner.folder)
    with pytest.raises(journal.JournalError, match="holds no interrupted run"):
        journal.Journal.resume(runner.folder, header())


@pytest.mark.parametrize(
    ("other", "what"),
    [
        (header(seed=4), "the seed: 3 then, 4 now"),
        (header(profile_hash="d" * 64), "the profile's files"),
        (header(bench_hash="d" * 64), "the bench's files"),
        (header(channel="vcan8"), "the channel: vcan9 then, vcan8 now"),
        (header(device=msgspec.structs.replace(DEVICE, version="1.3")), "the device's version: 1.2 then, 1.3 now"),
        (header(device=msgspec.structs.replace(DEVICE, hash="")), "the device's files .*unknown now"),
    ],
)
def test_results_about_something_else_are_not_mixed(other: journal.Header, what: str, tmp_path: Path) -> None:
    journal.Journal.begin(tmp_path, header())
    with pytest.raises(journal.JournalError, match=what):
        journal.Journal.resume(tmp_path, other)


def test_the_options_of_the_interrupted_run_are_used_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    given = ["--channel", "vcan9", "--out", "report", "--repeat", "3", "--profile", "mine.toml"]
    journal.Journal.begin(tmp_path / "report", header(arguments=given, folder=str(tmp_path / "elsewhere")))
    parser = options.build_parser()
    restored = resume.restore_options(parser, parser.parse_args(["--resume", "report", "--strict"]))
    assert (restored.channel, restored.repeat, restored.profile, restored.strict) == (["vcan9"], 3, "mine.toml", True)
    assert restored.out == str(tmp_path / "report")
    assert Path.cwd() == tmp_path / "elsewhere"


def test_other_options_beside_resume_are_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal.Journal.begin(tmp_path, header())
    assert cli.main(["--resume", str(tmp_path), "--seed", "4", "--quick"]) == cli.BAD_USAGE
    assert "leave out --quick, --seed" in capsys.readouterr().err


def test_a_folder_with_an_interrupted_run_names_the_way_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal.Journal.begin(tmp_path, header())
    assert cli.main(["--channel", "vcan9", "--out", str(tmp_path)]) == cli.BAD_USAGE
    assert f"continue it with --resume {tmp_path}" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "{}\n", "not JSON\n", '{"format": 1}\n'])
def test_a_damaged_journal_is_rejected_by_its_name(text: str, tmp_path: Path) -> None:
    (tmp_path / journal.NAME).write_text(text)
    with pytest.raises(journal.JournalError, match=r"unfinished\.jsonl: cannot be read"):
        journal.read_journal(tmp_path)


def identified(command: str, version: str | None = None, *, is_here: bool = True) -> identity.Device:
    return identity.identify_device(Commands(start=command, is_here=is_here), version)


def test_a_device_is_identified_by_the_files_that_its_command_names(tmp_path: Path) -> None:
    loop = tmp_path / "loop.py"
    loop.write_text("print('1')")
    first = identified(f"python3 {loop} --channel {{channel}}", f"{sys.executable} -c 'print(\"mine 7\")'")
    loop.write_text("print('2')")
    second = identified(f"python3 {loop} --channel {{channel}}")
    assert (first.version, second.version) == ("mine 7", "")
    assert first.hash != second.hash
    assert len(first.hash) == len(second.hash) == 64
    assert identified(f"ssh bench2 {loop}", is_here=False).hash == ""


def test_a_package_is_identified_by_all_its_files() -> None:
    hashes = {identified(f"python3 -m {name} {{channel}}").hash for name in ("vehicle_iface", "hil_bench", "no_such")}
    assert len(hashes) == 3
    assert "" in hashes


@pytest.mark.parametrize("command", ["no-such-program --version", "false", "sh -c 'kill $$'"])
def test_a_device_without_a_version_has_none(command: str) -> None:
    assert identified("python3 x.py", command).version == ""


def test_an_interrupted_command_line_is_continued_to_a_complete_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [case.name for case in CASES]
    executed: list[str] = []

    def run(config: BenchConfig, case: Case, repetition: int) -> CaseResult:
        executed.append(case.name)
        if executed == names[:2]:
            raise KeyboardInterrupt
        return unjudged_result(config, case, repetition, "", Verdict.PASS)

    monkeypatch.setattr(run_case, "run", run)
    monkeypatch.setattr(bench, "observe_traffic", lambda *_, **__: [])
    monkeypatch.setattr(cli, "_turn_signals_into_interrupt", lambda: None)
    monkeypatch.chdir(tmp_path)
    chosen = [word for name in names for word in ("--case", name)]
    assert cli.main(["--channel", "vcan9", "--out", "report", *chosen]) == cli.INTERRUPTED
    assert "--resume report" in capsys.readouterr().err
    half = result.read(tmp_path / "report" / "results.json")
    assert [case.verdict for case in half.cases] == [PASSES, *[Verdict.NOT_EXECUTED] * 3]
    monkeypatch.setattr(bench, "observe_traffic", lambda *_, **__: ["0x080 100 times a second"])
    assert cli.main(["--resume", "report"]) == cli.BAD_USAGE
    assert "end the device that the interrupted run has left" in capsys.readouterr().err
    assert result.read(tmp_path / "report" / "results.json") == half
    monkeypatch.setattr(bench, "observe_traffic", lambda *_, **__: [])
    write = html.write
    monkeypatch.setattr(html, "write", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        cli.main(["--resume", "report"])
    monkeypatch.setattr(html, "write", write)
    assert cli.main(["--resume", "report"]) == cli.PASSED  # the results of a report that failed are kept
    assert executed == [*names[:2], *names[1:]]
    whole = result.read(tmp_path / "report" / "results.json")
    assert [(case.name, case.verdict) for case in whole.cases] == [(name, PASSES) for name in names]
    assert whole.began == half.began
    assert len(whole.faults) > 50
    assert not (tmp_path / "report" / journal.NAME).exists()
    assert cli.main(["--resume", "report"]) == cli.BAD_USAGE
