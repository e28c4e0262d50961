"""Long work in pieces, so that the loop can drive between two of them.

Such work is a generator. It yields between two pieces and returns its result.
"""

import mmap
from collections.abc import Generator, Iterator
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")

PIECE = 8192
"""Points in a piece: a pass over them takes some 20 µs, and temporary arrays of them stay in the processor's cache."""
_RETURNED_BYTES = 2**18


def finish(work: Generator[None, None, Result]) -> Result:
    """Do all pieces at once and return the result."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            result: Result = end.value
            return result


def slices(count: int, size: int = PIECE) -> Iterator[slice]:
    """Return the slices of `size` points, the last one shorter, that cover `count` points."""
    return (slice(at, min(at + size, count)) for at in range(0, count, size))


class Scratch:
    """Memory for one number per point that is returned to the system in pieces: all at once, 8 MB take over 1 ms.

    Raises `MemoryError` where there is none.
    """

    def __init__(self, count: int) -> None:
        self._map = None
        if count > PIECE and hasattr(mmap, "MADV_DONTNEED"):
            try:
                self._map = mmap.mmap(-1, 8 * count, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
            except OSError as error:
                raise MemoryError(f"no memory for {count} numbers") from error
        self.numbers = np.empty(count) if self._map is None else np.frombuffer(self._map, np.float64, count)
        """(count,) without values at first."""

    def release(self) -> Generator[None]:
        """Return the memory. The numbers are lost."""
        if self._map is not None:
            for part in slices(len(self._map), _RETURNED_BYTES):
                self._map.madvise(mmap.MADV_DONTNEED, part.start, part.stop - part.start)
                yield
