"""What a benchmark found, as a table for people and as JSON for programs, with the machine above it."""

import json
import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from vehicle_iface.runtime import realtime

Cell = str | int | float | None


class BenchmarkError(Exception):
    """The comparison would not be fair, or cannot be made: says what is wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Some rows of figures."""

    title: str
    columns: Sequence[str]
    """Names, with the unit where there is one."""
    rows: Sequence[Sequence[Cell]]
    """One cell for each column; None where there is nothing to say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What is to be reached, and what was."""

    what: str
    value: float
    at_least: float | None = None
    at_most: float | None = None
    unit: str = ""

    @property
    def is_reached(self) -> bool:
        above = self.at_least is None or self.value >= self.at_least
        return above and (self.at_most is None or self.value <= self.at_most)

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit and self.unit != "x" else self.unit
        bound = f"at least {self.at_least:g}" if self.at_most is None else f"at most {self.at_most:g}"
        verdict = "reached" if self.is_reached else "MISSED"
        return f"{verdict:<8} {self.what}: {_shown(self.value)}{unit}, target {bound}{unit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """All that a benchmark has to say."""

    method: str
    """How it was measured: rounds, batches, what the quantiles are of."""
    tables: Sequence[Table]
    targets: Sequence[Target]
    notes: Sequence[str] = ()


def as_text(name: str, report: Report) -> str:
    """For a terminal."""
    machine = ", ".join(f"{value}" for value in _machine_words(machine_here()))
    lines = [f"{name} on {machine}", report.method]
    for table in report.tables:
        lines += ["", table.title, *_aligned(table)]
    lines += ["", *(f"  {target}" for target in report.targets), *(f"  note: {note}" for note in report.notes)]
    return "\n".join(lines)


def as_json(name: str, report: Report) -> str:
    """For programs."""
    targets = [{**asdict(target), "is_reached": target.is_reached} for target in report.targets]
    whole = {"benchmark": name, "machine": machine_here(), **asdict(report), "targets": targets}
    return json.dumps(whole, indent=2, allow_nan=False)


def machine_here() -> dict[str, str | int | bool]:
    """What the figures depend on."""
    info = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace") if sys.platform == "linux" else ""
    words = dict(line.split(":", 1) for line in info.splitlines() if ":" in line)
    found = {key.strip(): value.strip() for key, value in words.items()}
    return {
        "cpu": found.get("model name") or platform.processor() or platform.machine(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "kernel": f"{platform.system()} {platform.release()}",
        "realtime": realtime.may_fifo(),
        "user_mode_kernel": found.get("vendor_id") == "User Mode Linux",
    }


def progress(text: str) -> None:
    """In place on a terminal, else a line."""
    print(f"\r\033[K{text}" if sys.stderr.isatty() else text, end="" if sys.stderr.isatty() else "\n", file=sys.stderr)
    sys.stderr.flush()


def _machine_words(machine: dict[str, str | int | bool]) -> list[str]:
    kernel = "user-mode kernel" if machine["user_mode_kernel"] else "no user-mode kernel"
    priority = "SCHED_FIFO" if machine["realtime"] else "no permission for SCHED_FIFO"
    python, system = str(machine["python"]), f"{machine['kernel']} ({kernel})"
    return [str(machine["cpu"]), f"{machine['cores']} cores", priority, python, system]


def _aligned(table: Table) -> list[str]:
    cells = [list(table.columns), *([_shown(cell) for cell in row] for row in table.rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    is_text = [any(isinstance(row[index], str) for row in table.rows) for index in range(len(widths))]
    return [
        "  "
        + "  ".join(
            f"{cell:{'<' if left else '>'}{width}}" for cell, width, left in zip(row, widths, is_text, strict=True)
        )
        for row in cells
    ]


def _shown(cell: Cell) -> str:
    """Floats with three significant figures at least."""
    if cell is None:
        return "-"
    if not isinstance(cell, float):
        return cell if isinstance(cell, str) else f"{cell:,}"
    return f"{cell:,.0f}" if abs(cell) >= 1000 else f"{cell:.1f}" if abs(cell) >= 100 else f"{cell:.3g}"
