"""The control process: how soon it commands, how much memory it takes and keeps, and when garbage is collected.

Ours is `vehicle-iface run --interface embedded --route figure8 --arm` with its telemetry writer, in a process in which
time passes only when the program sleeps. Start is from before the process exists to the first pair of commands handed
to the bus: the answer to the first sample of a vehicle that is there already (ENABLE = 0, for the protocol wants half a
second of fresh samples before it may drive; that is no program's to hurry). The peer is a process that imports cantools
and loads the same DBC. Memory is VmRSS, with the simulated vehicle inside, which a real bus does not need; the loop
makes its passes as fast as it can. Its real-time claims are all made, but SCHED_FIFO is given back.

Takes 2 min (an hour of samples); --passes 1000000 5 min; --quick 5 s.

Target: start at most 1.5 times the peer's; memory at most 45 MiB, and from a tenth of the passes on it grows by no more
than 256 KiB; no full collection inside a pass; viser not imported.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from subprocess import DEVNULL
from time import perf_counter_ns
from typing import Any

from benchmarks.parts.inputs import DBC_FOLDER
from benchmarks.parts.report import BenchmarkError, Cell, Report, Table, Target, progress
from benchmarks.parts.timing import Spread, in_turns, ratios

HOUR = 360_000
"""Samples at 100 Hz; one pass takes one."""
KIB_IN_MIB = 1024
NS_PER_MS = 1_000_000
MOST_GROWTH_KIB = 256
MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Where the program has its telemetry."""
TELLS = "import os; os.write({fd}, b'\\n')"
CONTROL_PROCESS = "from benchmarks.parts.control_process import main; main()"
PEER = f"import cantools.database; cantools.database.load_file({str(DBC_FOLDER / 'reference.dbc')!r}); {TELLS}"
OURS, CANTOOLS, PYTHON = "first command", "cantools has loaded the DBC", "python is there"


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--passes", type=int, metavar="N", help=f"of the loop, for the memory (default {HOUR:,})")


def run(options: argparse.Namespace) -> Report:
    rounds = 3 if options.quick else 31
    passes = options.passes or (3_000 if options.quick else HOUR)
    with tempfile.TemporaryDirectory(prefix="vehicle-iface-bench-", dir=MEMORY) as folder:
        control_process = ("-c", CONTROL_PROCESS, "{passes}", f"{folder}/telemetry", "{fd}")
        progress(f"start: {rounds} processes of each kind")
        jobs = {
            OURS: partial(_time_to_word, control_process),
            CANTOOLS: partial(_time_to_word, ("-c", PEER)),
            PYTHON: partial(_time_to_word, ("-c", TELLS)),
        }
        took = in_turns(jobs, rounds)
        progress(f"start: {passes} passes")
        seen = json.loads(_process(control_process, passes)[1])
    ratio = ratios(took[OURS], took[CANTOOLS])
    rows: list[Sequence[Cell]] = []
    for name, times in took.items():
        spread, to_peer = Spread.of([one / NS_PER_MS for one in times]), ratios(times, took[CANTOOLS])
        rows.append((name, spread.median, spread.p10, spread.p90, to_peer.median, to_peer.p10, to_peer.p90))
    columns = ("until", "ms", "p10", "p90", "vs cantools", "p10", "p90")
    start = Table(title="process start", columns=columns, rows=rows)
    kib = seen["rss_kib"]
    growth_kib = max(kib[_tenth(kib) :]) - kib[_tenth(kib)]
    return Report(
        method=f"{rounds} rounds of one process each, in turn; ms and ratios are medians of the rounds",
        tables=[start, _memory(seen), _collections(seen)],
        targets=[
            Target(what="start to first command, vs cantools with the DBC", value=ratio.median, at_most=1.5, unit="x"),
            Target(what="memory after the first command", value=kib[0] / KIB_IN_MIB, at_most=45.0, unit="MiB"),
            Target(
                what=f"memory after {seen['samples']:,} samples", value=kib[-1] / KIB_IN_MIB, at_most=45.0, unit="MiB"
            ),
            Target(what="growth from a tenth of them on", value=growth_kib, at_most=MOST_GROWTH_KIB, unit="KiB"),
            Target(what="full collections inside a pass", value=seen["collections"].get("in 2", 0), at_most=0),
            Target(what="viser imported", value=int("viser" in seen["imported"]), at_most=0),
        ],
        notes=[f"imported in the control process, of viser, can, cantools, numpy: {', '.join(seen['imported'])}"],
    )


def _memory(seen: dict[str, Any]) -> Table:
    kib = seen["rss_kib"]
    rows: list[Sequence[Cell]] = [
        (seen["passes"] * at // (len(kib) - 1), one, one - kib[0]) for at, one in enumerate(kib)
    ]
    shown = [row for at, row in enumerate(rows) if at % 4 == 0 or at == _tenth(kib)]
    return Table(title="memory", columns=("passes", "VmRSS KiB", "more than at the first command"), rows=shown)


def _tenth(marks: Sequence[int]) -> int:
    return len(marks) // 10


def _collections(seen: dict[str, Any]) -> Table:
    rows: list[Sequence[Cell]] = [
        (f"generation {number}", *(seen["collections"].get(f"{where} {number}", 0) for where in ("in", "between")))
        for number in range(3)
    ]
    title = f"garbage collections in {seen['passes']:,} passes"
    return Table(title=title, columns=("", "inside a pass", "between passes"), rows=rows)


def _time_to_word(arguments: Sequence[str]) -> int:
    return _process(arguments)[0]


def _environment() -> dict[str, str]:
    """With compiled modules kept, as where a program is installed: compiling ours at each start is not its start."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def _process(arguments: Sequence[str], passes: int = 0) -> tuple[int, str]:
    """A Python process: nanoseconds from before its birth to its first line, and what it said after that."""
    reading, writing = os.pipe()
    command = [sys.executable, "-P", *(word.format(fd=writing, passes=passes) for word in arguments)]
    with tempfile.TemporaryFile() as errors, open(reading, encoding="utf-8") as said:
        begun_ns = perf_counter_ns()
        process = subprocess.Popen(
            command, stdin=DEVNULL, stdout=DEVNULL, stderr=errors, pass_fds=[writing], env=_environment()
        )
        os.close(writing)
        has_spoken = said.readline() == "\n"
        took_ns = perf_counter_ns() - begun_ns
        rest = said.read()
        if process.wait() != 0 or not has_spoken:
            errors.seek(0)
            raise BenchmarkError(f"{' '.join(command)}: {errors.read().decode(errors='replace')}")
    return took_ns, rest
