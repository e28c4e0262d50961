"""The complete lines of a large file, by index."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from vehicle_iface.errors import ConfigError

_CHUNK_BYTES = 1 << 20


class Lines:
    """The complete lines of a file; a missing file has none. `ConfigError` when it cannot be read."""

    def __init__(self, path: Path) -> None:
        ends = [np.zeros(1, np.int64)]
        self._file = -1
        try:
            # Read, not mapped: access to a mapped file that was truncated would kill the process.
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
            at = 0
            while chunk := os.pread(self._file, _CHUNK_BYTES, at):
                ends.append(np.flatnonzero(np.frombuffer(chunk, np.uint8) == ord("\n")) + at + 1)
                at += len(chunk)
        except FileNotFoundError:
            pass
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
        self._begins = np.concatenate(ends)

    def __len__(self) -> int:
        return len(self._begins) - 1

    def text(self, index: int) -> str:
        """Return the line without its line end; empty when there is none."""
        if not 0 <= index < len(self):
            return ""
        return "".join(self.texts(index, index + 1))

    def texts(self, first: int, end: int) -> list[str]:
        """Return the lines from `first` to before `end`, which must exist, without their line ends."""
        if first >= end:
            return []
        begin_byte, end_byte = int(self._begins[first]), int(self._begins[end])
        try:
            content = os.pread(self._file, end_byte - begin_byte - 1, begin_byte)
        except OSError:
            return []
        return content.decode(errors="replace").split("\n")

    def close(self) -> None:
        if self._file >= 0:
            os.close(self._file)
        self._file = -1
