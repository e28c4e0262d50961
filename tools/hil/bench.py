"""The bench as a whole: which cases, on what, one after the other, into one folder."""

import datetime
import itertools
import logging
import os
import platform
import shutil
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Protocol

import msgspec

from hil import result as results
from hil import run_case
from hil.bus import Bus, is_virtual
from hil.case import Case, Need
from hil.cases import CATALOGUE
from hil.device import ROOT, Commands
from hil.result import CaseResult, Run, Verdict
from hil.rig import RigError, StrangerError
from hil.wire import ProfileError, Wire

log = logging.getLogger(__name__)
LISTEN_S = 1.0
ATTEMPTS = 3
"""At a case during which the bench itself was late."""
LIBRARIES = ("cantools", "msgspec", "numpy", "rich", "jinja2")


class BenchError(Exception):
    """The bench cannot begin, and why."""


class Audience(Protocol):
    """Whom the bench tells how far it is."""

    def begun(self, total: int) -> None: ...
    def case_begun(self, name: str, proves: str) -> None: ...
    def case_ended(self, case: CaseResult) -> None: ...
    def ended(self, run: Run) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a run is to do."""

    bench: run_case.Bench
    cases: Sequence[Case]
    repeat: int = 1
    route: str = ""
    """What a device that is there already drives."""


def chosen(names: Iterable[str], tags: Iterable[str], *, quick: bool) -> list[Case]:
    """Cases by name and by tag, in the catalogue's order; all, if none is named. Raises `BenchError`."""
    names, tags = set(names), set(tags) | ({"quick"} if quick else set())
    unknown = names - {case.name for case in CATALOGUE} | tags - {tag for case in CATALOGUE for tag in case.tags}
    if unknown:
        raise BenchError(f"no such case or tag: {', '.join(sorted(unknown))}; --list names them all")
    if not names and not tags:
        return list(CATALOGUE)
    return [case for case in CATALOGUE if case.name in names or tags & set(case.tags)]


def traffic(channel: str, wire: Wire, *, device_is_there: bool = False) -> list[str]:
    """What is on the bus before the bench says anything: identifiers with their rates, and a vehicle that moves.

    A device that is there already may show its lights and report, but command nobody.
    Raises `OSError` when the interface cannot be used.
    """
    bus = Bus(channel, None)
    counts: dict[int, int] = {}
    moving = ""
    try:
        end = time.monotonic() + LISTEN_S
        while time.monotonic() < end:
            for heard in bus.drain():
                if device_is_there and wire.names.get(heard.frame.can_id) in wire.reports:
                    continue
                counts[heard.frame.can_id] = counts.get(heard.frame.can_id, 0) + 1
                told = wire.intact(heard.frame)
                if told is not None and abs(told.signals.get("SPEED", 0.0)) > 0.05:
                    moving = f"{told.name} reports {told['SPEED']:.2f} m/s"
            time.sleep(0.01)
    finally:
        bus.close()
    found = [f"0x{can_id:03X} {count / LISTEN_S:.0f} times a second" for can_id, count in sorted(counts.items())]
    return ([moving] if moving else []) + found


def run(plan: Plan, audience: Audience) -> Run:
    """Every case of the plan; what a case lacks is its reason not to be executed.

    `KeyboardInterrupt` within a case ends the run: what was found until then is its result, and that it passed is not.
    """
    began, begin_s = datetime.datetime.now().astimezone(), time.monotonic()
    bench = plan.bench
    bench.folder.mkdir(parents=True, exist_ok=True)
    done: list[CaseResult] = []
    total = len(plan.cases) * plan.repeat
    audience.begun(total)
    _be_prompt()
    stranger = interrupted = ""
    for case, repetition in itertools.product(plan.cases, range(1, plan.repeat + 1)):
        audience.case_begun(case.name, case.proves)
        at_s = round(time.monotonic() - begin_s, 2)
        try:
            found = (
                run_case.unjudged(bench, case, repetition, stranger)
                if stranger
                else _executed(bench, case, repetition, plan.route)
            )
        except StrangerError as error:
            stranger = f"the bench has fallen silent: {error}"
            found = run_case.unjudged(bench, case, repetition, stranger, Verdict.FAIL)
        except KeyboardInterrupt:
            interrupted = f"interrupted in case {len(done) + 1} of {total}"
            found = run_case.unjudged(bench, case, repetition, interrupted)
        done.append(_located(found, bench.folder.name, at_s))
        audience.case_ended(done[-1])
        if interrupted:
            break
    report = Run(
        verdict=results.verdict_of(done, interrupted=interrupted),
        interrupted=interrupted,
        evidence=bench.evidence,
        began=began.isoformat(timespec="seconds"),
        duration_s=round(time.monotonic() - begin_s, 1),
        command=" ".join(sys.argv),
        channel=bench.channel,
        profile=bench.wire.name,
        profile_hash=bench.wire.hash,
        device=bench.commands.start or "there already, not started by the bench",
        seed=bench.seed,
        environment=environment(bench.channel),
        cases=done,
    )
    audience.ended(report)
    return report


