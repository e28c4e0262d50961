"""Logs to the terminal from a separate thread."""

import copy
import logging
import logging.handlers
import queue
import sys
from collections.abc import Iterator
from contextlib import contextmanager

LAST_WORDS_S = 1.0
"""Longest time in s that the program waits at its end for the terminal."""
CLEAR_LINE = "\r\x1b[2K"


class _Listener(logging.handlers.QueueListener):
    """Writes the log from a thread. At the end it waits for the thread for a limited time."""

    def stop(self) -> None:
        if self._thread is not None:
            self.enqueue_sentinel()
            self._thread.join(LAST_WORDS_S)
            self._thread = None


class _Handler(logging.handlers.QueueHandler):
    """Leaves the formatting of tracebacks to the listener's thread, because reading their source lines takes longer
    than a pass."""

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        prepared = copy.copy(record)
        prepared.msg, prepared.args = record.getMessage(), None
        return prepared


@contextmanager
def log_to_terminal(verbose: bool) -> Iterator[None]:
    """Log to standard error from a thread, so that a blocked terminal does not block the loop."""
    log = logging.getLogger("vehicle_iface")
    terminal = logging.StreamHandler()
    form = "%(asctime)s.%(msecs)03d %(levelname)-7s %(message)s"
    # The demo's status line may stand on the same line of the terminal.
    terminal.setFormatter(logging.Formatter(CLEAR_LINE + form if sys.stderr.isatty() else form, "%H:%M:%S"))
    lines: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    listener = _Listener(lines, terminal)
    handler = _Handler(lines)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG if verbose else logging.INFO)
    listener.start()
    try:
        yield
    finally:
        log.removeHandler(handler)
        listener.stop()
