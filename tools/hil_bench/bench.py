"""A run of the bench: selects cases, executes one after the other, and collects their results."""

import datetime
import itertools
import logging
import os
import re
import shutil
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

import msgspec

from hil_bench import result as results
from hil_bench import run_case
from hil_bench.applicable import adapt, find_inapplicable
from hil_bench.bench_config import BenchConfig
from hil_bench.beside import Crew
from hil_bench.bus import is_virtual
from hil_bench.buses import open_bus
from hil_bench.case import Case, Need
from hil_bench.cases import CATALOGUE
from hil_bench.device import Commands
from hil_bench.errors import RigError, UnexpectedNodeError
from hil_bench.fault_rows import list_fault_rows
from hil_bench.journal import Journal
from hil_bench.judge_case import unjudged_result
from hil_bench.priority import realtime_priority
from hil_bench.profile import ProfileError
from hil_bench.result import CaseResult, Run, Verdict
from hil_bench.surroundings import environment
from hil_bench.wire import Wire

log = logging.getLogger(__name__)
LISTEN_S = 1.0
ATTEMPTS = 3
"""Attempts at a case during which the bench itself was late."""


class BenchError(Exception):
    """The bench cannot start, and why."""


class ProgressListener(Protocol):
    """Is informed of the progress of a run."""

    def on_run_start(self, total: int) -> None: ...
    def on_case_start(self, name: str, proves: str) -> None: ...
    def on_case_end(self, case: CaseResult) -> None: ...
    def on_run_end(self, run: Run) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The cases of a run."""

    config: BenchConfig
    cases: Sequence[Case]
    repeat: int = 1
    route: str = ""
    """The route of a device that is already running."""
    catalogue: Sequence[Case] = CATALOGUE
    """All cases of the vehicle, for the coverage."""
    beside: Sequence[str] = ()
    """Further interfaces, on which cases are executed at the same time."""
    is_strict: bool = False
    """A case that is not executed counts as a failure."""
    until_failure: bool = False
    """End after the first case that fails."""
    journal: Journal | None = None
    """Holds the results of an earlier part of the run, and each new one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Early:
    """What was found on several interfaces at once, by case and repetition."""

    results: Mapping[tuple[str, int], CaseResult]
    repeated: frozenset[tuple[str, int]]
    """Executed beside other cases without a result that stands."""
    interrupted: str


def select_cases(
    names: Iterable[str], tags: Iterable[str], *, quick: bool, catalogue: Sequence[Case] = CATALOGUE
) -> list[Case]:
    """Cases by name and by tag, in the catalogue's order; all, if none is named. Raises `BenchError`."""
    names, tags = set(names), set(tags) | ({"quick"} if quick else set())
    unknown = names - {case.name for case in catalogue} | tags - {tag for case in catalogue for tag in case.tags}
    if unknown:
        raise BenchError(f"no such case or tag: {', '.join(sorted(unknown))}; --list names them all")
    if not names and not tags:
        return list(catalogue)
    return [case for case in catalogue if case.name in names or tags & set(case.tags)]


def observe_traffic(channels: Sequence[str], wire: Wire, *, is_device_running: bool = False) -> list[str]:
    """What is on the bus before the bench sends: a moving vehicle, and identifiers with their rates.

    A device that is already running may send lights and reports, but no commands.
    Raises `OSError` when the interface cannot be used.
    """
    bus = open_bus(channels, wire, everything=True)
    counts: dict[tuple[int, int], int] = {}
    moving = ""
    try:
        end = time.monotonic() + LISTEN_S
        while time.monotonic() < end:
            for rx in bus.drain():
                if is_device_running and wire.name_of(rx.frame) in wire.reports:
                    continue
                seen = rx.frame.bus, rx.frame.can_id
                counts[seen] = counts.get(seen, 0) + 1
                decoded = wire.intact(rx.frame)
                if decoded is not None and abs(decoded.signals.get("SPEED", 0.0)) > 0.05:
                    moving = f"{decoded.name} reports {decoded['SPEED']:.2f} m/s"
            time.sleep(0.01)
    finally:
        bus.close()
    on = [f" on {name}" if len(wire.buses) > 1 else "" for name in wire.buses]
    found = [
        f"0x{can_id:03X}{on[number]} {count / LISTEN_S:.0f} times a second"
        for (number, can_id), count in sorted(counts.items())
    ]
    return ([moving] if moving else []) + found


