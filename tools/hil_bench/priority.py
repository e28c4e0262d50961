"""Real-time priority of the bench: it must not be late itself."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 40


@contextmanager
def realtime_priority() -> Iterator[None]:
    """Real-time priority if permitted; the priority before it at the end. Programs that are started do not have it."""
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except PermissionError:
        yield
        return
    try:
        yield
    finally:
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, priority)  # without root that flag stays
