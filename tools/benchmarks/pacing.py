"""How late the loop wakes up: alone, watched in a browser, with a browser that hangs, with a page that reloads.

The control process is `vehicle-iface run` on the embedded bus, 100 Hz as the reference vehicle and 1 kHz with a profile
and a DBC of a tenth of its periods, each with and without SCHED_FIFO. It watches its own wake-ups: how late each is
against the instant on the absolute grids (the loop's and the vehicle's) that it had asked for. Viewer and Chromium are
processes of their own; "alone" means that both are stopped (SIGSTOP), "hung" that only the browser is. Always on this
machine's own kernel: a user-mode kernel's timing is nothing to judge by.

--drive-s measures one long drive instead: 1 kHz, SCHED_FIFO, viewer and browser, and all of it recorded.

Takes 4 min; --quick 1 min.

Target: p99 at 100 Hz with SCHED_FIFO and a browser at most 1.3 times that of alone; passes later than 1 ms at most
0.5 % while a page reloads; as many ticks as periods, give or take one; no full garbage collection in a pass; no viser.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from benchmarks.parts.pacing_page import Onlookers
from benchmarks.parts.report import BenchmarkError, Cell, Report, Table, Target, progress

ROOT = Path(__file__).resolve().parents[2]
ALONE, WATCHED, HUNG, RELOADING = "alone", "viewer and browser", "hung browser", "page reloading"
RECORDED = "viewer, browser, recorder"
FIFO, ORDINARY = "fifo", "ordinary"
SLOW, FAST = "100 Hz", "1 kHz"
MS_NS = 1_000_000
LATE_NS = MS_NS
RELOAD_S, LOOK_S = 1.0, 0.3
STARTING_S = 1.5
"""The control process is engaged by then."""
QUANTILES = (("p50", 0.5), ("p99", 0.99), ("max", 1.0))


@dataclass(frozen=True, slots=True)
class Case:
    """What is measured together."""

    rate: str
    policy: str
    onlookers: str


@dataclass(slots=True)
class Found:
    """All runs of one case."""

    runs: int = 0
    page: int = 0
    """Runs in which the page showed the vehicle drive; while it reloads: showed the vehicle."""
    faults: int = 0
    """Runs that were not engaged to the end: a pass so late that the simulated vehicle's watchdog (100 ms) acted."""
    late_ns: list[int] = field(default_factory=list)
    p99s_ns: list[float] = field(default_factory=list)
    """Of each run."""
    ticks_off: list[float] = field(default_factory=list)
    """Ticks of the loop's grid less the periods that passed, each run."""
    in_a_pass: int = 0
    between_passes: int = 0
    imports_viser: bool = False
    misses: int = 0

    def add(self, run: Mapping[str, Any]) -> None:
        """One more run."""
        self.runs += 1
        self.faults += run["state"] != "ENGAGED"
        self.page += run.get("page", 0)
        self.late_ns += run["late_ns"]
        self.p99s_ns.append(quantile(run["late_ns"], 0.99))
        self.ticks_off.append(run["ticks"] - run["periods"])
        self.in_a_pass += run["full_collections"]["in a pass"]
        self.between_passes += run["full_collections"]["between passes"]
        self.imports_viser |= run["imports_viser"]
        self.misses += run["deadline_misses"]

    @property
    def late_share(self) -> float:
        """Of all passes, those later than 1 ms."""
        return sum(late_ns > LATE_NS for late_ns in self.late_ns) / len(self.late_ns)


def add_options(parser: argparse.ArgumentParser) -> None:
    """The length of a single drive."""
    text = "only one drive, 1 kHz with SCHED_FIFO, viewer, browser and recorder, for so many seconds"
    parser.add_argument("--drive-s", type=float, metavar="S", help=text)


