"""Runs a module of tools/ as its launcher does once everything is installed."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ROOT / "tools"


def run_module(module: str, *arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Its status, output and errors."""
    return subprocess.run(
        [sys.executable, "-P", "-m", module, *arguments],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{TOOLS}"},
        stdin=subprocess.DEVNULL,
        cwd=cwd,
    )