def environment(channel: str) -> dict[str, str]:
    """Where the run was."""
    found = {
        "host": platform.node(),
        "kernel": platform.release(),
        "processors": str(os.cpu_count()),
        "interface": channel,
        "adapter": _adapter(channel),
        "python": platform.python_version(),
        "revision": _revision(),
    }
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def _executed(bench: run_case.Bench, case: Case, repetition: int, route: str) -> CaseResult:
    why = missing(case, bench.commands, bench.channel, route)
    if why:
        return run_case.unjudged(bench, case, repetition, why)
    for attempt in range(ATTEMPTS):
        try:
            found = run_case.run(bench, case, repetition)
        except StrangerError:
            raise
        except (RigError, ProfileError, OSError) as error:
            return run_case.unjudged(bench, case, repetition, f"the bench could not go on: {error}")
        except Exception as error:  # one case's mistake must not cost the results of all others
            log.exception("%s: a mistake of the bench's own", case.name)
            return run_case.unjudged(bench, case, repetition, f"a mistake of the bench's own: {error!r}")
        if found.verdict is not Verdict.NOT_EXECUTED or attempt == ATTEMPTS - 1:
            break
    return msgspec.structs.replace(found, counts=found.counts | {"attempts": attempt + 1})


def missing(case: Case, commands: Commands, channel: str, route: str = "") -> str:
    """Why a case cannot be executed here; empty when it can."""
    have = {
        Need.OWN_PROCESS: commands.is_ours,
        Need.START: bool(commands.start),
        Need.REARM: bool(commands.rearm) or commands.is_ours,
        Need.VIRTUAL: is_virtual(channel),
        Need.ROOT: os.geteuid() == 0,
        Need.VXCAN: is_virtual(channel) and _has("tc") and _has("ip"),
    }
    lacking = [need.value for need in case.needs if not have[need]]
    lacking += [
        f"a device that is started with {{{word}}}"
        for word, is_needed in (("profile", case.profile), ("trajectory", case.breaks), ("channel", case.channel))
        if is_needed and commands.start and f"{{{word}}}" not in commands.start
    ]
    if commands.start and not case.armed and not commands.listen:
        lacking.append("a way to start the device without arming it (--listen-device)")
    if commands.start and case.recorded_mib and "{record}" not in commands.record:
        lacking.append("a way to start the device so that it writes its drive down in {record} (--recording-device)")
    if commands.start and case.viewed and "{port}" not in commands.view:
        lacking.append("a program that shows the device to browsers at {port} (--viewer)")
    if not commands.start and (case.breaks or case.profile or case.setup):
        lacking.append(Need.START.value)
    if not commands.start and not lacking and case.route().name != route:
        lacking.append(f"a device that drives the route {case.route().name} (--write-routes, --route)")
    return f"needs {'; '.join(lacking)}" if lacking else ""


def _located(found: CaseResult, folder: str, at_s: float) -> CaseResult:
    return msgspec.structs.replace(
        found,
        began_s=at_s,
        candump=found.candump and f"{folder}/{found.candump}",
        device_log=found.device_log and f"{folder}/{found.device_log}",
    )


def _be_prompt() -> None:
    """Real-time priority, where it may be had: the bench must not be what is late."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(40))
    except PermissionError:
        return


def _has(program: str) -> bool:
    return shutil.which(program, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin") is not None


def _adapter(channel: str) -> str:
    try:
        driver = Path(f"/sys/class/net/{channel}/device/driver").resolve(strict=True)
    except OSError:
        return "none: a virtual interface"
    return driver.name


def _revision() -> str:
    head = ROOT / ".git" / "HEAD"
    try:
        text = head.read_text().strip()
        return (ROOT / ".git" / text[5:]).read_text().strip()[:12] if text.startswith("ref: ") else text[:12]
    except OSError:
        return "unknown"