def run(options: argparse.Namespace) -> Report:
    """All cases in turns, pooled; or one long drive."""
    if options.drive_s is not None:
        return _one_drive(options.drive_s)
    rounds, seconds = (1, {SLOW: 2.0, FAST: 1.0}) if options.quick else (4, {SLOW: 3.0, FAST: 1.5})
    watched = {SLOW: ONLOOKERS, FAST: (ALONE, WATCHED)}
    cases = [Case(rate, policy, how) for rate in watched for policy in (FIFO, ORDINARY) for how in watched[rate]]
    found = {case: Found() for case in cases}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        profiles = {SLOW: "reference", FAST: str(fast_profile(folder))}
        address = f"{folder}/telemetry"
        with sync_playwright() as playwright, Onlookers(playwright, address, folder / "chromium") as onlookers:
            # The first drive that a browser shows costs it seconds of its own.
            _with_page(onlookers, Control("reference", address, 4.0, FIFO), during=lambda: time.sleep(LOOK_S))
            for number in range(rounds):
                for case in _rotated(cases, number * 5):
                    progress(f"round {number + 1} of {rounds}: {case.rate}, {case.policy}, {case.onlookers} …")
                    process = Control(profiles[case.rate], address, seconds[case.rate], case.policy)
                    found[case].add(ONLOOKERS[case.onlookers](onlookers, process))
    progress("")
    return Report(
        method=(
            f"{rounds} interleaved rounds of {seconds[SLOW]:g} s at 100 Hz and {seconds[FAST]:g} s at 1 kHz, pooled; "
            "two wake-ups a period, one for the vehicle's sample and one for the loop's grid; the first second of a "
            "run is not counted. Embedded bus, on this machine's own kernel."
        ),
        tables=_tables(found),
        targets=_targets(found),
    )


def _one_drive(seconds: float) -> Report:
    """1 kHz with viewer, browser and recorder."""
    case, found = Case(FAST, FIFO, RECORDED), Found()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        address, more = f"{folder}/telemetry", ("--record", f"{folder}/recording")
        process = Control(str(fast_profile(folder)), address, seconds, FIFO, more)
        with sync_playwright() as playwright, Onlookers(playwright, address, folder / "chromium") as onlookers:
            found.add(_watched(onlookers, process))
    return Report(
        method=f"one drive of {seconds:g} s at 1 kHz; two wake-ups a period; the first second is not counted",
        tables=_tables({case: found}),
        targets=[
            Target(what="passes later than 1 ms", value=100.0 * found.late_share, at_most=0.0, unit="%"),
            Target(what="ticks off the periods", value=max(map(abs, found.ticks_off)), at_most=1.0),
        ],
    )


