"""`tools/mutation`: which changes of the code does no test notice?

The plan, `tools/mutation.toml`, says which tests answer for which module, which mutants mean the same as the code, with
the reason, and how many percent of the others must be killed: of each module's and of all, and of a sample as a whole.
Ends with 0 when they are; with 1 when not, or where the plan gives a reason for a mutant that is none or does not
survive; with 2 when it could not be found out.
"""

import argparse
import hashlib
import importlib
import json
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mutation_testing.judge import BaselineError, judge
from mutation_testing.mutants import Mutant, mutants

ROOT = Path(__file__).resolve().parents[2]
SHOWN_EVERY_S = 5.0


@dataclass(slots=True)
class Result:
    """What became of one module's mutants."""

    module: str
    mutants: int
    killed: int = 0
    equivalent: int = 0
    survivors: list[Mutant] = field(default_factory=list)
    stale: list[str] = field(default_factory=list)
    """Entries of the plan that fit no mutant that survives."""
    took_s: float = 0.0

    @property
    def percent(self) -> float:
        """Killed, of those that can be."""
        possible = self.mutants - self.equivalent
        return 100.0 * self.killed / possible if possible else 100.0

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        numbers = {name: getattr(self, name) for name in ("module", "mutants", "killed", "equivalent", "stale")}
        survivors = [{"line": m.line, "function": m.function, "diff": m.diff} for m in self.survivors]
        return numbers | {
            "percent": round(self.percent, 2),
            "seconds": round(self.took_s, 1),
            "survivors": survivors,
        }


