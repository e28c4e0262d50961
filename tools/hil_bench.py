#!/usr/bin/env python3
"""Test a controller on a CAN bus: play the vehicle, inject faults, and judge from outside (package `hil_bench`)."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

TOOLS = Path(__file__).resolve().parent
PYTHON = TOOLS.parent / ".venv" / "bin" / "python"


def use_own_python(needs: tuple[str, ...]) -> None:
    """Continue in the project's own Python, created if it is missing, unless this one has every package."""
    missing = [name for name in needs if find_spec(name) is None]
    if not missing:
        return
    if Path(sys.prefix) == PYTHON.parents[1]:
        sys.exit(f"hil-bench: {PYTHON} lacks {', '.join(missing)}; run: tools/test tests/hil_bench")
    if subprocess.run(["bash", "-c", f"source '{TOOLS}/_setup.sh' && set_up", "hil_bench.py"], check=False).returncode:
        sys.exit("hil-bench: its Python could not be set up, see above")
    os.execv(PYTHON, [str(PYTHON), *sys.argv])


if __name__ == "__main__":
    # Its folder comes first on the path, with `python -P`, too: there the package hides this file of the same name.
    sys.path.insert(0, str(TOOLS))
    from hil_bench.__main__ import NEEDS, main

    use_own_python(NEEDS)
    sys.exit(main())
