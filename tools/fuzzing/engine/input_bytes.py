"""An input as a row of numbers, and as a file."""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path


class Bytes:
    """Takes numbers off the front; beyond the end all bytes are 0."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def __bool__(self) -> bool:
        """Whether anything is left."""
        return self._at < len(self._data)

    def take(self, count: int) -> bytes:
        taken = self._data[self._at : self._at + count]
        self._at += count
        return taken.ljust(count, b"\0")

    def number(self, count: int = 1, *, signed: bool = False) -> int:
        return int.from_bytes(self.take(count), "little", signed=signed)

    def rest(self) -> bytes:
        rest = self._data[self._at :]
        self._at = len(self._data)
        return rest


@cache
def scratch() -> Path:
    """A folder of this process, in memory where that is possible; gone at its end."""
    memory = Path("/dev/shm")
    folder = tempfile.mkdtemp(prefix="fuzzing-", dir=memory if memory.is_dir() else None)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def written(name: str, data: bytes) -> Path:
    """A file with these bytes."""
    path = scratch() / name
    path.write_bytes(data)
    return path
