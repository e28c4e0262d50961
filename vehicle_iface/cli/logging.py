"""The log on the terminal, written by a thread of its own."""

import copy
import logging
import logging.handlers
import queue
import sys
from collections.abc import Iterator
from contextlib import contextmanager

LAST_WORDS_S = 1.0
"""How long the end of the program waits for the terminal."""
CLEAR_LINE = "\r\x1b[2K"


class _Listener(logging.handlers.QueueListener):
    """Writes the log from a thread, and waits for it at the end, but not for ever."""

    def stop(self) -> None:
        if self._thread is not None:
            self.enqueue_sentinel()
            self._thread.join(LAST_WORDS_S)
            self._thread = None


class _Handler(logging.handlers.QueueHandler):
    """Leaves tracebacks to the listener's thread: reading the source of their lines takes longer than a pass."""

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        prepared = copy.copy(record)
        prepared.msg, prepared.args = record.getMessage(), None
        return prepared


@contextmanager
def log_to_terminal(verbose: bool) -> Iterator[None]:
    """Log to standard error. A thread writes it: a terminal that hangs must not hold up the loop."""
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
