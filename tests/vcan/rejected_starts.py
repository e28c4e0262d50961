"""A process that starts the loop on vcan0 with several lists of arguments in turn: `rejected_starts.py FILE.json`.

One process runs all of them, because most of a start is importing. A start that is not rejected drives for a second.
"""

import json
import sys
from pathlib import Path

from vehicle_iface.cli import main


def start_all(file: str) -> None:
    """Run each list of arguments and print its exit status."""
    for arguments in json.loads(Path(file).read_text(encoding="utf-8")):
        status = main(arguments)
        print(f"status {status}", flush=True)


if __name__ == "__main__":
    start_all(*sys.argv[1:])
