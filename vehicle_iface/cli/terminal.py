"""Output that no terminal can hold up or turn into a failure."""

import os
import sys


def print_safely(text: str, *, end: str = "\n") -> None:
    """Print, unless nobody reads: that changes neither summary nor exit status."""
    try:
        print(text, end=end, flush=True)
    except OSError:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  # the interpreter flushes it at its end
