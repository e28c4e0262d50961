"""How late bench and host were is measured, and explains what it can explain: never the content of frames."""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest
from example_run import run_of
from hil_bench import bench, expect, judges, phases, result, run_case
from hil_bench.bench_config import BenchConfig
from hil_bench.case import Case
from hil_bench.device import Commands, Device
from hil_bench.judge_case import unjudged_result
from hil_bench.judges import Failed
from hil_bench.lateness import Delay, DeviceWatch, Lateness, Wait, Witness, sum_up
from hil_bench.report import formatting
from hil_bench.result import CaseResult, Check, Verdict
from scenes import WIRE, find_case, pair
from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import MS, S
from virtual_rig import VirtualRig, run_virtual

QUIET = Lateness()
LATE = Lateness(delays=[Delay(at_s=3.2, by_s=0.034, what="the bench was")])
KINDS = judges.KINDS


def decided(lateness: Lateness, record: Record | None = None, **failed: Sequence[Check]) -> Verdict:
    return judges.decide(Failed(**failed), lateness, record or Record())[0]


def answered(latencies_s: Sequence[float]) -> Record:
    """A record with answers that came so late."""
    return Record(answers=[(i * 10 * MS, pair(i / 100 + late_s)) for i, late_s in enumerate(latencies_s)])


def test_nothing_excuses_a_failure_while_bench_and_host_are_in_time() -> None:
    slow = expect.check("a stop within 150 ms", [], 0.160, 0.150)
    assert decided(QUIET, expected=[slow]) is Verdict.FAIL
    assert decided(LATE, expected=[slow]) is Verdict.NOT_EXECUTED
    assert decided(QUIET) is decided(LATE) is Verdict.PASS


@pytest.mark.parametrize(("measured_s", "verdict"), [(0.180, Verdict.NOT_EXECUTED), (0.190, Verdict.FAIL)])
def test_a_delay_of_34_ms_explains_no_more_than_34_ms(measured_s: float, verdict: Verdict) -> None:
    assert decided(LATE, expected=[expect.check("a stop within 150 ms", [], measured_s, 0.150)]) is verdict


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        ("3.250 s: ENABLE 1, stop, STATE_STALE", Verdict.NOT_EXECUTED),
        ("3.010 s: ENABLE 1, stop, STATE_STALE", Verdict.FAIL),
        ("7.500 s: ENABLE 1, NOMINAL", Verdict.FAIL),
        ("no such stop; other stops: none", Verdict.FAIL),
    ],
)
def test_a_delay_explains_what_was_found_soon_after_it(found: str, verdict: Verdict) -> None:
    assert decided(LATE, expected=[expect.check("drives on", [found])]) is verdict


def test_a_case_in_which_the_host_stood_still_or_the_device_could_not_drive_is_void_but_for_content() -> None:
    stop = expect.check("a stop within 150 ms", ["no such stop; other stops: none"])
    off_path = expect.check("stays near its path", ["it was never driven"])
    idle = expect.check("it drives at 2.5 m/s when the injection begins", ["it was not engaged"])
    still = Lateness(delays=[Delay(at_s=9.0, by_s=0.2, what="the bench was")])
    assert decided(still, expected=[stop], others=[off_path]) is Verdict.NOT_EXECUTED
    assert decided(LATE, expected=[stop], state=[idle]) is Verdict.NOT_EXECUTED
    assert decided(LATE, expected=[stop]) is decided(QUIET, state=[idle]) is Verdict.FAIL
    assert decided(still, protocol=[expect.check(KINDS["damaged"], ["STEER_COMMAND at 9.000 s"])]) is Verdict.FAIL


@pytest.mark.parametrize("kind", judges.CONTENT)
def test_no_delay_explains_the_content_of_frames(kind: str) -> None:
    wrong = expect.check(KINDS[kind], ["3.210 s: ENABLE 1 and 0 in one pair"])
    late = expect.check("a stop within 150 ms", [], 0.160, 0.150)
    assert decided(LATE, protocol=[wrong], expected=[late]) is Verdict.FAIL
    rates = [
        expect.check(KINDS["command"], ["3.210 s: wheels faster than 0.8 rad/s"]),
        expect.check(KINDS["dynamics"], ["3.210 s: a swerve at 8.00 m/s, wheels to 0.1000 rad"]),
    ]
    assert decided(LATE, protocol=rates) is Verdict.NOT_EXECUTED