class Control:
    """A control process; it begins when it is started."""

    def __init__(self, profile: str, address: str, seconds: float, policy: str, more: Sequence[str] = ()) -> None:
        """`more` are options of `vehicle-iface run`."""
        environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'tools'}:{ROOT}"}
        part = "benchmarks.parts.pacing_loop"
        command = [sys.executable, "-P", "-m", part, profile, address, str(seconds), policy, *more]
        # Into a file: a long drive's figures do not fit into a pipe, and nobody reads before the process has ended.
        self._said = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115
        self._open: Callable[[], subprocess.Popen[str]] = lambda: subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=self._said,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=ROOT,
        )
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Let it drive."""
        self._process = self._open()

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        assert self._process is not None
        return self._process.poll() is None

    def wait(self) -> None:
        """Until it has ended."""
        assert self._process is not None
        self._process.wait(60)

    def found(self) -> Any:
        """What it has measured, once it has ended by itself."""
        assert self._process is not None
        _, complaints = self._process.communicate(timeout=60)
        self._said.seek(0)
        said = self._said.read()
        lacking = [line for line in complaints.splitlines() if "no permission for SCHED_FIFO" in line]
        if self._process.returncode != 0 or lacking:
            raise BenchmarkError(lacking[0] if lacking else f"the control process failed:\n{complaints}")
        return json.loads(said.splitlines()[-1])


def _alone(_: Onlookers, process: Control) -> Any:
    process.start()
    return process.found()


def _watched(onlookers: Onlookers, process: Control) -> Any:
    places = _with_page(onlookers, process, during=lambda: time.sleep(LOOK_S))
    return process.found() | {"page": len(places) > 1}


def _reloading(onlookers: Onlookers, process: Control) -> Any:
    def reload() -> None:
        onlookers.reload()
        time.sleep(RELOAD_S)

    places = _with_page(onlookers, process, during=reload)
    return process.found() | {"page": bool(places)}


def _with_page(onlookers: Onlookers, process: Control, *, during: Callable[[], None]) -> set[str]:
    """Where the page said that the vehicle was while the process ran."""
    onlookers.thaw()
    try:
        process.start()
        time.sleep(STARTING_S)
        places = set()
        while process.is_running:
            places.add(onlookers.place())
            during()
        return places - {""}
    finally:
        onlookers.freeze()


def _hung(onlookers: Onlookers, process: Control) -> Any:
    onlookers.thaw()
    try:
        process.start()
        time.sleep(STARTING_S)
        onlookers.hang()
        return process.found()
    finally:
        onlookers.freeze()


ONLOOKERS: Mapping[str, Callable[[Onlookers, Control], Any]] = {
    ALONE: _alone,
    WATCHED: _watched,
    HUNG: _hung,
    RELOADING: _reloading,
}


def fast_profile(folder: Path) -> Path:
    """The reference vehicle with a tenth of its sample, status and command periods, in the profile and in the DBC."""
    dbc = (ROOT / "dbc" / "reference.dbc").read_text(encoding="utf-8")
    cycle = re.compile(r'(BA_ "GenMsgCycleTime" BO_ \d+ [12])0;')
    (folder / "reference.dbc").write_text(cycle.sub(r"\1;", dbc), encoding="utf-8")
    toml = (ROOT / "dbc" / "reference.toml").read_text(encoding="utf-8")
    period = re.compile(r"^((?:sample|status|command)_period_s = 0\.)0", re.MULTILINE)
    profile = folder / "reference_1khz.toml"
    profile.write_text(period.sub(r"\g<1>00", toml), encoding="utf-8")
    return profile


def quantile(values: Sequence[float], share: float) -> float:
    """The value that `share` of all are at or below."""
    ordered = sorted(values)
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


def _rotated(cases: list[Case], by: int) -> list[Case]:
    by %= len(cases)
    return cases[by:] + cases[:by]


def _tables(found: Mapping[Case, Found]) -> list[Table]:
    lateness: list[Sequence[Cell]] = []
    besides: list[Sequence[Cell]] = []
    for case, one in found.items():
        which = (case.rate, case.policy, case.onlookers)
        spread = [quantile(one.late_ns, share) / MS_NS for _, share in QUANTILES]
        p99s = f"{min(one.p99s_ns) / MS_NS:.3f} … {max(one.p99s_ns) / MS_NS:.3f}"
        lateness.append([*which, *spread, p99s, 100.0 * one.late_share, len(one.late_ns)])
        page = f"{one.page} of {one.runs}" if case.onlookers not in (ALONE, HUNG) else None
        worst = f"{max(one.ticks_off, key=abs):+.2f}"
        faults = f"{one.faults} of {one.runs}"
        besides.append([*which, worst, one.misses, faults, page, one.in_a_pass, one.between_passes])
    names = ("rate", "scheduling", "onlookers")
    quantiles = [f"{name} ms" for name, _ in QUANTILES]
    words = ["ticks less periods, worst run", "samples answered late", "watchdog acted", "page followed"]
    collected = ["full collections in a pass", "between passes"]
    return [
        Table(
            title="Lateness of wake-ups",
            columns=[*names, *quantiles, "p99 of the runs ms", "later than 1 ms %", "wake-ups"],
            rows=lateness,
        ),
        Table(title="What else happened in these runs", columns=[*names, *words, *collected], rows=besides),
    ]


def _targets(found: Mapping[Case, Found]) -> list[Target]:
    def p99_ns(how: str) -> float:
        return quantile(found[Case(SLOW, FIFO, how)].late_ns, 0.99)

    def worst_off(policy: str) -> float:
        of_policy = [one for case, one in found.items() if (case.rate, case.policy) == (SLOW, policy)]
        return max(abs(off) for one in of_policy for off in one.ticks_off)

    return [
        Target(
            what="p99 with viewer and browser to alone, 100 Hz, SCHED_FIFO",
            value=p99_ns(WATCHED) / p99_ns(ALONE),
            at_most=1.3,
            unit="x",
        ),
        Target(
            what="passes later than 1 ms with a page reloading, 100 Hz, SCHED_FIFO",
            value=100.0 * found[Case(SLOW, FIFO, RELOADING)].late_share,
            at_most=0.5,
            unit="%",
        ),
        Target(what="ticks off the periods, worst run, 100 Hz, SCHED_FIFO", value=worst_off(FIFO), at_most=1.0),
        Target(what="ticks off the periods, worst run, 100 Hz, ordinary", value=worst_off(ORDINARY), at_most=1.0),
        Target(
            what="full garbage collections in a pass, all runs",
            value=float(sum(one.in_a_pass for one in found.values())),
            at_most=0.0,
        ),
        Target(
            what="control processes with viser in them",
            value=float(sum(one.imports_viser for one in found.values())),
            at_most=0.0,
        ),
    ]
