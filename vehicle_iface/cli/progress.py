"""Shows on the terminal how much of a log has been read."""

import sys


def show_progress(done_bytes: int, total_bytes: int) -> None:
    """Update the progress line on a terminal; elsewhere print one line at the end."""
    is_over = done_bytes == total_bytes
    if is_over or sys.stderr.isatty():
        text = f"\r{100 * done_bytes // total_bytes:3d} % of {total_bytes / 1e6:.1f} MB"
        print(text, end="\n" if is_over else "", file=sys.stderr, flush=True)
