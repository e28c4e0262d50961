"""State sample in, command pair out: the whole program beside a bare socket loop and the usual python-can loops.

Contestants: an echo (frames in, fixed frames out); a bare socket loop (hand-packed bytes, the same pure pursuit, no
gate, no telemetry); ours, as `vehicle-iface run --arm` builds it, and in the first part the same without the C code of
the wire; python-can with cantools in a loop, its controller looking for the nearest point on the whole course (567
points) as PythonRobotics does, or onwards from the last one; python-can's Notifier with a queue and a timer of 10 ms.
All but the echo check and make the CRCs, with one C function.

Three parts: one whole pass in one process; the reaction of whole processes on vcan by kernel stamps; system calls of a
sample, clock reads left out. The last two need SocketCAN: where there is none they run within `tools/vcan`, whose
system calls are some hundred times as slow as usual: what holds there is who is how far from whom.

Takes 3 min; --quick 1 min.

Target: a pass at most 1.6 times the bare loop's, at most a third of python-can's; on vcan at most a third of what
python-can adds to the echo, the median within a tenth of the period; a system call a frame and one more.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.parts.process import ROOT, run_part
from benchmarks.parts.reaction_pass import HOT, IDLE
from benchmarks.parts.report import BenchmarkError, Cell, Report, Table, Target, progress
from vehicle_iface.control import pure_pursuit

OURS, BARE, ECHO, PYTHON_CAN = "ours", "bare", "echo", "python-can"
PERIOD_US = 10_000.0
FRAMES_HEARD, FRAMES_SENT = 3.5, 2.2
"""Of a sample: three and every other time a status; a pair and every tenth time lights and a report."""
BUS_CALLS = ("recvmmsg", "poll", "sendto", "sendmsg", "sendmmsg", "getsockopt")
"""Waiting, receiving, sending, and asking whether the last command has left."""
QUANTILES = (("p50", 0.5), ("p95", 0.95), ("p99", 0.99), ("max", 1.0))


def run(options: argparse.Namespace) -> Report:
    """All three parts."""
    hot, idle, rounds, samples = (40, 40, 2, 50) if options.quick else (600, 600, 8, 200)
    progress("one whole pass, in one process …")
    passes = run_part("reaction_pass", hot, idle)
    _require_answers(passes)
    progress("whole processes on vcan …")
    on_vcan = run_part("reaction_vcan", rounds, samples, prefix=_vcan())
    progress("")
    tables = [_pass_table(passes), _wire_table(on_vcan["latencies"]), *_call_tables(on_vcan["calls"])]
    targets = [*_pass_targets(passes), *_wire_targets(on_vcan["latencies"]), *_call_targets(on_vcan["calls"])]
    return Report(
        method=(
            f"Part 1: {hot} blocks of 10 hot passes and {idle} passes after 4 ms idle of each, in turns; AF_UNIX "
            "socket pairs in the place of CAN sockets, for all. Parts 2 and 3: "
            f"{rounds} rounds of {samples} samples at 100 Hz, in turns, on vcan "
            f"{'of a user-mode kernel' if _vcan() else 'here'}. All have SCHED_FIFO where it is granted; part 1 has "
            "one CPU."
        ),
        tables=tables,
        targets=targets,
        notes=_notes(on_vcan["calls"]),
    )


def _vcan() -> list[str]:
    """How to get to a SocketCAN: nothing where it is."""
    return [] if Path("/sys/class/net/vcan0").exists() else [sys.executable, str(ROOT / "tools" / "vcan")]


def quantile(values: Sequence[float], share: float) -> float:
    """The value that `share` of all are at or below."""
    ordered = sorted(values)
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


# ── one whole pass ──


def _require_answers(passes: Mapping[str, Any]) -> None:
    """Figures of the few passes that were answered would say nothing of the others."""
    for name, found in passes.items():
        answered = sum(len(took) for took in found["passes_us"].values())
        if found["unanswered"] > 0.02 * answered:
            raise BenchmarkError(f"{name} has not answered {found['unanswered']} samples rightly, but {answered}")


def _pass_table(passes: Mapping[str, Any]) -> Table:
    rows: list[Sequence[Cell]] = []
    for how in (HOT, IDLE):
        for name, found in passes.items():
            took = found["passes_us"][how]
            spread = [quantile(took, share) for _, share in QUANTILES[:3]]
            to_bare = median(took) / median(passes[BARE]["passes_us"][how])
            out = median(found["sent_us"][how])
            rows.append([name, how, *spread, out, to_bare, len(took), found["unanswered"]])
    columns = ["contestant", "pass", "p50 µs", "p95 µs", "p99 µs", "second command out p50 µs", "to bare"]
    return Table(title="One whole pass", columns=[*columns, "passes", "not answered rightly"], rows=rows)


def _pass_targets(passes: Mapping[str, Any]) -> list[Target]:
    targets = []
    for how in (HOT, IDLE):
        p50 = {name: median(found["passes_us"][how]) for name, found in passes.items()}
        targets.append(
            Target(what=f"pass to the bare loop's, {how}", value=p50[OURS] / p50[BARE], at_most=1.6, unit="x")
        )
        what = f"python-can's pass to ours, {how}"
        targets.append(Target(what=what, value=p50[PYTHON_CAN] / p50[OURS], at_least=3.0, unit="x"))
    return targets


# ── whole processes ──


def _wire_table(latencies: Mapping[str, Any]) -> Table:
    rows: list[Sequence[Cell]] = []
    for name, found in latencies.items():
        for which in ("first", "second"):
            took_us = [1e6 * value for value in found[f"{which}_s"]]
            spread = [quantile(took_us, share) for _, share in QUANTILES]
            added = spread[0] - 1e6 * median(latencies[ECHO][f"{which}_s"])
            rows.append([name, which, *spread, added, len(took_us), found["unanswered"], found["stops"]])
    columns = ["contestant", "command", *(f"{name} µs" for name, _ in QUANTILES), "p50 over echo µs"]
    title = "Reaction on vcan: from the stamp of a sample's last frame to a command's, kernel stamps of another process"
    return Table(title=title, columns=[*columns, "samples", "unanswered", "stops"], rows=rows)


def _wire_targets(latencies: Mapping[str, Any]) -> list[Target]:
    second = {name: 1e6 * median(found["second_s"]) for name, found in latencies.items()}
    added = {name: value - second[ECHO] for name, value in second.items()}
    what = "latency over the echo's, to python-can's, second command"
    return [
        Target(what=what, value=added[OURS] / added[PYTHON_CAN], at_most=1 / 3, unit="x"),
        Target(
            what="median of the second command to the period", value=second[OURS] / PERIOD_US, at_most=0.1, unit="x"
        ),
    ]


# ── system calls ──


def _call_tables(calls: Mapping[str, Mapping[str, float]] | None) -> list[Table]:
    if calls is None:
        return []
    rows: list[Sequence[Cell]] = [
        [name, sum(found.values()), ", ".join(f"{call} {count:.2f}" for call, count in sorted(found.items()))]
        for name, found in calls.items()
    ]
    return [
        Table(
            title="System calls of a sample, clock reads left out", columns=["contestant", "calls", "which"], rows=rows
        )
    ]


def _call_targets(calls: Mapping[str, Mapping[str, float]] | None) -> list[Target]:
    if calls is None:
        return []
    what = "system calls of a sample beyond one a frame"
    beyond = sum(calls[OURS].values()) - FRAMES_HEARD - FRAMES_SENT
    others = sum(count for call, count in calls[OURS].items() if call not in BUS_CALLS)
    return [
        Target(what=what, value=beyond, at_most=1.0),
        Target(
            what="system calls of a sample that are not the bus's: what publishing adds", value=others, at_most=0.05
        ),
    ]


def _build_note() -> str:
    """Whose controller the bare loop has: a user's is interpreted, and so is ours unless it was compiled."""
    is_interpreted = str(pure_pursuit.__file__).endswith(".py")
    if is_interpreted:
        return "the controller is interpreted, so the bare loop is both what a user would write and of the same build"
    return "the controller is compiled, in the bare loop as well: what a user would write takes longer than that"


def _notes(calls: object) -> list[str]:
    notes = [
        _build_note(),
        "the notifier answers on its own timer: the command after a sample may be computed from the one before it",
    ]
    return (
        notes if calls is not None else [*notes, "part 3 is missing: strace is not installed (apt-get install strace)"]
    )
