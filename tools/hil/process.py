"""A process that somebody else has begun, and no other one that gets its number after it."""

import os
import select
import signal
from contextlib import suppress


class Process:
    """Held by a descriptor. Raises `ProcessLookupError` where there is none of that number."""

    def __init__(self, number: int) -> None:
        self._descriptor = os.pidfd_open(number)

    @property
    def lives(self) -> bool:
        """Whether it has not ended."""
        return not select.select([self._descriptor], [], [], 0.0)[0]

    def send(self, number: signal.Signals) -> None:
        """A signal, if it still lives."""
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._descriptor, number)

    def close(self) -> None:
        """It goes on; it is only not held any more."""
        os.close(self._descriptor)
