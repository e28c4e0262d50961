"""A log of candump (can-utils) as arrays; of `candump -L` a million lines without a line of Python for each.

Regular lines are `(1436509052.249713) vcan0 123#1122334455667788`, with 8 digits for an extended identifier, `##` and
one digit of flags before FD data, and perhaps ` R` or ` T` at the end. They are found by where their spaces and `#`
are and turned to numbers two characters at a time. Every other line is parsed separately, and so is every line of a
log whose stamps are differences, dates or missing: valid frames are kept, and every other line is reported.
"""

import mmap
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.candump_line import LineReader
from vehicle_iface.logs.digits import (
    are_hexadecimal,
    group_by_text,
    group_by_value,
    parse_hexadecimal,
    parse_keys,
    parse_stamps_ns,
)
from vehicle_iface.logs.frames import MAX_CLASSICAL_BYTES, MAX_FD_BYTES, Bools, Bytes, Chunk, Frames, Ints
from vehicle_iface.logs.stamps import Stamps

CHUNK_BYTES = 1 << 20
"""Size of the chunks, which fit into a processor's cache."""
BYTE_ORDER_MARK = b"\xef\xbb\xbf"


def read_candump(path: Path, stamps: Stamps = Stamps.AS_LOGGED) -> Iterator[Chunk]:
    """Read the log in chunks. `ConfigError` when the file cannot be read."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            if size:
                with closing(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)) as content:
                    yield from _chunks(content, size, stamps)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def _chunks(content: mmap.mmap, size: int, stamps: Stamps) -> Iterator[Chunk]:
    begin, line, reader = 0, 1, LineReader(stamps)
    may_be_regular = stamps in (Stamps.AS_LOGGED, Stamps.SINCE_START)
    while begin < size:
        end = _end_of_chunk(content, begin, size)
        text = content[begin:end] if begin else content[:end].removeprefix(BYTE_ORDER_MARK)
        if b"\r" in text:
            text = text.replace(b"\r\n", b"\n")
        chunk = _parse_lines(text if text.endswith(b"\n") else text + b"\n", line, reader, may_be_regular)
        chunk.done_bytes, chunk.total_bytes = end, size
        yield chunk
        begin, line = end, line + chunk.lines


def _end_of_chunk(content: mmap.mmap, begin: int, size: int) -> int:
    """Return the end of the last complete line in the next `CHUNK_BYTES`, or of the first line when it is longer."""
    end = begin + CHUNK_BYTES
    if end >= size:
        return size
    newline = content.rfind(b"\n", begin, end)
    if newline < 0:
        newline = content.find(b"\n", end)
    return newline + 1 if newline >= 0 else size


def _parse_lines(raw: bytes, first_line: int, reader: LineReader, may_be_regular: bool) -> Chunk:
    """Parse complete lines; `raw` ends with a line end."""
    text = np.frombuffer(raw, np.uint8)
    starts, ends, rows = _find_regular(text)
    chunk = Chunk(lines=len(starts))
    taken = np.zeros(len(starts), bool)
    if may_be_regular:
        for channel, some in group_by_text(text, rows.channel_firsts, rows.channel_stops):
            of_channel = rows.some(some)
            for width, group in group_by_value(of_channel.stops - of_channel.firsts):
                _parse_regular(text, of_channel.some(group), width, channel, first_line, chunk, taken)
    others = np.flatnonzero(~taken).tolist()
    read = (reader.read(raw[starts[index] : ends[index]], first_line + index, chunk) for index in others)
    chunk.add(frame for frame in read if frame is not None)
    return chunk


_SPACE, _HASH, _NEWLINE, _OPEN, _CLOSE = b" #\n()"
_RECEIVED, _SENT = b"RT"
_SHAPES = (b"  #", b"  ##", b"  # ", b"  ## ")
"""The spaces and hashes of regular lines: classical, FD, and both with a direction."""
_MOST_MARKS = 1 + max(map(len, _SHAPES))
_LONGEST_STAMP, _LONGEST_ID = len("(0123456789.012345678)"), len(" 01234567")


@dataclass(frozen=True, slots=True)
class _Rows:
    """The lines of a regular shape: their number in the text, and where the parts of each begin and end."""

    index: Ints
    stamp_firsts: Ints
    stamp_stops: Ints
    channel_firsts: Ints
    channel_stops: Ints
    id_firsts: Ints
    id_stops: Ints
    firsts: Ints
    """Start of the payload's digits."""
    stops: Ints

    def some(self, which: NDArray[np.intp] | slice) -> "_Rows":
        """Return a selection of the rows."""
        return _Rows(*(getattr(self, name)[which] for name in self.__slots__))


