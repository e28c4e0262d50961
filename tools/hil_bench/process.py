"""A process that is not a child of the bench, held by a descriptor so that a reused process id cannot be hit."""

import os
import select
import signal
from contextlib import suppress


class Process:
    """Raises `ProcessLookupError` if no process has this number."""

    def __init__(self, number: int) -> None:
        self._descriptor = os.pidfd_open(number)

    @property
    def is_alive(self) -> bool:
        """False once it has ended."""
        return not select.select([self._descriptor], [], [], 0.0)[0]

    def send(self, number: signal.Signals) -> None:
        """Send a signal, if it still runs."""
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._descriptor, number)

    def close(self) -> None:
        """Release the descriptor; the process continues."""
        os.close(self._descriptor)