def run(plan: Plan, listener: ProgressListener) -> Run:
    """Execute every case of the plan. A case that needs something missing is not executed, with that reason.

    Results that the journal has are kept. `KeyboardInterrupt` in a case ends the run: it keeps its results so far,
    lists the rest as NOT EXECUTED, and never passes.
    """
    began, begin_s = datetime.datetime.now().astimezone(), time.monotonic()
    config, journal = plan.config, plan.journal
    config.folder.mkdir(parents=True, exist_ok=True)
    begin_s -= journal.elapsed_s if journal else 0.0
    done, interrupted = _execute_all(plan, listener, begin_s)
    header = journal.header if journal else None
    report = Run(
        verdict=results.verdict_of(done, interrupted=interrupted),
        interrupted=interrupted,
        evidence=config.evidence,
        began=header.began if header else began.isoformat(timespec="seconds"),
        duration_s=round(time.monotonic() - begin_s, 1),
        command=" ".join(sys.argv),
        channel=config.described_channels,
        profile=config.wire.name,
        profile_hash=config.wire.hash,
        device=config.commands.start or "already running, not started by the bench",
        device_version=header.device.version if header else "",
        device_hash=header.device.hash if header else "",
        seed=config.seed,
        environment=environment(config.channels, config.described_channels),
        faults=list_fault_rows(plan.catalogue),
        cases=done,
    )
    if plan.is_strict:
        report = results.judge_strictly(report)
    listener.on_run_end(report)
    return report


def _execute_all(plan: Plan, listener: ProgressListener, begin_s: float) -> tuple[list[CaseResult], str]:
    """The result of every case, and in which case the run was interrupted."""
    with closing(_open_crew(plan)) as crew:
        listener.on_run_start(len(plan.cases) * plan.repeat)
        early = _execute_beside(plan, crew, listener, begin_s)
    with realtime_priority():
        return _execute_in_turn(plan, listener, begin_s, early)


def _execute_in_turn(
    plan: Plan, listener: ProgressListener, begin_s: float, early: _Early
) -> tuple[list[CaseResult], str]:
    """The cases that are not among the earlier results, one after the other."""
    config, journal = plan.config, plan.journal
    done: list[CaseResult] = []
    total = len(plan.cases) * plan.repeat
    unexpected_node, interrupted = "", early.interrupted
    for case, repetition in itertools.product(plan.cases, range(1, plan.repeat + 1)):
        kept = journal.find(case.name, repetition) if journal else None
        if kept:
            listener.on_case_end(kept)
        kept = kept or early.results.get((case.name, repetition))
        if kept:
            done.append(kept)
            continue
        if interrupted:
            done.append(unjudged_result(config, case, repetition, interrupted))
            continue
        listener.on_case_start(case.name, case.proves)
        at_s = round(time.monotonic() - begin_s, 2)
        try:
            found = (
                unjudged_result(config, case, repetition, unexpected_node)
                if unexpected_node
                else _execute(config, case, repetition, plan.route)
            )
        except UnexpectedNodeError as error:
            unexpected_node = f"the bench stopped sending: {error}"
            found = unjudged_result(config, case, repetition, unexpected_node, Verdict.FAIL)
        except KeyboardInterrupt:
            interrupted = f"interrupted in case {len(done) + 1} of {total}"
            found = unjudged_result(config, case, repetition, interrupted)
        if (case.name, repetition) in early.repeated:
            found = msgspec.structs.replace(found, counts=found.counts | {"attempts beside other cases": 1})
        done.append(_with_paths(found, config.folder.name, at_s))
        if journal:
            journal.add(done[-1])
        listener.on_case_end(done[-1])
        if plan.until_failure and done[-1].verdict is Verdict.FAIL:
            break
    return done, interrupted


def _open_crew(plan: Plan) -> Crew:
    """The processes for cases that are executed at the same time."""
    journal, channels = plan.journal, (plan.config.channel, *plan.beside)
    tasks = [
        (case, repetition)
        for case, repetition in itertools.product(plan.cases, range(1, plan.repeat + 1))
        if not (journal and journal.find(case.name, repetition))
    ]
    is_wanted = plan.beside and not plan.until_failure
    return Crew(
        plan.config,
        channels if is_wanted else (),
        tasks,
        lambda config, case, repetition: _execute(config, case, repetition, plan.route),
    )