def test_a_device_that_does_not_engage_in_time_fails_unless_the_host_was_late_while_it_started() -> None:
    idle = expect.check("it drives at 2.5 m/s when the injection begins", ["it was not engaged"])
    unanswered = expect.check(KINDS["unanswered"], ["a sample after 24.000 s"])
    off_path = expect.check("stays near its path", ["it was never driven"])

    damaged = expect.check(KINDS["damaged"], ["STEER_COMMAND at 24.000 s"])

    assert decided(LATE, start=[idle], others=[off_path], protocol=[unanswered]) is Verdict.NOT_EXECUTED
    assert decided(QUIET, start=[idle], others=[off_path], protocol=[unanswered]) is Verdict.FAIL
    assert decided(LATE, start=[idle], protocol=[damaged]) is Verdict.FAIL


@pytest.mark.parametrize(
    ("at_s", "verdict"), [(0.1, Verdict.NOT_EXECUTED), (None, Verdict.FAIL)], ids=["late", "in time"]
)
def test_lateness_before_the_first_command_explains_a_slow_start(
    at_s: float | None, verdict: Verdict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = VirtualRig.begin

    def begin_late(rig: VirtualRig) -> None:
        begin(rig)
        rig.late += [] if at_s is None else [Delay(at_s=at_s, by_s=0.034, what="the bench was")]

    monkeypatch.setattr(VirtualRig, "begin", begin_late)
    monkeypatch.setattr(phases, "ENGAGE_S", 0.52)  # it sends commands, and is not engaged yet
    found = run_virtual(find_case("position-jumps-once"), "reference", tmp_path)
    assert found.verdict is verdict, found.why


def test_the_verdict_names_the_delay_and_the_finding() -> None:
    slow = expect.check("a stop within 150 ms", [], 0.160, 0.150)
    _, why = judges.decide(Failed(expected=[slow]), LATE, Record())
    assert why.startswith("host too slow: the bench was 34 ms late at 3.200 s, which may explain the finding")
    assert "160.0 ms, more than 150 ms" in why


def test_jitter_is_excused_by_as_much_lateness_of_the_host_and_not_by_one_delay() -> None:
    shaken = answered([0.0005 + 0.005 * (i % 10) / 10 for i in range(500)])
    jitter = [expect.check("90 % of the answers come equally late", [], 0.0023, 0.002)]
    assert decided(LATE, shaken, answers=jitter) is Verdict.FAIL
    assert decided(Lateness(usual_s=0.0005), shaken, answers=jitter) is Verdict.FAIL
    assert decided(Lateness(usual_s=0.0015), shaken, answers=jitter) is Verdict.NOT_EXECUTED


def test_a_host_that_was_never_late_excuses_no_wrong_period_of_a_device_that_is_always_as_quick() -> None:
    uneven = expect.check(judges.KINDS["periods"], ["0.381 s: BODY_COMMAND every 146.5 ms"])
    assert decided(QUIET, answered([0.001] * 100), protocol=[uneven]) is Verdict.FAIL


def test_waits_and_wake_ups_that_took_too_long_are_delays() -> None:
    waits = [Wait(2 * S, 45 * MS, 0.1), Wait(3 * S, 12 * MS, 0.1)]
    records = [(4 * S, 26 * MS, 30 * MS), (5 * S, 2 * MS, 1 * MS)]
    found = sum_up(LATE.delays, waits, records, begin_ns=S, from_ns=S)
    assert [str(one) for one in found.delays] == [
        "the device got its processor 45 ms late at 1.000 s",
        "a process beside the device was 26 ms late at 3.000 s",
        "the bench was 34 ms late at 3.200 s",
    ]
    assert found.usual_s == pytest.approx(0.031 / 28)
    assert found.describe() == "the device got its processor 45 ms late at 1.000 s (3 delays)"
    assert sum_up((), waits, records, begin_ns=S, from_ns=6 * S).describe() == ""


def test_a_device_that_uses_the_processor_up_itself_has_no_excuse() -> None:
    waits = [Wait(2 * S, 45 * MS, 0.9)]
    assert not sum_up((), waits, [(2 * S, 60 * MS, 80 * MS)], begin_ns=S, from_ns=S).delays


def test_the_witness_notices_that_it_was_stopped() -> None:
    one = Witness()
    until = time.monotonic() + 20.0
    os.kill(one._process.pid, 19)
    time.sleep(0.1)
    os.kill(one._process.pid, 18)
    while one._output.seek(0, 2) < 48 and time.monotonic() < until:
        time.sleep(0.05)
    records = one.close()
    assert len(records) >= 2
    assert one.close() == []


def test_memory_and_waits_of_a_running_device_are_measured(tmp_path: Path) -> None:
    grows = "held = []\nimport time\nwhile True: held.append(bytearray(100_000)); time.sleep(0.001)"
    program = tmp_path / "grows.py"
    program.write_text(grows)
    device = Device(Commands(start=f"{sys.executable} {program}"), tmp_path / "log", {}, lambda _: None)
    watch = DeviceWatch(device.find_processes)
    device.start()
    try:
        now_ns, until = 100 * S, time.monotonic() + 20.0
        while len(watch.memory) < 2 or watch.memory[-1][1] < 2 * watch.memory[0][1]:
            assert time.monotonic() < until
            watch.look(now_ns)
            time.sleep(0.02)
            now_ns += S
        assert watch.waits
        assert all(wait.waited_ns >= 0 for wait in watch.waits)
    finally:
        watch.close()
        device.kill()
    assert DeviceWatch(device.find_processes).memory == []


def passed_at_last(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, verdicts: list[Verdict]) -> CaseResult:
    """A case that is executed with these verdicts, as often as the bench tries."""
    config = BenchConfig(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    left = iter(verdicts)

    def execute(config: BenchConfig, case: Case, repetition: int) -> CaseResult:
        found = unjudged_result(config, case, repetition, "", next(left))
        return msgspec.structs.replace(found, lateness=LATE.describe())

    monkeypatch.setattr(run_case, "run", execute)
    return bench._execute(config, Case(name="x", proves="x"), 1, "")


def test_a_case_that_passed_at_the_second_attempt_says_why(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    late, passed = Verdict.NOT_EXECUTED, Verdict.PASS
    found = passed_at_last(monkeypatch, tmp_path, [late, passed])
    assert (found.verdict, found.counts["attempts"]) == (passed, 2)
    assert formatting.attempt(found) == "second attempt: the bench was 34 ms late at 3.200 s"
    assert formatting.main_figure(found) == formatting.attempt(found)
    assert formatting.attempt(passed_at_last(monkeypatch, tmp_path, [passed])) == ""
    assert passed_at_last(monkeypatch, tmp_path, [late, late, late, passed]).verdict is late


def test_a_strict_run_in_which_a_case_was_not_executed_fails_in_every_report() -> None:
    cases = [msgspec.structs.replace(case, verdict=Verdict.PASS) for case in run_of([]).cases] + [
        CaseResult(name=str(v), proves="x", verdict=v, evidence=result.Evidence.VIRTUAL_BUS)
        for v in (Verdict.PASS, Verdict.NOT_EXECUTED)
    ]
    run = run_of(cases)
    assert run.verdict is Verdict.PASS
    assert result.judge_strictly(run).verdict is Verdict.FAIL
    assert result.judge_strictly(run_of(cases[:1])).verdict is Verdict.PASS
    stopped = msgspec.structs.replace(run, interrupted="interrupted in case 3 of 9", verdict=Verdict.NOT_EXECUTED)
    assert result.judge_strictly(stopped).verdict is Verdict.NOT_EXECUTED
