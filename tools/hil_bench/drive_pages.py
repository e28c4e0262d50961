"""Pages that show the recorded drives of a run, for the links of its report.

They are written after the last case: a case must not be late because of the page of another one.
"""

import subprocess
from pathlib import Path

import msgspec

from hil_bench.bench_config import BenchConfig
from hil_bench.case import Case
from hil_bench.device import fill_template
from hil_bench.places import CHECKOUT
from hil_bench.result import CaseResult, Run

TIMEOUT_S = 300.0


def is_shown(config: BenchConfig, case: Case) -> bool:
    """Whether the device records the drive of this case for a page."""
    return bool(config.commands.export) and case.is_manoeuvre and case.armed and not case.recorded_mib


def write_pages(run: Run, folder: Path, command: str) -> Run:
    """Write a page for each case with a recording, and return the run with their names.

    Without a command there are none; of an interrupted run they are written when it is continued.
    """
    if not command or run.interrupted:
        return run
    return msgspec.structs.replace(run, cases=[_write_page(case, folder, command) for case in run.cases])


def _write_page(case: CaseResult, folder: Path, command: str) -> CaseResult:
    if not case.recording:
        return case
    stem = case.recording.removesuffix(".recording")
    page = f"{stem}.html"
    values = {"record": str((folder / case.recording).resolve()), "page": str((folder / page).resolve())}
    problem = _run(fill_template(command, values))
    if not problem and not (folder / page).is_file():
        problem = f"{command}: wrote no {page}"
    if problem:
        page = f"{stem}.page.log"
        (folder / page).write_text(f"{problem}\n", encoding="utf-8")
    return msgspec.structs.replace(case, page=page)


def _run(command: list[str]) -> str:
    """Run a command; return why it failed, empty if it did not."""
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            cwd=CHECKOUT,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    return "" if done.returncode == 0 else f"exit status {done.returncode}: {done.stdout}{done.stderr}"
