"""The result of one case, by what was observed."""

from collections.abc import Sequence

import msgspec

from hil_bench import figures, judges, plots
from hil_bench.bench_config import BenchConfig
from hil_bench.case import Case
from hil_bench.drive_pages import is_shown
from hil_bench.expect import Observation, check_measured, measure
from hil_bench.peer.build import examine
from hil_bench.result import CaseResult, Check, Event, Verdict
from hil_bench.rig import Rig
from hil_bench.routes import Route
from hil_bench.steps import Stretch
from hil_bench.violations import find_violations, mark_overdue


def judge_case(
    config: BenchConfig,
    case: Case,
    rig: Rig,
    route: Route,
    killed: list[str],
    stretches: Sequence[Stretch] = (),
    repetition: int = 1,
) -> CaseResult:
    """The result of what was observed."""
    record = examine(rig.wire, rig.judged_frames())
    frames = rig.device_frames()
    observed = Observation(
        begin_ns=rig.begin_ns,
        inject_ns=rig.inject_ns,
        end_ns=rig.end_ns or rig.then_ns,
        then_ns=rig.then_ns,
        samples_ns=[sample.stamp_ns for sample in record.samples],
        pairs=record.pairs,
        decoded=[one for one in record.decoded if one.name in rig.wire.of_device],
        told=[one for one in record.decoded if one.name not in rig.wire.of_device],
        frames=frames,
        history=rig.vehicle.history,
        exit_status=rig.exit_status,
        exit_ns=rig.exit_ns,
        route=route,
        wire=rig.wire,
        armed_ns=rig.armed_ns,
        said=rig.said(),
    )
    before = judges.check_alive(case, observed, rig) + judges.check_preparation(case, observed, rig)
    events: list[Event] = []
    expected: list[Check] = []
    for expectation in () if case.inject is not None and not observed.inject_ns else case.see:
        one, at = expectation.judge(observed)
        expected.append(one)
        events += at
        events += mark_overdue(one, observed.at_s(observed.inject_ns)) if observed.inject_ns else []
    measured = measure(case.measure, observed)
    for stretch in stretches:
        found = stretch.judge(observed)
        expected, events, measured = expected + found.checks, events + found.events, measured + found.measured
    expected += map(check_measured, measured)
    on_path, drawn = judges.check_path(case, route, rig.vehicle.history)
    answers, distributions = judges.check_answers(case, record, observed, rig)
    memory = list[Check]()
    if not is_shown(config, case):  # a recorder may keep the last seconds, and grows until it has them
        memory = judges.check_memory(rig.watch.memory, rig.commands_ns, rig.wire.period_s)
    protocol = judges.check_protocol(case, rig, record, observed)
    after = judges.check_health(case, observed, rig, killed)
    failed = judges.Failed(
        start=_failed(before) if rig.is_not_engaged_in_time else (),
        state=_failed(after if rig.is_not_engaged_in_time else [*before, *after]),
        expected=_failed(expected),
        others=_failed(on_path),
        content=_failed(memory),
        answers=_failed(answers),
        protocol=_failed(protocol),
    )
    verdict, why = judges.decide(failed, rig.lateness, record)
    checks = [*before, *expected, *on_path, *answers, *memory, *protocol, *after]
    events += find_violations(checks)
    return msgspec.structs.replace(
        unjudged_result(config, case, repetition, why, verdict),
        lateness=rig.lateness.describe(),
        checks=checks,
        events=figures.order_timeline(case, rig, observed, events),
        measured=measured,
        distributions=distributions,
        plots=plots.draw_plots(rig.wire, observed, case.max_path_error_m),
        strips=plots.draw_strips(rig.wire, observed),
        path=drawn,
        counts=figures.count(record, rig, frames),
    )


def unjudged_result(
    config: BenchConfig, case: Case, repetition: int, why: str, verdict: Verdict = Verdict.NOT_EXECUTED
) -> CaseResult:
    """A result without checks: the case's own data, and the reason."""
    return CaseResult(
        name=case.name,
        proves=case.proves,
        fault=case.fault,
        tags=list(case.tags),
        verdict=verdict,
        why=why,
        evidence=config.evidence,
        repetition=repetition,
        seed=config.seed + repetition - 1,
        injected=case.injected,
    )


def _failed(checks: list[Check]) -> list[Check]:
    return [one for one in checks if one.verdict is Verdict.FAIL]
