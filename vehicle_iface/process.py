"""Start a module of this installation as a process of its own."""

import os
import sys
from pathlib import Path


def module_command(name: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment that run a module of this installation, whatever is in the current folder."""
    home = Path(__file__).resolve().parents[1]
    folders = [str(home)]
    if (home / "viewer" / "vehicle_iface_viewer").is_dir():  # a checkout; a wheel has both packages side by side
        folders.append(str(home / "viewer"))
    if path := os.environ.get("PYTHONPATH"):
        folders.append(path)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(folders)}
    return [sys.executable, "-P", "-m", name], environment
