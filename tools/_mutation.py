"""`tools/mutation`: which changes of the code does no test notice?

The plan, `tools/mutation.toml`, says which tests answer for which module, and which mutants mean the same as the
code, with the reason. Ends with 0 when all others are killed, with 1 when one survived or the plan names one that is
none, with 2 when it could not be found out.
"""

import argparse
import importlib
import json
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from _mutation_judge import BaselineError, judge
from _mutation_mutants import Mutant, mutants

HERE = Path(__file__).resolve().parent
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
    """Entries of the plan that fit no mutant that lives."""
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
        """One more is judged; one that lives without a reason is shown at once."""
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
        modules = _chosen(root, plan["tests"], options.modules, options.since)
    except (LookupError, subprocess.CalledProcessError) as error:
        print(f"mutation: {error}", file=sys.stderr)
        return 2
    for name in plan.get("warm", ()):
        importlib.import_module(name)
    found = {module: mutants(module, (root / module).read_bytes()) for module in modules}
    progress = Progress(sum(map(len, found.values())))
    try:
        results = [_result(root, module, plan, found[module], progress) for module in modules]
    except BaselineError as error:
        print(f"mutation: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps({"modules": [result.as_json() for result in results]}, indent=2))
    else:
        _print_table(results)
    return 1 if any(result.survivors or result.stale for result in results) else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tools/mutation", description=__doc__)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="a path of the plan, or its end; all without one")
    parser.add_argument("--since", metavar="REV", help="only modules that changed, or whose tests did, since REV")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--plan", default=str(HERE / "mutation.toml"), help="default: %(default)s")
    parser.add_argument("--root", default=str(HERE.parent), help="of the project; default: %(default)s")
    return parser.parse_args(arguments)


def _chosen(root: Path, tests: dict[str, list[str]], wanted: Sequence[str], since: str | None) -> list[str]:
    for name in wanted:
        if not any(module.endswith(name) for module in tests):
            raise LookupError(f"{name}: not in the plan, which has {', '.join(tests)}")
    modules = [module for module in tests if not wanted or module.endswith(tuple(wanted))]
    if since is None:
        return modules
    command = ["git", "-C", str(root), "diff", "--name-only", "--relative", since, "--"]
    changed = set(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines())
    return [module for module in modules if not changed.isdisjoint((module, *tests[module]))]


def _result(root: Path, module: str, plan: dict[str, Any], found: list[Mutant], progress: Progress) -> Result:
    result, begun_s = Result(module, len(found)), time.monotonic()
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

    judge(root, module, plan["tests"][module], found, said)
    result.survivors.sort(key=lambda mutant: mutant.line)
    result.stale = [f"{function}: {was} → {becomes}" for _, function, was, becomes in reasons.keys() - lived]
    result.took_s = time.monotonic() - begun_s
    return result


def _print_table(results: Sequence[Result]) -> None:
    for result in results:
        for mutant in result.survivors:
            print(f"survived: {mutant.diff}\n")
        for entry in result.stale:
            print(f"not a mutant that lives, yet in the plan: {result.module} {entry}\n")
    width = max((len(result.module) for result in results), default=6)
    print(f"{'module':{width}} mutants  killed  equivalent  survived  percent  seconds")
    total = Result("all", 0)
    for result in results:
        total.mutants += result.mutants
        total.killed += result.killed
        total.equivalent += result.equivalent
        total.survivors += result.survivors
        total.took_s += result.took_s
    for row in (*results, total):
        print(
            f"{row.module:{width}} {row.mutants:7d} {row.killed:7d} {row.equivalent:11d} {len(row.survivors):9d}"
            f" {row.percent:8.1f} {row.took_s:8.1f}"
        )