def _execute_beside(plan: Plan, crew: Crew, listener: ProgressListener, begin_s: float) -> _Early:
    found: dict[tuple[str, int], CaseResult] = {}
    interrupted = ""
    try:
        for case, one in crew.results(lambda case: listener.on_case_start(case.name, case.proves)):
            at_s = round(max(0.0, time.monotonic() - begin_s - one.duration_s), 2)
            found[case.name, one.repetition] = done = _with_paths(one, plan.config.folder.name, at_s)
            if plan.journal:
                plan.journal.add(done)
            listener.on_case_end(done)
    except KeyboardInterrupt:
        interrupted = f"interrupted after {len(found)} of {len(plan.cases) * plan.repeat} cases"
    return _Early(results=found, repeated=frozenset(crew.unsettled), interrupted=interrupted)


def _execute(config: BenchConfig, case: Case, repetition: int, route: str) -> CaseResult:
    case = adapt(case, config.wire)
    why = find_inapplicable(case, config.wire)
    if why:
        return unjudged_result(config, case, repetition, why, Verdict.NOT_APPLICABLE)
    why = missing_needs(case, config.commands, config.channel, route, config.further_channels)
    if why:
        return unjudged_result(config, case, repetition, why)
    void: list[str] = []
    while True:
        try:
            found = run_case.run(config, case, repetition)
        except UnexpectedNodeError:
            raise
        except (RigError, ProfileError, OSError) as error:
            return unjudged_result(config, case, repetition, f"the bench could not continue: {error}")
        except Exception as error:  # one case's error must not cost the results of all others
            log.exception("%s: an internal error of the bench", case.name)
            return unjudged_result(config, case, repetition, f"an internal error of the bench: {error!r}")
        if found.verdict is not Verdict.NOT_EXECUTED or len(void) == ATTEMPTS - 1:
            return msgspec.structs.replace(found, void=void, counts=found.counts | {"attempts": len(void) + 1})
        void.append(found.lateness)


def missing_needs(
    case: Case, commands: Commands, channel: str, route: str = "", further_channels: Sequence[str] = ()
) -> str:
    """Why a case cannot be executed here; empty if it can."""
    have = {
        Need.OWN_PROCESS: commands.is_ours,
        Need.START: bool(commands.start),
        Need.REARM: bool(commands.rearm) or commands.is_ours,
        Need.VIRTUAL: all(map(is_virtual, (channel, *further_channels))),
        Need.ROOT: os.geteuid() == 0,
        Need.VXCAN: is_virtual(channel) and _has("tc") and _has("ip"),
    }
    lacking = [need.value for need in case.needs if not have[need]]
    lacking += [
        f"a device that is started with {{{word}}}"
        for word, is_needed in (("profile", case.profile), ("trajectory", case.breaks), ("channel", case.channel))
        if is_needed and commands.start and not {f"{{{word}}}", f"{{{word}s}}"} & _placeholders(commands.start)
    ]
    if commands.start and not case.armed and not commands.listen:
        lacking.append("a way to start the device without arming it (--listen-device)")
    if commands.start and case.recorded_mib and "{record}" not in commands.record:
        lacking.append("a way to start the device so that it records its drive in {record} (--recording-device)")
    if commands.start and case.viewed and "{port}" not in commands.view:
        lacking.append("a viewer of the device that serves {port} (--viewer)")
    if not commands.start and (case.breaks or case.profile or case.setup):
        lacking.append(Need.START.value)
    if not commands.start and not lacking and case.route().name != route:
        lacking.append(f"a device that drives the route {case.route().name} (--write-routes, --route)")
    return f"needs {'; '.join(lacking)}" if lacking else ""


def _placeholders(template: str) -> set[str]:
    return set(re.findall(r"\{\w+\}", template))


def _with_paths(found: CaseResult, folder: str, at_s: float) -> CaseResult:
    return msgspec.structs.replace(
        found,
        began_s=at_s,
        candump=found.candump and f"{folder}/{found.candump}",
        device_log=found.device_log and f"{folder}/{found.device_log}",
        recording=found.recording and f"{folder}/{found.recording}",
    )


def _has(program: str) -> bool:
    return shutil.which(program, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin") is not None
