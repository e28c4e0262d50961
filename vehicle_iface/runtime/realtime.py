"""What the operating system grants a loop, asked for in one place, each step with an honest fall-back."""

import gc
import os

FIFO_PRIORITY = 50
"""Above everything ordinary, below the kernel's interrupt threads of a real-time kernel (50 shares their class)."""


def claim(priority: int = FIFO_PRIORITY) -> list[str]:
    """Take what can be had for this process; returns what is lacking, each with the mending command."""
    gc.collect()
    gc.freeze()  # what exists by now is never looked at again, so that a collection in a pass stays short
    lacking: list[str] = []
    if not hasattr(os, "sched_setscheduler"):
        return ["this system has no SCHED_FIFO: other programs can delay the loop"]
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        lacking.append(
            "no right to SCHED_FIFO, other programs can delay the loop; "
            f"`ulimit -r {priority}` after an `rtprio` line in /etc/security/limits.conf, or run as root"
        )
    return lacking