def _find_regular(text: Bytes) -> tuple[Ints, Ints, _Rows]:
    """Return begin and end of every line, and the lines of a regular shape."""
    marks = np.flatnonzero((text == _SPACE) | (text == _HASH) | (text == _NEWLINE))
    kinds = text[marks]
    last = np.flatnonzero(kinds == _NEWLINE)
    ends = marks[last]
    starts = np.concatenate(([0], ends[:-1] + 1))
    first = np.concatenate(([0], last[:-1] + 1))
    found = []
    for count, group in group_by_value(np.minimum(last - first, _MOST_MARKS)):
        shapes = [shape for shape in _SHAPES if len(shape) == count]
        index = np.arange(len(starts))[group]
        if shapes and len(index) == len(starts):
            places, signs = marks.reshape(-1, count + 1), kinds.reshape(-1, count + 1)
        elif shapes:
            which = first[group][:, np.newaxis] + np.arange(count + 1)
            places, signs = marks[which], kinds[which]
        found += [_match_shape(text, index, starts[group], places, signs, shape) for shape in shapes]
    if len(found) == 1:
        return starts, ends, found[0]
    columns = (np.concatenate([starts[:0], *(getattr(rows, name) for rows in found)]) for name in _Rows.__slots__)
    return starts, ends, _Rows(*columns)


def _match_shape(text: Bytes, index: Ints, starts: Ints, marks: Ints, signs: Bytes, shape: bytes) -> _Rows:
    """Those of some lines that have a shape; `marks` (n, its length and 1) are the places of spaces, hashes and the
    end, `signs` which of them they are."""
    is_fd = shape.count(b"#") == 2
    after_stamp, before_id, hash_, end = marks[:, 0], marks[:, 1], marks[:, 2], marks[:, -1]
    good = (text[starts] == _OPEN) & (text[after_stamp - 1] == _CLOSE) & (before_id > after_stamp + 1)
    for place, kind in enumerate(shape):
        good &= signs[:, place] == kind
    firsts, stops = hash_ + 1, end
    if shape.endswith(b" "):
        stops, direction = marks[:, -2], text[end - 1]
        good &= (end == stops + 2) & ((direction == _RECEIVED) | (direction == _SENT))
    if is_fd:
        firsts = hash_ + 3
        good &= (marks[:, 3] == hash_ + 1) & (stops >= firsts)
        good &= are_hexadecimal(text[np.minimum(hash_ + 2, len(text) - 1)])
    width = stops - firsts
    good &= (width % 2 == 0) & (width <= 2 * (MAX_FD_BYTES if is_fd else MAX_CLASSICAL_BYTES))
    good &= (after_stamp - starts <= _LONGEST_STAMP) & (hash_ - before_id <= _LONGEST_ID)
    rows = _Rows(index, starts + 1, after_stamp - 1, after_stamp + 1, before_id, before_id + 1, hash_, firsts, stops)
    return rows if good.all() else rows.some(np.flatnonzero(good))


def _parse_regular(
    text: Bytes, rows: _Rows, width: int, channel: str, first_line: int, chunk: Chunk, taken: Bools
) -> None:
    """Parse lines of one channel with payloads of one width; invalid lines are left for `LineReader`."""
    stamps_ns, good = parse_stamps_ns(text, rows.stamp_firsts, rows.stamp_stops)
    keys, good_keys = parse_keys(text, rows.id_firsts, rows.id_stops)
    data, good_data = parse_hexadecimal(text, rows.firsts, width)
    good &= good_keys & good_data
    lines = rows.index + first_line
    if not good.all():
        rows, lines, stamps_ns, keys, data = (
            rows.some(np.flatnonzero(good)),
            lines[good],
            stamps_ns[good],
            keys[good],
            data[good],
        )
    taken[rows.index] = True
    chunk.frames.append(Frames(lines=lines, stamps_ns=stamps_ns, keys=keys, data=data, channel=channel))
