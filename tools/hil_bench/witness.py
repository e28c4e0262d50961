"""A process of usual priority that wakes up every 7 ms and writes how late: what the host does to any process.

For every 14 wake-ups it writes a `RECORD`: the time of the last one (monotonic, ns), the greatest lateness and the sum
of all latenesses beyond `USUAL_NS` (ns). It imports nothing of the bench: it must start fast.
"""

import os
import struct
import time

PERIOD_NS = 7_000_000
"""No part of the vehicle's period, so that all of that is seen."""
WAKE_UPS = 14
USUAL_NS = 1_000_000
RECORD = struct.Struct("<qqq")


def run() -> None:
    """Until it is killed, or its parent has ended."""
    parent, due_ns = os.getppid(), time.monotonic_ns()
    while os.getppid() == parent:
        worst_ns = total_ns = 0
        for _ in range(WAKE_UPS):
            due_ns += PERIOD_NS
            time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
            late_ns = time.monotonic_ns() - due_ns
            worst_ns, total_ns = max(worst_ns, late_ns), total_ns + max(0, late_ns - USUAL_NS)
            due_ns += max(0, late_ns - PERIOD_NS)
        os.write(1, RECORD.pack(time.monotonic_ns(), worst_ns, total_ns))


if __name__ == "__main__":
    run()
