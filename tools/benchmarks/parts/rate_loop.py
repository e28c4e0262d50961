"""One rate of the `rate` benchmark: the whole program here, the vehicle in a second process; the outcome as JSON."""

import json
import os
import sys
import time
from dataclasses import asdict

from benchmarks.parts.long_work_passes import drive
from benchmarks.parts.rate_sender import AHEAD_S, send


def measure(rate_hz: int, seconds: int) -> dict[str, float]:
    """What the sender counted."""
    with drive() as bench:
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            outcome = send(bench.runner.far, bench.runner.vehicle, rate_hz, seconds)
            os.write(writing, json.dumps(asdict(outcome)).encode())
            os._exit(0)
        os.close(writing)
        end_s = time.monotonic() + seconds + 3.0 * AHEAD_S
        while time.monotonic() < end_s:
            bench.loop.step()
        with open(reading, encoding="utf-8") as pipe:
            found: dict[str, float] = json.loads(pipe.read())
        os.waitpid(child, 0)
        return found


def main() -> None:
    print(json.dumps(measure(*map(int, sys.argv[1:]))))


if __name__ == "__main__":
    main()
