"""A file of complete lines on a disk that may be full."""

import contextlib
import errno
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from vehicle_iface.units import NS_PER_S

RETRY_NS = NS_PER_S
"""Time without writing after a failure; lines of that time are lost."""


class Sink:
    """Appends lines, never overwrites, and counts the lines that it could not write."""

    def __init__(self, path: Path, notify: Callable[[str], None], header: bytes = b"") -> None:
        """Create the file; `OSError` when it exists already, cannot be created, or has no room for its header."""
        self._name = path.name
        self._notify = notify
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self._bytes = os.write(self._file, header)
        if self._bytes < len(header):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._retry_due_ns = 0
        self.written = 0
        self.lost = 0
        self.trouble = ""
        """Why nothing can be written at present; empty when all is well."""

    def write(self, lines: Sequence[bytes], now_ns: int) -> None:
        """Append `lines`, each with its line end; those that cannot be written are counted."""
        if not lines:
            return
        if self.trouble and now_ns < self._retry_due_ns:
            self.lost += len(lines)
            return
        text = b"".join(lines)
        try:
            done = os.write(self._file, text)
            trouble = "" if done == len(text) else "no room for all of it"
        except OSError as error:
            done, trouble = 0, error.strerror or str(error)
        kept = len(text) if done == len(text) else text.rfind(b"\n", 0, done) + 1
        self._bytes += kept
        if done > kept:  # a partial line would merge with the next one
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._bytes)
        count = len(lines) if not trouble else text.count(b"\n", 0, kept)
        self.written += count
        self.lost += len(lines) - count
        self._set_trouble(trouble, now_ns)

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def _set_trouble(self, trouble: str, now_ns: int) -> None:
        """Report a change, once."""
        if trouble:
            self._retry_due_ns = now_ns + RETRY_NS
        if trouble and not self.trouble:
            self._notify(f"{self._name}: {trouble}; new lines are lost and counted, the drive continues")
        elif self.trouble and not trouble:
            self._notify(f"{self._name}: writable again; {self.lost} lines lost so far")
        self.trouble = trouble