class Progress:
    """Tells on the error output how far it is: on a terminal in one line, elsewhere now and then."""

    def __init__(self, mutants: int) -> None:
        self._all, self._killed, self._survived = mutants, 0, 0
        self._begun_s = self._shown_s = time.monotonic()
        self._is_terminal = sys.stderr.isatty()
        self._clear = "\r\033[K" if self._is_terminal else ""

    def note(self, mutant: Mutant, *, killed: bool, why: str | None) -> None:
        """One more is judged; one that survives without a reason is shown at once."""
        if not killed and why is None:
            print(f"{self._clear}survived: {mutant.diff}\n", file=sys.stderr)
        self._killed += killed
        self._survived += not killed
        now_s, done = time.monotonic(), self._killed + self._survived
        if now_s - self._shown_s < (0.2 if self._is_terminal else SHOWN_EVERY_S) and done < self._all:
            return
        self._shown_s = now_s
        left_s = (now_s - self._begun_s) / done * (self._all - done)
        counts = f"{done}/{self._all} done, {self._killed} killed, {self._survived} survived"
        end = "" if self._is_terminal and done < self._all else "\n"
        print(f"{self._clear}{counts}, {left_s:.0f} s left: {mutant.module}", end=end, file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module."""
    options = _options(arguments)
    root, plan = Path(options.root).resolve(), tomllib.loads(Path(options.plan).read_text())
    try:
        _require_modules(plan)
        modules, what = _chosen(root, plan["tests"], options)
    except (LookupError, subprocess.CalledProcessError) as error:
        print(f"mutation: {error}", file=sys.stderr)
        return 2
    for name in plan.get("warm", ()):
        importlib.import_module(name)
    found = {module: mutants(module, (root / module).read_bytes()) for module in modules}
    everything = [mutant for module in modules for mutant in found[module]]
    judged = everything if options.sample is None else sorted(everything, key=_lot)[: options.sample]
    print(f"{len(judged)} of {len(everything)} mutants of {what}", file=sys.stderr)
    progress, drawn = Progress(len(judged)), set(judged)
    try:
        results = [_result(root, module, plan, found[module], drawn, progress) for module in modules]
    except BaselineError as error:
        print(f"mutation: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps({"modules": [result.as_json() for result in results]}, indent=2))
    else:
        _print_table(results)
    least = plan.get("least_percent", 100.0)
    rows = [_total(results)] if options.sample else [*results, _total(results)]
    low = [row for row in rows if row.percent < least]
    for row in low:
        print(f"mutation: {row.module}: {row.percent:.2f} % killed: must be at least {least}", file=sys.stderr)
    return 1 if low or any(result.stale for result in results) else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tools/mutation", description=__doc__)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="a path of the plan, or its end; all without one")
    parser.add_argument("--since", metavar="REV", help="only modules that changed, or whose tests did, since REV")
    parser.add_argument(
        "--changed",
        action="store_true",
        help="the same since this branch left main, on main itself since the commit before; all where that is not known"
        " or nothing changed",
    )
    parser.add_argument("--sample", type=int, metavar="COUNT", help="judge only so many of them, each time the same")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--plan", default=str(ROOT / "tools" / "mutation.toml"), help="default: %(default)s")
    parser.add_argument("--root", default=str(ROOT), help="of the project; default: %(default)s")
    options = parser.parse_args(arguments)
    if options.sample is not None and options.sample < 1:
        parser.error("--sample: must be at least 1")
    return options


def _require_modules(plan: dict[str, Any]) -> None:
    for entry in plan.get("equivalent", ()):
        if entry["module"] not in plan["tests"]:
            raise LookupError(f"{entry['module']}: has a reason in the plan and no tests")


def _chosen(root: Path, tests: dict[str, list[str]], options: argparse.Namespace) -> tuple[list[str], str]:
    """The modules to judge, and what they are, for people."""
    for name in options.modules:
        if not any(module.endswith(name) for module in tests):
            raise LookupError(f"{name}: not in the plan, which has {', '.join(tests)}")
    modules = [module for module in tests if not options.modules or module.endswith(tuple(options.modules))]
    since = options.since or (_base(root) if options.changed else None)
    what = f"{len(modules)} modules"
    if since is None:
        return modules, what + ("; no earlier commit is known here" if options.changed else "")
    command = ["git", "-C", str(root), "diff", "--name-only", "--relative", since, "--"]
    files = set(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines())
    changed = [module for module in modules if not files.isdisjoint((module, *tests[module]))]
    if changed or not options.changed:
        return changed, f"{len(changed)} modules that changed since {since}"
    return modules, f"{what}; none changed since {since}"


def _base(root: Path) -> str | None:
    """The commit that changes are told from; None where none is known: in a shallow clone, or without git."""

    def told(*arguments: str) -> str:
        return subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True).stdout.strip()

    if shutil.which("git") is None:
        return None
    head = told("rev-parse", "--quiet", "--verify", "HEAD")
    for main in ("origin/main", "main"):
        if (left := told("merge-base", "HEAD", main)) not in ("", head):
            return left
    return told("rev-parse", "--quiet", "--verify", "HEAD~1") or None


def _lot(mutant: Mutant) -> bytes:
    """Draws by chance, and the same from the same lines, whatever else is in the plan."""
    return hashlib.sha256(repr(mutant.key).encode()).digest()


def _result(
    root: Path, module: str, plan: dict[str, Any], found: list[Mutant], drawn: set[Mutant], progress: Progress
) -> Result:
    judged, others = [m for m in found if m in drawn], {m.key for m in found if m not in drawn}
    result, begun_s = Result(module, len(judged)), time.monotonic()
    reasons = {
        (module, entry["function"], entry["was"], becomes): entry["reason"]
        for entry in plan.get("equivalent", ())
        if entry["module"] == module
        for becomes in entry["becomes"]
    }
    lived: set[tuple[str, str, str, str]] = set()

    def said(mutant: Mutant, killed: bool) -> None:
        why = reasons.get(mutant.key)
        progress.note(mutant, killed=killed, why=why)
        result.killed += killed
        if not killed and why is not None:
            lived.add(mutant.key)
            result.equivalent += 1
        elif not killed:
            result.survivors.append(mutant)

    if judged:
        judge(root, module, plan["tests"][module], judged, said)
    result.survivors.sort(key=lambda mutant: mutant.line)
    result.stale = [f"{function}: {was} → {becomes}" for _, function, was, becomes in reasons.keys() - lived - others]
    result.took_s = time.monotonic() - begun_s
    return result


def _print_table(results: Sequence[Result]) -> None:
    for result in results:
        for mutant in result.survivors:
            print(f"survived: {mutant.diff}\n")
        for entry in result.stale:
            print(f"in the plan, and no surviving mutant: {result.module} {entry}\n")
    head = ("module", "mutants", "killed", "equivalent", "survived", "percent", "seconds")
    rows = [
        (r.module, r.mutants, r.killed, r.equivalent, len(r.survivors), f"{r.percent:.1f}", f"{r.took_s:.0f}")
        if r.mutants
        else (r.module, 0, 0, 0, 0, "–", "–")  # nothing of it was drawn
        for r in (*results, _total(results))
    ]
    width = max(len(str(row[0])) for row in (head, *rows))
    for first, *numbers in (head, ("-" * width, *(f"{'-' * (len(name) - 1)}:" for name in head[1:])), *rows):
        cells = (f"{number:>{len(name)}}" for name, number in zip(head[1:], numbers, strict=True))
        print(f"| {first:{width}} | {' | '.join(cells)} |")


def _total(results: Sequence[Result]) -> Result:
    total = Result("all", 0)
    for result in results:
        total.mutants += result.mutants
        total.killed += result.killed
        total.equivalent += result.equivalent
        total.survivors += result.survivors
        total.took_s += result.took_s
    return total


if __name__ == "__main__":
    sys.exit(main())
