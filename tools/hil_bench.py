#!/usr/bin/env python3
"""Is a controller on a CAN bus fit to drive? Plays the vehicle, breaks things on purpose, and judges from outside."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

TOOLS = Path(__file__).resolve().parent
PYTHON = TOOLS.parent / ".venv" / "bin" / "python"
NEEDS = ("cantools", "jinja2", "msgspec", "rich")


def use_own_python() -> None:
    """Go on with the project's own Python, made if it is missing, unless this one has everything."""
    missing = [name for name in NEEDS if find_spec(name) is None]
    if not missing:
        return
    if Path(sys.prefix) == PYTHON.parents[1]:
        sys.exit(f"hil_bench: {PYTHON} lacks {', '.join(missing)}; run: tools/test tests/hil")
    if subprocess.run(["bash", "-c", f"source '{TOOLS}/_setup.sh' && set_up", "hil_bench.py"], check=False).returncode:
        sys.exit("hil_bench: its Python could not be set up, see above")
    os.execv(PYTHON, [str(PYTHON), *sys.argv])


if __name__ == "__main__":
    use_own_python()
    sys.path.insert(0, str(TOOLS))
    from hil.cli import main

    sys.exit(main())
