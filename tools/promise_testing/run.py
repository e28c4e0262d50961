"""`tools/promises`: does a test fail when the product breaks a promise of FAILURES.md?

The plan, `tools/promises.toml`, has at least one defect for each row of the page: the promise that it breaks, in the
words of the page, and the change of the code that breaks it. The tool makes each change in a copy of the project and
runs the tests that the row names: first those that need no CAN interface; if they pass, those on a real vcan0. In the
end it runs every test that failed once more, without any defect: a test that fails then, too, proves nothing.
With `--write` the table of `docs/promises.md` is brought up to date.

Ends with 0 when every defect was noticed; with 1 when one was not; with 2 when the plan does not fit the page or the
code.
"""

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

import msgspec

from promise_testing.failure_page import Row, rows
from promise_testing.project_copy import PlanError, ProjectCopy, changed_source

ROOT = Path(__file__).resolve().parents[2]
PLAN = ROOT / "tools" / "promises.toml"
PAGE = ROOT / "vehicle_iface" / "FAILURES.md"
TABLE = ROOT / "docs" / "promises.md"
BUS_TESTS = "tests/vcan/"
PYTEST = ("-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--hypothesis-seed=0")
LIMIT_S = 600.0
AT_ONCE = 8
"""Tests of the last run that share a process, and the limit."""
NOT_NOTICED, NEEDS_BUS, UNSOUND = "**not noticed**", "not run: needs the bus", "**fails without the defect, too**"


