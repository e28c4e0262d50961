"""How late the loop wakes up while eight pages are open, one of them stopped, against none; and what the pages cost.

The control process is that of `pacing`: `vehicle-iface run` on the embedded bus at 100 Hz with SCHED_FIFO. The viewer
is a process of its own. A page is a client of its protocol that reads all it is sent and draws nothing, as if it were
on another machine; seven are one process, the eighth is another, which is stopped (SIGSTOP). "None" means that viewer
and pages are stopped.

Takes 1 min; --quick 20 s.

Target: p99 with eight pages at most 1.1 times that of none.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Self

from benchmarks.pacing import FIFO, MS_NS, QUANTILES, ROOT, Control, Found, quantile
from benchmarks.parts.report import Cell, Report, Table, Target, progress

PAGES = 8
NONE, WATCHED = "none", f"{PAGES} pages, one stopped"
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


class Pages:
    """A viewer with its pages; stopped at first."""

    def __init__(self, address: str) -> None:
        self._environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'tools'}:{ROOT}"}
        self._viewer = self._start("vehicle_iface_viewer", "--connect", address, "--port", "0")
        url = self._read_line(self._viewer).partition(" ")[2].partition(" ")[0]
        self._readers = self._start("benchmarks.parts.page_clients", url, str(PAGES - 1))
        self._stopped = self._start("benchmarks.parts.page_clients", url, "1")
        for process in (self._readers, self._stopped):
            self._read_line(process)
        self._stopped.send_signal(signal.SIGSTOP)
        self._cpu_s = self._watched_s = 0.0
        self._first_bytes = self._received()
        self.freeze()

    def freeze(self) -> None:
        """None of them takes any time from now on."""
        for process in (self._viewer, self._readers):
            process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """All but the stopped page go on."""
        for process in (self._viewer, self._readers):
            process.send_signal(signal.SIGCONT)

    def watch(self, control: Control) -> None:
        """Show a drive until it ends."""
        began_s, used_s = time.monotonic(), self._used_s()
        self.thaw()
        control.start()
        control.wait()
        self._watched_s += time.monotonic() - began_s
        self._cpu_s += self._used_s() - used_s
        self.freeze()

    def describe(self) -> list[Cell]:
        """CPU of the viewer in %, its memory in MB, kB/s of each page that reads."""
        self.thaw()
        status = Path(f"/proc/{self._viewer.pid}/status").read_text(encoding="utf-8")
        memory_kb = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
        rate = (self._received() - self._first_bytes) / (PAGES - 1) / 1e3 / self._watched_s
        return [100.0 * self._cpu_s / self._watched_s, memory_kb / 1024.0, rate]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in (self._stopped, self._readers, self._viewer):
            process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait()

    def _start(self, module: str, *arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-P", "-m", module, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            env=self._environment,
            cwd=ROOT,
        )

    def _read_line(self, process: subprocess.Popen[str]) -> str:
        assert process.stdout is not None
        return process.stdout.readline()

    def _received(self) -> int:
        """Bytes that the pages have read so far."""
        self._readers.send_signal(signal.SIGUSR1)
        return int(self._read_line(self._readers))

    def _used_s(self) -> float:
        """CPU time of the viewer."""
        parts = Path(f"/proc/{self._viewer.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(parts[11]) + int(parts[12])) / TICKS_PER_S


def run(options: argparse.Namespace) -> Report:
    """Both in turns, pooled."""
    rounds, seconds = (1, 3.0) if options.quick else (5, 4.0)
    found = {NONE: Found(), WATCHED: Found()}
    with tempfile.TemporaryDirectory() as folder:
        address = f"{folder}/telemetry"
        with Pages(address) as pages:
            for number in range(rounds):
                for how in (NONE, WATCHED) if number % 2 == 0 else (WATCHED, NONE):
                    progress(f"round {number + 1} of {rounds}: {how} …")
                    control = Control("reference", address, seconds, FIFO)
                    if how == WATCHED:
                        pages.watch(control)
                    else:
                        control.start()
                    found[how].add(control.found())
            costs = pages.describe()
    progress("")
    p99s_ns = {how: quantile(one.late_ns, 0.99) for how, one in found.items()}
    return Report(
        method=f"{rounds} interleaved rounds of {seconds:g} s at 100 Hz, SCHED_FIFO, pooled; two wake-ups a period.",
        tables=[
            Table(
                title="Lateness of wake-ups",
                columns=["pages", *(f"{name} ms" for name, _ in QUANTILES), "later than 1 ms %", "wake-ups"],
                rows=[_row(how, one) for how, one in found.items()],
            ),
            Table(
                title=f"The viewer with {PAGES} pages",
                columns=["CPU, % of a core", "memory MB", "kB/s a page"],
                rows=[costs],
            ),
        ],
        targets=[
            Target(
                what=f"p99 with {PAGES} pages, one of them stopped, to none",
                value=p99s_ns[WATCHED] / p99s_ns[NONE],
                at_most=1.1,
                unit="x",
            )
        ],
    )


def _row(how: str, one: Found) -> Sequence[Cell]:
    spread = [quantile(one.late_ns, share) / MS_NS for _, share in QUANTILES]
    return [how, *spread, 100.0 * one.late_share, len(one.late_ns)]
