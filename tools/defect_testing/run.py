"""`tools/bench_defects`: which defects of a controller does the bench catch?

The plan, `tools/bench_defects.toml`, has the defects: one-line changes of the program and of the minimal controller,
and the cases expected to catch each. The command makes each change in a copy of the project, runs the bench on vcan0
(in a user-mode kernel where there is none) until the first case fails, and in the end runs each case that failed once
more with a sound device: a case that fails then, too, catches nothing. `docs/bench_defects.md` is brought up to date.

Ends with 0 when every defect that was measured now was caught; with 1 when one was not; with 2 when the plan does not
fit the code or the catalogue.
"""

import argparse
import itertools
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
from hil_bench import result
from hil_bench.cases import catalogue_for
from hil_bench.judges.excuses import HOST_DEPENDENT, ONE_DELAY
from hil_bench.peer.build import open_wire
from hil_bench.result import CaseResult, Verdict
from hil_bench.steps import CAN_BEGIN
from promise_testing.project_copy import PlanError, ProjectCopy

from defect_testing import findings as kept
from defect_testing import page
from defect_testing.findings import Findings, Outcome, Scope, sound_key
from defect_testing.forked import run_virtual_cases
from defect_testing.plan import MINIMAL, ROOT, Defect, draw_sample, find_faults, load_plan

CHANNEL = "vcan0"
CATALOGUE = catalogue_for(open_wire("reference"))
CASES = tuple(case.name for case in CATALOGUE)
QUICK = tuple(case.name for case in CATALOGUE if "quick" in case.tags)
LONGEST_CASE_S = 240.0
AT_ONCE = 6
"""Cases of one run with the sound device."""
IS_INSIDE = "BENCH_DEFECTS_INSIDE"


class NotExecutedError(Exception):
    """The bench could not judge, and why."""


class Bench:
    """Runs cases of the bench with the controllers of a copy of the project."""

    has_all_cases = True
    """A case that it does not execute might catch the defect."""

    def __init__(self, copy: ProjectCopy) -> None:
        self._copy = copy
        self._runs = 0

    def judge(self, defect: Defect, cases: Sequence[str]) -> Outcome:
        """With the defect, until the first case fails. Raises `NotExecutedError`."""
        if defect.flag:
            return self._judge(defect, cases, flag=f" --defect {defect.flag}")
        with self._copy.with_change(defect):
            return self._judge(defect, cases)

    def judge_sound(self, cases: Sequence[str], like: Defect) -> dict[str, bool]:
        """Which of these cases the controller passes without this defect; without those that were not executed."""
        sound = {}
        for one in self._run(cases, minimal=like.is_minimal, flag="", until_failure=False):
            if one.verdict in (Verdict.PASS, Verdict.FAIL):
                sound[one.name] = not _find_failure(one, timing=like.timing)
        return sound

    def _judge(self, defect: Defect, cases: Sequence[str], flag: str = "") -> Outcome:
        results = self._run(cases, minimal=defect.is_minimal, flag=flag)
        was_any = any(one.verdict is not Verdict.NOT_EXECUTED for one in results)
        unclear = ""
        for one in results:
            found = _find_failure(one, timing=defect.timing)
            if found.startswith(ONE_DELAY):
                again = self._run([one.name], minimal=defect.is_minimal, flag=flag)
                found = _find_failure(again[0], timing=defect.timing) if again else ""
            if found:
                return Outcome(one.name, found, tuple(cases))
            if one.verdict is Verdict.NOT_EXECUTED and (self.has_all_cases or not was_any):
                unclear = unclear or f"{one.name}: {one.why}"
        if unclear:
            raise NotExecutedError(unclear)
        return Outcome(cases=tuple(cases))

    def _run(self, cases: Sequence[str], *, minimal: bool, flag: str, until_failure: bool = True) -> list[CaseResult]:
        folder = self._new_path("report")
        command = ["tools/hil_bench.py", "--channel", CHANNEL, "--out", str(folder)]
        command += ["--until-failure"] if until_failure else []
        command += [word for case in cases for word in ("--case", case)]
        command += _minimal_options(flag) if minimal else []
        said = self._call(command, LONGEST_CASE_S * len(cases))
        report = folder / "results.json"
        if not report.exists():
            raise NotExecutedError(f"no report: {said[-500:]}")
        return list(result.read(report).cases)

    def _new_path(self, kind: str) -> Path:
        self._runs += 1
        return self._copy.root.parent / f"{kind}-{self._runs}"

    def _call(self, command: Sequence[str], longest_s: float) -> str:
        """What a Python program of the copy says."""
        root = self._copy.root
        folders = (root, root / "viewer", root / "tools", root / "tests" / "hil_bench")
        try:
            return subprocess.run(
                [sys.executable, *command],
                check=False,
                cwd=root,
                env=os.environ | {"PYTHONPATH": ":".join(map(str, folders))},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=longest_s,
            ).stdout
        except subprocess.TimeoutExpired:
            raise NotExecutedError(f"the bench takes longer than {longest_s:.0f} s") from None


