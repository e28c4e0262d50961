"""Progress of a run on a terminal, and its summary.

On anything but a terminal there is no moving line and no colour: a line for each finished case.
"""

import atexit
import time
from collections.abc import Sequence

from rich.console import Console
from rich.live import Live
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from hil_bench.report.formatting import (
    attempt,
    clean,
    closest,
    count,
    duration,
    groups,
    main_figure,
    measured_of_limit,
    used,
)
from hil_bench.result import CaseResult, Run, Verdict

REFRESHES_PER_S = 4
"""Few: each takes the interpreter (0.2 ms measured) from the vehicle that this process plays."""
TIGHTEST = 5
"""At most this many passed cases are listed at the end, those closest to a limit."""

_COLOURS = {
    Verdict.PASS: "green",
    Verdict.FAIL: "bold red",
    Verdict.NOT_EXECUTED: "yellow",
    Verdict.NOT_APPLICABLE: "dim",
}


class Progress:
    """A line for each finished case; on a terminal also the current one, with its time.

    `to_error` leaves the output to what a program would read.
    """

    def __init__(self, *, to_error: bool = False, console: Console | None = None) -> None:
        self._console = console or Console(stderr=to_error, highlight=False, soft_wrap=True)
        self._live: Live | None = None
        self._total = 0
        self._done = 0

    def on_run_start(self, total: int) -> None:
        """Announce the number of case results."""
        self._total, self._done = total, 0
        if self._console.is_terminal:
            self._live = Live(console=self._console, refresh_per_second=REFRESHES_PER_S, transient=True)
            self._live.start()
            atexit.register(self._stop)  # the cursor comes back, however the run ends

    def on_case_start(self, name: str, proves: str) -> None:
        if self._live:
            self._live.update(_Current(name, proves, f"{self._done + 1}/{self._total}"))

    def on_case_end(self, case: CaseResult) -> None:
        self._done += 1
        place = f"{self._done:>{len(str(self._total))}}/{self._total}"
        repetition = f" [{case.repetition}]" if case.repetition > 1 else ""
        line = Text.assemble(
            (place, "dim"),
            " ",
            _verdict(case.verdict),
            f"  {clean(case.name) + repetition:<28}  ",
            (f"{clean(main_figure(case))}  ", "" if case.verdict is Verdict.PASS else _COLOURS[case.verdict]),
            (duration(case.duration_s), "dim"),
        )
        self._console.print(line)

    def on_run_end(self, run: Run) -> None:
        """Print what did not pass, what passed narrowly, and the verdict."""
        self._stop()
        for title, cases in (("Not passed", _not_passed(run)), ("Passed, closest to a limit", _tightest(run))):
            if cases:
                self._console.print()
                self._console.print(_table(title, cases))
        self._console.print()
        self._console.print(_conclusion(run))

    def _stop(self) -> None:
        if self._live:
            self._live.stop()
            self._live = None
            atexit.unregister(self._stop)


class _Current:
    """The case that runs now."""

    def __init__(self, name: str, proves: str, place: str) -> None:
        self._text = Text(f"{place} {clean(name)} ", no_wrap=True, overflow="ellipsis")
        self._proves = clean(proves)
        self._begun_s = time.monotonic()
        self._spinner = Spinner("dots")

    def __rich__(self) -> Spinner:
        elapsed = f"{time.monotonic() - self._begun_s:.0f} s  "
        self._spinner.text = Text.assemble(
            self._text, (elapsed, "cyan"), (self._proves, "dim"), no_wrap=True, overflow="ellipsis"
        )
        return self._spinner


def _verdict(verdict: Verdict) -> Text:
    return Text(f"{verdict:<14}", _COLOURS[verdict])


def _not_passed(run: Run) -> list[CaseResult]:
    """Failed ones last, nearest to the reader's eye; without those that an interruption left out."""
    passed = (Verdict.PASS, Verdict.NOT_APPLICABLE)
    left = [group.worst for group in groups(run) if group.verdict not in passed]
    return [case for case in left[::-1] if not run.interrupted or case.why != run.interrupted]


def _tightest(run: Run) -> list[CaseResult]:
    passed = [(_share(group.worst), group.worst) for group in groups(run) if group.verdict is Verdict.PASS]
    ordered = sorted(passed, key=lambda pair: -pair[0])
    return [case for share, case in ordered[:TIGHTEST] if share > 0.0]


def _share(case: CaseResult) -> float:
    check = closest(case)
    return (used(check) or 0.0) if check else 0.0


def _table(title: str, cases: Sequence[CaseResult]) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold", ratio=1)
    for case in cases:
        table.add_row(_verdict(case.verdict), Text(clean(case.name)), Text(clean(case.fault)), Text(_describe(case)))
    return table


def _describe(case: CaseResult) -> str:
    check = closest(case)
    if case.verdict is not Verdict.PASS:
        return clean(case.why)
    if case.void or check is None:
        return clean(attempt(case))
    return clean(f"{measured_of_limit(check)} ({100 * (used(check) or 0.0):.0f} %): {check.text}")


def _conclusion(run: Run) -> Text:
    failed, left, passed = (count(run, v) for v in (Verdict.FAIL, Verdict.NOT_EXECUTED, Verdict.PASS))
    others = count(run, Verdict.NOT_APPLICABLE)
    absent = f", {others} not applicable" if others else ""
    return Text.assemble(
        (str(run.verdict), _COLOURS[run.verdict]),
        f"  {passed} passed, {failed} failed, {left} not executed{absent} in {duration(run.duration_s)}"
        f"{', ' + run.interrupted if run.interrupted else ''}\n",
        ("Evidence: ", "dim"),
        clean(run.evidence),
    )
