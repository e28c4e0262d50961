"""Another process that starts the loop on vcan0 with one list of arguments after another: `refused.py FILE.json`.

In one process, because most of a start is importing. What is not refused drives for a second.
"""

import json
import sys
from pathlib import Path

from vehicle_iface.cli import main


def start_all(file: str) -> None:
    """Say how each ended."""
    for arguments in json.loads(Path(file).read_text(encoding="utf-8")):
        status = main(arguments)
        print(f"status {status}", flush=True)


if __name__ == "__main__":
    start_all(*sys.argv[1:])