class VirtualBench(Bench):
    """Runs cases with the program's loop, or the minimal controller, in virtual time: without a bus and a process."""

    has_all_cases = False

    def _run(self, cases: Sequence[str], *, minimal: bool, flag: str, until_failure: bool = True) -> list[CaseResult]:
        results, log = self._new_path("virtual"), self._new_path("log")
        words = [str(results), *cases, *flag.split()]
        words += ["--minimal"] if minimal else []
        words += ["--until-failure"] if until_failure else []
        if not run_virtual_cases(self._copy.root, log, words, LONGEST_CASE_S * len(cases)):
            raise NotExecutedError("the cases take too long")
        if not results.exists():
            raise NotExecutedError(f"no results: {log.read_text(errors='replace')[-500:]}")
        return msgspec.json.decode(results.read_bytes(), type=list[CaseResult])


def _minimal_options(flag: str) -> list[str]:
    start = f"{sys.executable} {MINIMAL}minimal_controller.py --channel {{channel}} --route {{trajectory}}"
    viewer = f"{sys.executable} {MINIMAL}minimal_view.py {{port}}"
    return [
        "--device",
        f"{start} --arm --show {{port}}{flag}",
        "--listen-device",
        f"{start}{flag}",
        "--recording-device",
        f"{start} --arm --record {{record}}{flag}",
        "--viewer",
        viewer,
    ]


def _find_failure(case: CaseResult, *, timing: bool) -> str:
    """The first check that failed, and how; empty where nothing failed, or only what a slow host can fail.

    Such checks count for defects of timing alone.
    """
    if case.verdict is not Verdict.FAIL:
        return ""
    failed = [check for check in case.checks if check.verdict is Verdict.FAIL]
    for check in failed:
        if timing or not (check.text.startswith(HOST_DEPENDENT) or check.text.endswith(CAN_BEGIN)):
            return f"{check.text}: {check.found[0]}" if check.found else check.text
    return "" if failed else case.why


def find_open(defects: Sequence[Defect], findings: Findings, scope: Scope) -> Iterator[Defect]:
    """The visible defects of which this scope can still tell something."""
    quick = frozenset(QUICK) if scope.is_quick else None
    for defect in defects:
        is_in_scope = defect.is_visible and (defect.cases or not scope.is_named)
        is_alone = not scope.is_virtual or not defect.process
        if not (is_in_scope and is_alone) or findings.is_judged(defect, scope):
            continue
        if findings.catch(defect, quick=quick, virtual=scope.is_virtual) is None:
            yield defect


def measure(
    defects: Sequence[Defect], bench: Bench, findings: Findings, scope: Scope, results: Path, end_s: float
) -> list[Defect]:
    """Judge each, and keep what was found at once; no further one is begun after `end_s`. Returns those judged."""
    judged = []
    for place, defect in enumerate(defects, 1):
        if time.monotonic() > end_s:
            break
        of_scope = QUICK if scope.is_quick else () if scope.is_named and defect.cases else CASES
        named = (*(case for case in defect.cases if not scope.is_quick or case in QUICK), *of_scope)
        cases = [case for case in dict.fromkeys(named) if findings.is_sound(defect, case, scope)]
        try:
            outcome = bench.judge(defect, cases)
        except NotExecutedError as error:
            said = f"not executed: {error}"
        else:
            findings.note(defect, scope, outcome)
            findings.write(results)
            judged.append(defect)
            said = f"{outcome.case}: {outcome.check}" if outcome.case else "not caught"
        print(f"{place}/{len(defects)}: {defect.id}: {said}", file=sys.stderr, flush=True)
    return judged


