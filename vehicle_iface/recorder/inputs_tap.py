"""The inputs of the loop as lines of `inputs.log`, from the pipe that the loop writes to."""

import contextlib
import os

from vehicle_iface.recorder.inputs import format_block, split_passes
from vehicle_iface.units import NS_PER_S

BLOCK_NS = NS_PER_S
"""A line is written this often at least: so much is lost when this process is killed."""
BLOCK_BYTES = 1 << 18
_READ_BYTES = 1 << 20


class InputsTap:
    """Reads the pipe without waiting."""

    def __init__(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._raw = bytearray()
        self._passes: list[bytes] = []
        self._bytes = 0
        self._due_ns = 0

    def read(self, now_ns: int, *, is_last: bool = False) -> list[bytes]:
        """Return the lines that are complete; with `is_last`, everything that has come."""
        with contextlib.suppress(BlockingIOError):
            while chunk := os.read(self._descriptor, _READ_BYTES):
                self._raw += chunk
        fresh = split_passes(self._raw)
        self._passes += fresh
        self._bytes += sum(map(len, fresh))
        if not self._passes or not (is_last or now_ns >= self._due_ns or self._bytes >= BLOCK_BYTES):
            return []
        line = format_block(self._passes)
        self._passes, self._bytes, self._due_ns = [], 0, now_ns + BLOCK_NS
        return [line]

    def close(self) -> None:
        """Close the pipe."""
        os.close(self._descriptor)