class Defect(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One change of the code that breaks a promise."""

    row: str
    """Number of the row."""
    promise: str
    """Words of that row, as they stand there."""
    file: str
    """Below the root of the project."""
    was: str
    """Occurs exactly once in the file."""
    becomes: str
    tests: tuple[str, ...] = ()
    """Those of the row that run; all of them when empty."""

    @property
    def label(self) -> str:
        """What errors name it by."""
        return self.row


class Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All defects."""

    defect: tuple[Defect, ...]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What the tests said of one defect."""

    defect: Defect
    noticed_by: str
    """The test that failed, or one of the verdicts above."""

    @property
    def is_noticed(self) -> bool:
        """Whether a test failed because of it."""
        return self.noticed_by.startswith("tests/")


def load_plan(path: Path = PLAN) -> Plan:
    """Raises `PlanError` for a file that is no plan."""
    try:
        return msgspec.toml.decode(path.read_bytes(), type=Plan)
    except msgspec.DecodeError as error:
        raise PlanError(f"{path}: {error}") from None


def row_of(defect: Defect, page: Sequence[Row]) -> Row:
    """The row whose promise it breaks. Raises `PlanError`."""
    numbered = [row for row in page if row.number == defect.row]
    found = [row for row in numbered if defect.promise in row.text]
    if len(found) == 1:
        return found[0]
    why = "no such row" if not numbered else "no row has" if not found else "more than one row has"
    raise PlanError(f"{defect.row}: {why}: {defect.promise!r}")


def faults_of(defects: Sequence[Defect], page: Sequence[Row], root: Path = ROOT) -> list[str]:
    """What does not fit: a promise that nobody made, a change that cannot be made, a row without a defect."""
    faults, covered = [], set()
    for defect in defects:
        try:
            row = row_of(defect, page)
            covered.add(row)
            faults += [f"{defect.row}: not a test of the row: {test}" for test in defect.tests if test not in row.tests]
            source = (root / defect.file).read_text(encoding="utf-8")
            changed_source(defect, source)
        except (PlanError, OSError) as error:
            faults.append(str(error))
    return faults + [f"{row.number}: no defect for: {row.failure}" for row in page if row not in covered]


class Copy(ProjectCopy):
    """A copy in which the tests run."""

    def first_failure(self, tests: Sequence[str], *, on_bus: bool) -> str | None:
        """The first of the tests that fails; None when they all pass. Raises `PlanError` where they did not run."""
        names = [test for test in tests if test.startswith(BUS_TESTS) == on_bus]
        if not names:
            return None
        vcan = (sys.executable, str(self.root / "tools" / "vcan")) if on_bus else ()
        environment = os.environ | {"PYTHONPATH": f"{self.root}:{self.root / 'viewer'}", "PYTHONDONTWRITEBYTECODE": "1"}
        command = [*vcan, sys.executable, *PYTEST, *names]
        try:
            done = subprocess.run(
                command,
                cwd=self.root,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=LIMIT_S,
            )
        except subprocess.TimeoutExpired:
            return names[0]  # a hang is noticed by whoever waits
        if done.returncode == 0:
            return None
        failed = re.search(r"^(?:FAILED|ERROR) (tests/[^\s\[]+)", done.stdout, re.MULTILINE)
        if done.returncode != 1 or failed is None:
            if any(name in done.stdout for name in names) or "Timeout" in done.stdout:
                return names[0]
            raise PlanError(f"{' '.join(command)}: status {done.returncode}:\n{done.stdout[-2000:]}")
        return failed.group(1)


def judge(defects: Sequence[Defect], page: Sequence[Row], *, bus: bool, jobs: int, root: Path = ROOT) -> list[Outcome]:
    """The outcome of each defect, in the order given."""
    with tempfile.TemporaryDirectory(prefix="promises-") as folder:
        free: SimpleQueue[Copy] = SimpleQueue()
        for i in range(jobs):
            free.put(Copy(root, Path(folder) / str(i)))

        def outcome_of(defect: Defect) -> Outcome:
            copy, tests = free.get(), defect.tests or row_of(defect, page).tests
            try:
                with copy.with_change(defect):
                    failed = copy.first_failure(tests, on_bus=False)
                    needs_bus = failed is None and any(test.startswith(BUS_TESTS) for test in tests)
                    if needs_bus and not bus:
                        return Outcome(defect, NEEDS_BUS)
                    if needs_bus:
                        failed = copy.first_failure(tests, on_bus=True)
                return Outcome(defect, failed or NOT_NOTICED)
            finally:
                free.put(copy)

        outcomes: dict[int, Outcome] = {}
        begun_s = time.monotonic()
        with ThreadPoolExecutor(jobs) as pool:
            futures = {pool.submit(outcome_of, defect): place for place, defect in enumerate(defects)}
            for future in as_completed(futures):
                outcome = outcomes[futures[future]] = future.result()
                left_s = (time.monotonic() - begun_s) / len(outcomes) * (len(defects) - len(outcomes))
                head = f"{len(outcomes)}/{len(defects)} done, {left_s:.0f} s left"
                print(f"{head}: {outcome.defect.row}: {outcome.noticed_by}", file=sys.stderr, flush=True)
        return _without_unsound([outcomes[place] for place in range(len(defects))], free.get())


def _without_unsound(outcomes: Sequence[Outcome], copy: Copy) -> list[Outcome]:
    """Runs the tests that failed without any defect; whatever they noticed counts only where they pass."""
    tests = sorted({outcome.noticed_by for outcome in outcomes if outcome.is_noticed})
    print(f"the {len(tests)} tests that failed, without any defect", file=sys.stderr, flush=True)
    unsound: set[str] = set()
    for on_bus in (False, True):
        names = [test for test in tests if test.startswith(BUS_TESTS) == on_bus]
        for begin in range(0, len(names), AT_ONCE):
            chunk = names[begin : begin + AT_ONCE]
            while (failed := copy.first_failure(chunk, on_bus=on_bus)) is not None:
                unsound.add(failed)
                chunk.remove(failed)
    return [Outcome(outcome.defect, UNSOUND) if outcome.noticed_by in unsound else outcome for outcome in outcomes]


def table_of(outcomes: Iterable[Outcome]) -> str:
    """The result in Markdown."""
    head = ["| row | promise | the code does instead | noticed by |", "|---|---|---|---|"]
    return "\n".join([*head, *(_line(outcome) for outcome in outcomes)]) + "\n"


def _line(outcome: Outcome) -> str:
    test = f"`{outcome.noticed_by}`" if outcome.is_noticed else outcome.noticed_by
    return f"{_cells(outcome.defect)}{test} |"


def _cells(defect: Defect) -> str:
    """All cells of a line but the last."""
    change = f"`{defect.file}`: {_code(defect.was)} → {_code(defect.becomes)}"
    return f"| {defect.row} | {defect.promise} | {change} | "


def _code(source: str) -> str:
    words = " ".join(source.split()).replace("|", "\\|")
    return f"`{words}`" if words else "nothing"


def write_table(outcomes: Sequence[Outcome], plan: Plan, path: Path = TABLE) -> None:
    """Bring the page's table up to date: a defect that was not judged now keeps its line, if it has one."""
    head, _, _ = path.read_text(encoding="utf-8").partition("| row |")
    table = updated_table(outcomes, plan, path.read_text(encoding="utf-8"))
    path.write_text(head + table, encoding="utf-8")


def updated_table(outcomes: Sequence[Outcome], plan: Plan, page: str) -> str:
    """The table of the plan, in its order: from these outcomes, or else from the page."""
    known = {line.rpartition(" | ")[0] + " | ": line for line in page.splitlines() if line.startswith("| ")}
    known |= {_cells(outcome.defect): _line(outcome) for outcome in outcomes}
    lines = [known[_cells(defect)] for defect in plan.defect if _cells(defect) in known]
    return table_of(()) + "".join(f"{line}\n" for line in lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module."""
    parser = argparse.ArgumentParser(
        prog="tools/promises", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help="number of a row, like B1; all without one")
    parser.add_argument("--no-bus", action="store_true", help="only the tests that need no CAN interface")
    parser.add_argument("--sample", type=int, metavar="COUNT", help="judge only so many defects, each time the same")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at the same time; default: %(default)s")
    parser.add_argument("--write", action="store_true", help="put the table into docs/promises.md")
    options = parser.parse_args(arguments)
    try:
        plan, page = load_plan(), rows(PAGE.read_text(encoding="utf-8"))
        if unknown := set(options.rows) - {row.number for row in page}:
            raise PlanError(f"no such row: {', '.join(sorted(unknown))}")
        if options.rows:
            page = [row for row in page if row.number in options.rows]
        chosen = [defect for defect in plan.defect if not options.rows or defect.row in options.rows]
        if faults := faults_of(chosen, page):
            raise PlanError("\n".join(faults))
        if options.no_bus:
            chosen = [d for d in chosen if any(not t.startswith(BUS_TESTS) for t in d.tests or row_of(d, page).tests)]
        if options.sample is not None:
            chosen = sorted(chosen, key=_lot)[: options.sample]
        outcomes = judge(chosen, page, bus=not options.no_bus, jobs=options.jobs)
    except PlanError as error:
        print("\n".join(f"promises: {line}" for line in str(error).splitlines()), file=sys.stderr)
        return 2
    table = table_of(outcomes)
    print(table, end="")
    if options.write:
        write_table(outcomes, plan)
    missed = [outcome for outcome in outcomes if not outcome.is_noticed and outcome.noticed_by != NEEDS_BUS]
    print(f"{len(outcomes)} defects, {len(missed)} not noticed", file=sys.stderr)
    return 1 if missed else 0


def _lot(defect: Defect) -> bytes:
    """Draws by chance, and the same each time."""
    return hashlib.sha256(repr(defect).encode()).digest()


if __name__ == "__main__":
    sys.exit(main())
