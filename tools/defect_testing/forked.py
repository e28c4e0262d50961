"""Runs cases in virtual time in a copy of the project, in a fork of this process: all but the controllers is loaded."""

import importlib
import multiprocessing
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from defect_testing.plan import ROOT

OF_THE_COPY = tuple(f"{ROOT / folder}/" for folder in ("vehicle_iface", "tests"))
"""Where the modules are that a defect may change."""


def run_virtual_cases(root: Path, log: Path, words: Sequence[str], longest_s: float) -> bool:
    """`tests/hil_bench/virtual_cases.py` of the copy with these words; False if it took too long."""
    importlib.import_module("numpy")
    process = multiprocessing.get_context("fork").Process(target=_run, args=(root, log, words), daemon=True)
    process.start()
    process.join(longest_s)
    was_in_time = process.exitcode is not None
    process.kill()
    process.join()
    return was_in_time


def _run(root: Path, log: Path, words: Sequence[str]) -> None:
    output = os.open(log, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(root)
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(OF_THE_COPY):
            del sys.modules[name]
    sys.path[:0] = [str(root), str(root / "viewer"), str(root / "tests" / "hil_bench")]
    sys.argv = ["virtual_cases.py", *words]
    importlib.import_module("virtual_cases").main()
