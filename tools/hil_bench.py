#!/usr/bin/env python3
"""Is a controller on a CAN bus fit to drive? Plays the vehicle, breaks things on purpose, and judges from outside."""

import os
import subprocess
import sys
from pathlib import Path

TOOLS = Path(__file__).resolve().parent
PYTHON = TOOLS.parent / ".venv" / "bin" / "python"

try:
    import cantools  # noqa: F401  # is it the project's own Python?
    import jinja2  # noqa: F401
    import rich  # noqa: F401
except ImportError:
    if Path(sys.prefix) == PYTHON.parents[1]:
        raise
    subprocess.run(["bash", "-c", f"source '{TOOLS}/_setup.sh' && set_up"], check=True)
    os.execv(PYTHON, [str(PYTHON), *sys.argv])

sys.path.insert(0, str(TOOLS))
from hil.cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
