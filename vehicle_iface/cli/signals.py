"""Handles SIGINT and SIGTERM as requests to end."""

import signal
from collections.abc import Callable
from types import FrameType


class Flag:
    """A flag that a signal handler sets."""

    def __init__(self) -> None:
        self.is_set = False

    def set(self) -> None:
        self.is_set = True


def on_end_signals(end: Callable[[], None] | None) -> None:
    """Make SIGINT and SIGTERM call `end`; None restores the default, which ends the program."""

    def handle(_number: int, _frame: FrameType | None) -> None:
        if end is not None:
            end()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle if end is not None else signal.SIG_DFL)
