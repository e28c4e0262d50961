"""Cases on several interfaces at the same time: nothing is lost, and what the computer can explain is no result."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from hil_bench import bench, run_case
from hil_bench.bench_config import BenchConfig
from hil_bench.beside import Crew, is_settled, must_run_alone
from hil_bench.case import Case
from hil_bench.cases import CATALOGUE
from hil_bench.cases.state import STATE
from hil_bench.device import Commands
from hil_bench.judge_case import unjudged_result
from hil_bench.judges import KINDS
from hil_bench.result import CaseResult, Check, Run, Verdict
from scenes import WIRE

CASES = STATE[:6]
NEWS = ("on_run_start", "on_case_start", "on_case_end", "on_run_end")
CHANNELS = ("vcan8", "vcan9")


def config_of(folder: Path) -> BenchConfig:
    return BenchConfig(wire=WIRE, channel="vcan8", commands=Commands(), folder=folder / "cases", profile="reference")


def passed(config: BenchConfig, case: Case, repetition: int) -> CaseResult:
    """Says on which interface, in the place of a reason."""
    time.sleep(0.02)
    return unjudged_result(config, case, repetition, config.channel, Verdict.PASS)


@contextmanager
def crew_of(folder: Path, execute: Callable[[BenchConfig, Case, int], CaseResult]) -> Iterator[Crew]:
    tasks = [(case, repetition) for case in CASES for repetition in (1, 2)]
    with closing(Crew(config_of(folder), CHANNELS, tasks, execute)) as crew:
        yield crew


def nothing(_: Case) -> None:
    pass


def test_every_interface_executes_cases_and_each_case_is_executed_once(tmp_path: Path) -> None:
    started: list[str] = []
    with crew_of(tmp_path, passed) as crew:
        found = [one for _, one in crew.results(lambda case: started.append(case.name))]
    assert sorted((one.name, one.repetition) for one in found) == sorted((c.name, n) for c in CASES for n in (1, 2))
    assert {one.why for one in found} == set(CHANNELS)
    assert len(started) == len(found)


def test_a_process_that_dies_leaves_its_case_to_be_executed_alone(tmp_path: Path) -> None:
    def execute(config: BenchConfig, case: Case, repetition: int) -> CaseResult:
        if case is CASES[2]:
            os._exit(9)
        return passed(config, case, repetition)

    with crew_of(tmp_path, execute) as crew:
        found = {one.name for _, one in crew.results(nothing)}
    assert CASES[2].name not in found
    assert {CASES[0].name, CASES[1].name} <= found


def test_an_interrupted_run_interrupts_the_cases_of_every_process(tmp_path: Path) -> None:
    def interrupted(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupted)

    def execute(config: BenchConfig, case: Case, repetition: int) -> CaseResult:
        (tmp_path / f"{config.channel}-began").touch()
        try:
            time.sleep(60.0)
        finally:
            (tmp_path / f"{config.channel}-cleaned-up").touch()
        return passed(config, case, repetition)

    try:
        with crew_of(tmp_path, execute) as crew:
            for worker in crew._workers:
                worker.send(0)
            while len(list(tmp_path.glob("*-began"))) < 2:
                time.sleep(0.01)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert {path.name for path in tmp_path.glob("*-cleaned-up")} == {f"{name}-cleaned-up" for name in CHANNELS}


def test_cases_that_would_disturb_others_are_executed_alone() -> None:
    alone = {case.name for case in CATALOGUE if must_run_alone(case)}
    assert {"latency-at-0-percent-load", "wall-clock-ahead-10-s", "flood-of-unknown-frames"} <= alone
    assert all(case.name in alone for case in CATALOGUE if case.on_vxcan or case.profile)
    assert {"state-lost", "driver-brakes", "link-down", "killed"}.isdisjoint(alone)
    assert len(alone) < len(CATALOGUE) / 2


def with_finding(text: str, found: str) -> CaseResult:
    one = passed(config_of(Path()), CASES[0], 1)
    failed = Check(text=text, verdict=Verdict.FAIL, found=[found])
    return msgspec.structs.replace(one, verdict=Verdict.FAIL, checks=[failed])


def test_only_what_the_computer_cannot_explain_fails_beside_other_cases() -> None:
    assert not is_settled(with_finding("a stop within 150 ms", "212 ms, more than 150 ms"))
    assert not is_settled(with_finding(KINDS["unanswered"], "sample at 5.5 s"))
    assert is_settled(with_finding(KINDS["command"], "5.5 s: 0.66 rad"))
    not_executed = msgspec.structs.replace(with_finding("", ""), verdict=Verdict.NOT_EXECUTED)
    assert not is_settled(not_executed)


def test_a_late_finding_beside_other_cases_is_judged_by_the_case_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(config: BenchConfig, case: Case, repetition: int) -> CaseResult:
        if case is CASES[1] and os.getpid() != here:
            return with_finding("a stop within 150 ms", "212 ms, more than 150 ms")
        return passed(config, case, repetition)

    here = os.getpid()
    monkeypatch.setattr(run_case, "run", run)
    plan = bench.Plan(config=config_of(tmp_path), cases=CASES, beside=("vcan9",))
    found: Run = bench.run(plan, SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert [case.name for case in found.cases] == [case.name for case in CASES]
    assert found.verdict is Verdict.PASS
    assert found.cases[1].why == "vcan8"  # alone, on the first interface
    assert ["attempts beside other cases" in case.counts for case in found.cases] == [False, True, *[False] * 4]
