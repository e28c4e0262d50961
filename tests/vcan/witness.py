"""Wakes every 20 ms, before everything else, and prints how late the machine was: seconds, a line each."""

import os
import time
from collections import deque

PERIOD_S = 0.02
WAKES = 10
"""Over so many it adds up: a processor that is taken away for 20 ms over and over is no better than once for 60."""
LATE_S = 0.012
"""Later than this is a machine that stood still: with this priority nothing that runs on it can be the reason. It is
more than a sample's period, so that two samples come at once. On a quiet machine ten wakes add up to some 2 ms."""
FIRST = 90


def watch() -> None:
    """Until the end of the process."""
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIRST))
    print("watching", flush=True)
    late_s: deque[float] = deque(maxlen=WAKES)
    last_s = time.monotonic()
    while True:
        time.sleep(PERIOD_S)
        now_s = time.monotonic()
        late_s.append(now_s - last_s - PERIOD_S)
        if sum(late_s) > LATE_S:
            print(f"{sum(late_s):.3f}", flush=True)
            late_s.clear()
        last_s = now_s


if __name__ == "__main__":
    watch()
