"""Prints without failing if the terminal is blocked or closed."""

import os
import sys


def print_safely(text: str, *, end: str = "\n") -> None:
    """Print; if nobody reads the output, discard it without an error, so that the exit status does not change."""
    try:
        print(text, end=end, flush=True)
    except OSError:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  # the interpreter flushes it at its end
