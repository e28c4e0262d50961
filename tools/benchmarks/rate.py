"""The greatest rate of frames at which none is lost, on a socket pair: 1 to 8 kHz, each for some seconds.

One process has the whole program, as `reaction` has it. Another sends three frames for each sample and takes the
commands out. A pair of AF_UNIX sockets holds no more than `net.unix.max_dgram_qlen` frames (10 unless it was
changed): a frame that finds no room is lost, as on a CAN socket whose buffer is full. That holds far more, so this is
the harder test. Both have SCHED_FIFO where it is granted, and one CPU each where there are two.

Takes 60 s; --quick 5 s.

Target: no frame is lost at 6 kHz.
"""

import argparse
from collections.abc import Sequence

from benchmarks.parts.process import run_part
from benchmarks.parts.rate_sender import Outcome
from benchmarks.parts.report import Cell, Report, Table, Target, progress

RATES_HZ = (1000, 2000, 3000, 4000, 6000, 8000)
TARGET_HZ = 6000


def run(options: argparse.Namespace) -> Report:
    """Each rate in a process of its own."""
    seconds, rates_hz = (1, (TARGET_HZ,)) if options.quick else (5, RATES_HZ)
    found = {}
    for rate_hz in rates_hz:
        progress(f"{rate_hz} frames per second …")
        found[rate_hz] = Outcome(**run_part("rate_loop", rate_hz, seconds))
    progress("")
    rows: list[Sequence[Cell]] = [
        (rate_hz, one.frames, one.lost, one.commands / max(one.samples, 1), one.late_ms)
        for rate_hz, one in found.items()
    ]
    columns = ("frames/s", "sent", "lost", "command pairs per sample", "sender late by at most ms")
    return Report(
        method=f"{seconds} s at each rate",
        tables=[Table(title="sustained rate", columns=columns, rows=rows)],
        targets=[Target(what=f"frames lost at {TARGET_HZ} Hz", value=found[TARGET_HZ].lost, at_most=0)],
    )
