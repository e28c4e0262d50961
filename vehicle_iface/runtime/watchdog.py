"""Ends a process whose loop hangs for good, and logs where it hangs.

A loop that hangs sends nothing, so the vehicle's own watchdog has acted by then; this one says where it hangs.
It counts its own wake-ups and reads no clock: a process that was stopped and goes on is not taken for one that hangs.
"""

import faulthandler
import os
import sys
import threading
from collections.abc import Callable
from typing import Self

LOOK_S = 0.7
"""Each look takes the interpreter from the loop for a moment, and three system calls."""
PATIENCE = 3
"""Looks in a row without a sign of life."""
HUNG = 4
"""Exit status: ended in a latched fault."""


def _end() -> None:
    print("vehicle-iface: the loop hangs, nothing is sent any more; it hangs here:", file=sys.stderr, flush=True)
    faulthandler.dump_traceback(sys.stderr)
    os._exit(HUNG)


class Watchdog:
    """Watches from a thread of its own while it is entered."""

    def __init__(self, end: Callable[[], None] = _end, *, look_s: float = LOOK_S) -> None:
        self._end, self._look_s = end, look_s
        self._signs_of_life = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def feed(self) -> None:
        """A sign of life, from the loop."""
        self._signs_of_life += 1

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        seen, quiet = -1, 0
        while not self._over.wait(self._look_s):
            quiet = quiet + 1 if self._signs_of_life == seen else 0
            seen = self._signs_of_life
            if quiet >= PATIENCE:
                self._end()
                return
