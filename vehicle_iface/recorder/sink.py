"""A file of whole lines on a disk that may be full."""

import contextlib
import errno
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from vehicle_iface.units import NS_PER_S

AGAIN_NS = NS_PER_S
"""After a failure the file is left alone for so long, and what comes meanwhile is lost."""


class Sink:
    """Appends, never overwrites, and counts the lines that it could not keep."""

    def __init__(self, path: Path, say: Callable[[str], None], header: bytes = b"") -> None:
        """Makes the file; `OSError` when it cannot be made, is there already, or does not even take its header."""
        self._name = path.name
        self._say = say
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self._bytes = os.write(self._file, header)
        if self._bytes < len(header):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._again_ns = 0
        self.written = 0
        self.lost = 0
        self.trouble = ""
        """Why it takes nothing at present, in words."""

    def write(self, lines: Sequence[bytes], now_ns: int) -> None:
        """Append `lines`, each with its line end; those that find no room are counted."""
        if not lines:
            return
        if self.trouble and now_ns < self._again_ns:
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
        if done > kept:  # half a line would be taken for a whole one with the next behind it
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._bytes)
        count = len(lines) if not trouble else text.count(b"\n", 0, kept)
        self.written += count
        self.lost += len(lines) - count
        self._note(trouble, now_ns)

    def close(self) -> None:
        """Give the file back."""
        os.close(self._file)

    def _note(self, trouble: str, now_ns: int) -> None:
        """Say what has changed, once."""
        if trouble:
            self._again_ns = now_ns + AGAIN_NS
        if trouble and not self.trouble:
            self._say(f"{self._name}: {trouble}; what comes now is lost and counted, the drive goes on")
        elif self.trouble and not trouble:
            self._say(f"{self._name}: is written again; {self.lost} lines lost so far")
        self.trouble = trouble
