"""A candump log (`candump -L`, can-utils) as arrays: a million lines without a line of Python for each.

Regular lines are `(1436509052.249713) vcan0 123#1122334455667788`, with 8 digits for an extended identifier, `##` and
one digit of flags before FD data, and perhaps ` R` or ` T` at the end. They are found by where their spaces and `#`
are and turned to numbers two characters at a time. Every other line is looked at by itself: what can be understood
is taken, what cannot is reported. Nothing is passed over in silence.
"""

import mmap
import re
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vehicle_iface.errors import ConfigError
from vehicle_iface.units import NS_PER_S

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

EXTENDED = 1 << 31
"""Set in the key of an extended identifier."""
CHUNK_BYTES = 1 << 21
"""Looked at in one go: what a processor's cache holds."""
_ERROR, _LAST_ID, _LAST_STANDARD_ID = 0x20000000, 0x1FFFFFFF, 0x7FF
_GREATEST_STAMP_S = (2**63 - 1) // NS_PER_S - 1
_LONGEST = {False: 8, True: 64}
"""Payload bytes of a classical frame and of an FD frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Data frames with payloads of one length, in the order of the log."""

    lines: Ints
    """(n,) Line of the file, from 1."""
    stamps_ns: Ints
    """(n,) The log's own stamps, mostly of a wall clock."""
    keys: Ints
    """(n,) Identifier, plus `EXTENDED` for one of 29 bits."""
    data: Bytes
    """(n, length)"""


@dataclass(frozen=True, slots=True)
class RefusedLine:
    """A line that became no frame, or a frame that became no values."""

    line: int
    why: str


@dataclass(slots=True)
class Chunk:
    """What some consecutive lines came to; every line is counted exactly once."""

    frames: list[Frames] = field(default_factory=list)
    lines: int = 0
    blank: int = 0
    remote: int = 0
    errors: int = 0
    """Error frames: what the adapter said of the bus."""
    refused: list[RefusedLine] = field(default_factory=list)
    done_bytes: int = 0
    """From the beginning of the file."""
    total_bytes: int = 0


def read_candump(path: Path) -> Iterator[Chunk]:
    """The log in pieces. `ConfigError` when the file cannot be read."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            if size:
                with closing(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)) as content:
                    yield from _chunks(content, size)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def _chunks(content: mmap.mmap, size: int) -> Iterator[Chunk]:
    begin, line = 0, 1
    while begin < size:
        end = _end_of_chunk(content, begin, size)
        text = content[begin:end].replace(b"\r\n", b"\n")
        chunk = _parsed(text if text.endswith(b"\n") else text + b"\n", line)
        chunk.done_bytes, chunk.total_bytes = end, size
        yield chunk
        begin, line = end, line + chunk.lines


def _end_of_chunk(content: mmap.mmap, begin: int, size: int) -> int:
    """After the last whole line of the next `CHUNK_BYTES`, or after the first one when that is longer."""
    end = begin + CHUNK_BYTES
    if end >= size:
        return size
    newline = content.rfind(b"\n", begin, end)
    if newline < 0:
        newline = content.find(b"\n", end)
    return newline + 1 if newline >= 0 else size


def _parsed(raw: bytes, first_line: int) -> Chunk:
    """Whole lines; `raw` ends with a line end."""
    text = np.frombuffer(raw, np.uint8)
    rows = _Rows(text)
    chunk = Chunk(lines=rows.count)
    for length, group in _groups(rows.stops - rows.firsts):
        rows.take_data(length, group, first_line, chunk)
    for index in np.flatnonzero(~rows.taken).tolist():
        _take_irregular(raw[rows.starts[index] : rows.ends[index]], first_line + index, chunk)
    chunk.frames += _gathered(rows.irregular(chunk))
    return chunk


_SPACE, _HASH, _NEWLINE, _OPEN, _CLOSE, _DOT, _ZERO = b" #\n().0"
_SHAPES = (b"  #", b"  ##", b"  # ", b"  ## ")
"""The spaces and hashes of regular lines: classical, FD, and both with a direction."""


class _Rows:
    """The regular lines of a text: where the parts of each are, its stamp and its key."""

    def __init__(self, text: Bytes) -> None:
        self.text = text
        marks = np.flatnonzero((text == _SPACE) | (text == _HASH) | (text == _NEWLINE))
        kinds = text[marks]
        last = np.flatnonzero(kinds == _NEWLINE)
        self.ends = marks[last]
        self.starts = np.concatenate(([0], self.ends[:-1] + 1))
        self.count = len(last)
        self.taken = np.zeros(self.count, bool)
        first = np.concatenate(([0], last[:-1] + 1))
        self._shape(marks, kinds, first, last - first)
        self._narrow(self._numbers())
