"""Runs a part of a benchmark in a process of its own, which gets real-time rights that nobody else shall have."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.parts.report import BenchmarkError

ROOT = Path(__file__).resolve().parents[3]


def run_part(module: str, *arguments: int, prefix: Sequence[str] = ()) -> Any:
    """Return what a part printed as JSON in its last line. Raises `BenchmarkError` when it fails."""
    environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'tools'}:{ROOT}"}
    command = [*prefix, sys.executable, "-P", "-m", f"benchmarks.parts.{module}", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT, stdin=subprocess.DEVNULL)
    if done.returncode != 0:
        raise BenchmarkError(f"{module} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])
