"""How a module of this installation is started as a process of its own."""

import os
import sys
from pathlib import Path


def python_module(name: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment that run a module of this installation, whatever lies in the current folder."""
    home = str(Path(__file__).resolve().parents[1])
    path = os.environ.get("PYTHONPATH")
    environment = os.environ | {"PYTHONPATH": f"{home}{os.pathsep}{path}" if path else home}
    return [sys.executable, "-P", "-m", name], environment