def check_soundness(defects: Sequence[Defect], bench: Bench, findings: Findings, results: Path, end_s: float) -> None:
    """Run the cases that caught something with the sound device, where that is not known yet."""
    unknown: dict[tuple[bool, bool], dict[str, Defect]] = {}
    for defect, scope in itertools.product(defects, Scope):
        found = findings.outcome(defect, scope)
        if scope.is_virtual is not isinstance(bench, VirtualBench) or found is None or not found.case:
            continue
        if sound_key(defect, found.case, scope) not in findings.sound:
            unknown.setdefault((defect.is_minimal, defect.timing), {})[found.case] = defect
    scope = Scope.VIRTUAL_NAMED if isinstance(bench, VirtualBench) else Scope.NAMED
    for of in unknown.values():
        cases, like = list(of), next(iter(of.values()))
        for begin in range(0, len(cases), AT_ONCE):
            if time.monotonic() > end_s:
                return
            try:
                judged = bench.judge_sound(cases[begin : begin + AT_ONCE], like)
            except NotExecutedError as error:
                print(f"without a defect: not executed: {error}", file=sys.stderr, flush=True)
                continue
            for case, passes in judged.items():
                findings.sound[sound_key(like, case, scope)] = passes
                print(f"without a defect, {case}: {'passed' if passes else 'FAILED'}", file=sys.stderr, flush=True)
            findings.write(results)


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    options = _parser().parse_args(arguments)
    try:
        plan = load_plan()
        chosen = _choose(plan, options)
        if faults := find_faults(plan, CASES, read_flags()):
            raise PlanError("\n".join(faults))
    except PlanError as error:
        print("\n".join(f"bench_defects: {line}" for line in str(error).splitlines()), file=sys.stderr)
        return 2
    findings = Findings.read(options.results)
    scope = _scope(options)
    is_again = options.again or options.sample is not None
    todo = list(find_open(chosen, Findings() if is_again else findings, scope))
    judged: list[Defect] = []
    if not options.page_only:
        if not scope.is_virtual and not Path(f"/sys/class/net/{CHANNEL}").exists():
            _continue_in_kernel(arguments)
        end_s = time.monotonic() + 60.0 * options.minutes
        with tempfile.TemporaryDirectory(prefix="bench-defects-") as folder:
            copy = ProjectCopy(ROOT, Path(folder) / "project")
            bench = VirtualBench(copy) if scope.is_virtual else Bench(copy)
            judged = measure(todo, bench, findings, scope, options.results, end_s)
            check_soundness(chosen if not is_again else judged, bench, findings, options.results, end_s)
    if not options.no_page:
        page.write_page(plan, findings, frozenset(QUICK))
    missed = [defect.id for defect in judged if findings.catch(defect) is None]
    print(f"not caught now: {', '.join(missed) or 'none'}; left: {len(todo) - len(judged)}")
    print(page.summarise(chosen, findings, frozenset(QUICK)))
    return 1 if missed else 0


def _scope(options: argparse.Namespace) -> Scope:
    if options.virtual:
        return Scope.VIRTUAL_QUICK if options.quick else Scope.VIRTUAL_WHOLE if options.whole else Scope.VIRTUAL_NAMED
    return Scope.QUICK if options.quick else Scope.WHOLE if options.whole else Scope.NAMED


def _choose(plan: Sequence[Defect], options: argparse.Namespace) -> list[Defect]:
    known = {defect.id: defect for defect in plan}
    if unknown := [name for name in options.ids if name not in known]:
        raise PlanError(f"no such defect: {', '.join(unknown)}")
    chosen = [known[name] for name in options.ids] or list(plan)
    if options.sample is None:
        return chosen
    caught = Findings.read()
    return draw_sample(
        [defect for defect in chosen if caught.was_caught(defect, virtual=options.virtual)], options.sample
    )


def read_flags() -> set[str]:
    """What `--defect` of the minimal controller takes."""
    source = (ROOT / MINIMAL / "defects.py").read_text(encoding="utf-8")
    return set(re.findall(r'^    "(\w+)":', source, re.MULTILINE))


def _continue_in_kernel(arguments: Sequence[str]) -> None:
    """Become the same command where vcan0 exists."""
    if IS_INSIDE in os.environ:
        sys.exit(f"bench_defects: there is no {CHANNEL}")
    command = [sys.executable, str(ROOT / "tools" / "vcan"), sys.executable, "-P", "-m", "defect_testing.run"]
    os.execve(sys.executable, [*command, *arguments], os.environ | {IS_INSIDE: "1"})


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tools/bench_defects", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("ids", nargs="*", metavar="ID", help="defects of the plan; all without one")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--quick", action="store_true", help="run the quick cases, not those that the plan names")
    which.add_argument("--whole", action="store_true", help="run the whole catalogue")
    add("--virtual", action="store_true", help="run in virtual time, without vcan0")
    add("--sample", type=int, metavar="N", help="measure only so many of those that were caught, each time the same")
    add("--again", action="store_true", help="measure also what was measured already")
    add("--minutes", type=float, default=1e6, metavar="M", help="begin nothing more after this time")
    add("--results", type=Path, default=kept.FILE, metavar="FILE", help="keep what was measured here")
    add("--no-page", action="store_true", help="leave docs/bench_defects.md as it is")
    add("--page-only", action="store_true", help="measure nothing, only write docs/bench_defects.md")
    return parser


if __name__ == "__main__":
    sys.exit(main())
