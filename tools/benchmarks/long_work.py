"""The longest pass while there is long work to do: accepting trajectories, logging, telemetry, collecting garbage.

One process, as `reaction` has it: the whole program on a socket pair, three frames in, two commands out, a pass each
2.5 ms. Each kind of work begins between two passes, and what it costs within them is measured: how long the longest
pass is beyond the median of those without work, and for how many passes the work lasts. Time is the CPU time of the
loop's thread, which other programs on the machine lengthen less than the time of day.

Garbage: a controller that keeps 100,000 objects of its own and makes 700 more each pass has the loop collect garbage
after each pass; a full collection looks at all of them.

Takes 25 s; --quick 8 s.

Target: no pass is longer by more than 1 ms while a trajectory of 1,000,000 or 20,000 points is accepted, a line is
logged or the counters are published.
"""

import argparse
from collections.abc import Sequence
from statistics import median

from benchmarks.parts.long_work_passes import GARBAGE, LONG_TRAJECTORY, NOTHING, POSTED_TRAJECTORY
from benchmarks.parts.process import run_part
from benchmarks.parts.report import BenchmarkError, Cell, Report, Table, Target, progress

MOST_MS = 1.0
ATTEMPTS = 3


def run(options: argparse.Namespace) -> Report:
    """All kinds of work in turn, in a process of its own."""
    passes = 100 if options.quick else 1000
    progress("passes with long work …")
    found = _undisturbed(passes)
    progress("")
    usual_ms = median(found[NOTHING])
    rows: list[Sequence[Cell]] = [
        (name, len(took_ms), median(took_ms), sorted(took_ms)[int(0.99 * len(took_ms))], max(took_ms))
        for name, took_ms in found.items()
    ]
    return Report(
        method=f"at least {passes} passes of each kind, on one CPU; CPU time of the loop's thread",
        tables=[Table(title="passes", columns=("work", "passes", "p50 ms", "p99 ms", "longest ms"), rows=rows)],
        targets=[
            Target(
                what=f"longest pass beyond the usual: {name}", value=max(took_ms) - usual_ms, at_most=MOST_MS, unit="ms"
            )
            for name, took_ms in found.items()
            if name not in (NOTHING, GARBAGE)
        ],
        notes=[
            f"a trajectory of 1,000,000 points is accepted in {len(found[LONG_TRAJECTORY])} passes, "
            f"one of 20,000 in {len(found[POSTED_TRAJECTORY])}",
            "full collections depend on the controller alone: the loop leaves no garbage, and what exists at the start "
            "is not looked at",
        ],
    )


def _undisturbed(passes: int) -> dict[str, list[float]]:
    """Milliseconds by work. Where the machine held the loop up so long that it stopped the vehicle, once more."""
    for _ in range(ATTEMPTS):
        found: dict[str, list[float]] = run_part("long_work_passes", passes)
        if all(found.values()):
            return found
    raise BenchmarkError(f"the vehicle was stopped in each of {ATTEMPTS} attempts: the machine is too busy")
