"""A candump log (`candump -L`, can-utils) as arrays: a million lines without a line of Python for each.

Regular lines are `(1436509052.249713) vcan0 123#1122334455667788`, with 8 digits for an extended identifier, `##` and
one digit of flags before FD data, and perhaps ` R` or ` T` at the end. They are found by where their spaces and `#`
are and turned to numbers two characters at a time. Every other line is looked at by itself: what can be understood
is taken, what cannot is reported. Nothing is passed over in silence.
"""

import mmap
import re
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

Frame = tuple[int, int, int, bytes]
"""Line, stamp in ns, key, payload."""
EXTENDED = 1 << 31
"""Set in the key of an extended identifier."""
CHUNK_BYTES = 1 << 20
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

    @classmethod
    def of(cls, frames: "list[Frame]") -> "Frames":
        """Some frames, all of one length."""
        lines, stamps_ns, keys, data = zip(*frames, strict=True)
        return cls(
            lines=np.array(lines, np.int64),
            stamps_ns=np.array(stamps_ns, np.int64),
            keys=np.array(keys, np.int64),
            data=np.frombuffer(b"".join(data), np.uint8).reshape(len(frames), len(data[0])),
        )


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
        text = content[begin:end]
        if b"\r" in text:
            text = text.replace(b"\r\n", b"\n")
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
    starts, ends, rows = _regular(text)
    chunk = Chunk(lines=len(starts))
    taken = np.zeros(len(starts), bool)
    for width, group in _groups(rows.stops - rows.firsts):
        _take_regular(text, rows.some(group), width, first_line, chunk, taken)
    by_length: dict[int, list[Frame]] = {}
    for index in np.flatnonzero(~taken).tolist():
        frame = _irregular(raw[starts[index] : ends[index]], first_line + index, chunk)
        if frame is not None:
            by_length.setdefault(len(frame[-1]), []).append(frame)
    chunk.frames += [Frames.of(frames) for frames in by_length.values()]
    return chunk


_SPACE, _HASH, _NEWLINE, _OPEN, _CLOSE, _DOT, _ZERO, _LETTER_A = b" #\n().0a"
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
    id_firsts: Ints
    id_stops: Ints
    firsts: Ints
    """Of the payload's digits."""
    stops: Ints

    def some(self, which: NDArray[np.intp] | slice) -> "_Rows":
        """Some of them."""
        return _Rows(*(getattr(self, name)[which] for name in self.__slots__))


def _regular(text: Bytes) -> tuple[Ints, Ints, _Rows]:
    """Begin and end of every line, and those of a regular shape."""
    marks = np.flatnonzero((text == _SPACE) | (text == _HASH) | (text == _NEWLINE))
    kinds = text[marks]
    last = np.flatnonzero(kinds == _NEWLINE)
    ends = marks[last]
    starts = np.concatenate(([0], ends[:-1] + 1))
    first = np.concatenate(([0], last[:-1] + 1))
    found = []
    for count, group in _groups(np.minimum(last - first, _MOST_MARKS)):
        shapes = [shape for shape in _SHAPES if len(shape) == count]
        index = np.arange(len(starts))[group]
        if shapes and len(index) == len(starts):
            places, signs = marks.reshape(-1, count + 1), kinds.reshape(-1, count + 1)
        elif shapes:
            which = first[group][:, np.newaxis] + np.arange(count + 1)
            places, signs = marks[which], kinds[which]
        found += [_shaped(text, index, starts[group], places, signs, shape) for shape in shapes]
    if len(found) == 1:
        return starts, ends, found[0]
    columns = (np.concatenate([starts[:0], *(getattr(rows, name) for rows in found)]) for name in _Rows.__slots__)
    return starts, ends, _Rows(*columns)


def _shaped(text: Bytes, index: Ints, starts: Ints, marks: Ints, signs: Bytes, shape: bytes) -> _Rows:
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
        good &= _are_hexadecimal(text[np.minimum(hash_ + 2, len(text) - 1)])
    width = stops - firsts
    good &= (width % 2 == 0) & (width <= 2 * _LONGEST[is_fd])
    good &= (after_stamp - starts <= _LONGEST_STAMP) & (hash_ - before_id <= _LONGEST_ID)
    rows = _Rows(index, starts + 1, after_stamp - 1, before_id + 1, hash_, firsts, stops)
    return rows if good.all() else rows.some(np.flatnonzero(good))


def _take_regular(text: Bytes, rows: _Rows, width: int, first_line: int, chunk: Chunk, taken: Bools) -> None:
    """Turn lines with payloads of one width into numbers; those that are none stay for the other way."""
    stamps_ns, good = _stamps_ns(text, rows)
    keys, good_keys = _keys(text, rows)
    data, good_data = _hexadecimal(text, rows.firsts, width)
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
    chunk.frames.append(Frames(lines=lines, stamps_ns=stamps_ns, keys=keys, data=data))


def _groups(values: Ints) -> list[tuple[int, NDArray[np.intp] | slice]]:
    """Each value, and where it is."""
    if not len(values):
        return []
    low, high = int(values.min()), int(values.max())
    if low == high:
        return [(low, slice(None))]
    present = np.flatnonzero(np.bincount(values - low)) + low
    return [(int(value), np.flatnonzero(values == value)) for value in present]


def _stamps_ns(text: Bytes, rows: _Rows) -> tuple[Ints, Bools]:
    """The stamps, with 6 or 9 digits after the point."""
    stamps_ns, good = np.zeros(len(rows.index), np.int64), np.zeros(len(rows.index), bool)
    for width, group in _groups(rows.stamp_stops - rows.stamp_firsts):
        firsts = rows.stamp_firsts[group]
        for digits in (6, 9):
            whole = width - digits - 1
            if not 1 <= whole <= 10:
                continue
            seconds, good_seconds = _decimal(text, firsts, whole)
            fraction, good_fraction = _decimal(text, firsts + whole + 1, digits)
            fits = good_seconds & good_fraction & (text[firsts + whole] == _DOT) & (seconds <= _GREATEST_STAMP_S)
            if fits.any():
                found = seconds * NS_PER_S + fraction * 10 ** (9 - digits)
                stamps_ns[group] = np.where(fits, found, stamps_ns[group])
                good[group] |= fits
            if fits.all():
                break
    return stamps_ns, good


def _keys(text: Bytes, rows: _Rows) -> tuple[Ints, Bools]:
    """Identifiers of 3 digits, or of 8 for extended ones."""
    keys, good = np.zeros(len(rows.index), np.int64), np.zeros(len(rows.index), bool)
    for width, group in _groups(rows.id_stops - rows.id_firsts):
        if width not in (3, 8):
            continue
        content, fits = _hexadecimal(text, rows.id_firsts[group], width)
        number = np.zeros(len(content), np.int64)
        for place in range(content.shape[1]):
            number = number << 8 | content[:, place]
        keys[group] = number | EXTENDED if width == 8 else number
        good[group] = fits & (number <= (_LAST_ID if width == 8 else _LAST_STANDARD_ID))
    return keys, good


def _windows(text: Bytes, firsts: Ints, width: int) -> Bytes:
    """`width` characters from each of `firsts` on, one more in front when that is odd: then it is 0."""
    odd = width % 2
    characters = sliding_window_view(text, width + odd)[firsts - odd]
    if odd:
        characters[:, 0] = _ZERO
    return characters


def _decimal(text: Bytes, firsts: Ints, width: int) -> tuple[Ints, Bools]:
    """Numbers of `width` digits; and whether all of them are digits."""
    digits = _windows(text, firsts, width) - np.uint8(_ZERO)
    good = _whole_rows(digits <= 9)
    pairs = digits.view("<u2")
    values = (pairs & 0xFF) * np.uint16(10) + (pairs >> 8)
    number = values[:, 0].astype(np.int64)
    for place in range(1, values.shape[1]):
        number = number * 100 + values[:, place]
    return number, good


def _hexadecimal(text: Bytes, firsts: Ints, width: int) -> tuple[Bytes, Bools]:
    """Bytes of two digits each, (n, width / 2) rounded up; and whether all of them are digits."""
    if not width:
        return np.zeros((len(firsts), 0), np.uint8), np.ones(len(firsts), bool)
    characters = _windows(text, firsts, width)
    good = _whole_rows(_are_hexadecimal(characters))
    nibbles = (characters & 0x0F) + np.uint8(9) * (characters >> 6)
    pairs = nibbles.view("<u2")
    return (pairs << 4 | pairs >> 8).astype(np.uint8), good


def _are_hexadecimal(characters: Bytes) -> Bools:
    """Differences wrap round, so that one comparison has both ends."""
    found: Bools = (characters - np.uint8(_ZERO) <= 9) | ((characters | 0x20) - np.uint8(_LETTER_A) <= 5)
    return found


def _whole_rows(good: Bools) -> Bools:
    if good.all():
        return np.ones(len(good), bool)
    whole: Bools = np.logical_and.reduce(good, axis=1)
    return whole


_LINE = re.compile(
    rb"\((?P<s>\d{1,10})\.(?P<f>\d{1,9})\)\s+\S+\s+(?P<id>[0-9A-Fa-f]{3,8})"
    rb"#(?P<fd>#[0-9A-Fa-f])?(?P<data>(?:[0-9A-Fa-f]{2}\.?)*|R[0-8]?)(?:_[9A-Fa-f])?(?:\s+[RT])?"
)


def _irregular(text: bytes, line: int, chunk: Chunk) -> Frame | None:
    """One line by itself: a frame, or counted as what it is."""
    text = text.strip()
    if not text:
        chunk.blank += 1
        return None
    found = _LINE.fullmatch(text)
    if found is None:
        chunk.refused.append(RefusedLine(line, f"no frame: {text[:60].decode('ascii', 'backslashreplace')}"))
        return None
    number, is_long = int(found["id"], 16), len(found["id"]) > 3
    seconds = int(found["s"])
    if is_long and _ERROR <= number < 2 * _ERROR:
        chunk.errors += 1
    elif number > (_LAST_ID if is_long else _LAST_STANDARD_ID) or seconds > _GREATEST_STAMP_S:
        chunk.refused.append(RefusedLine(line, f"identifier or stamp too great: {text[:40].decode('ascii')}"))
    elif found["data"].startswith(b"R") and not found["fd"]:
        chunk.remote += 1
    elif len(data := _unhexed(found["data"])) > _LONGEST[bool(found["fd"])] or found["data"].startswith(b"R"):
        chunk.refused.append(RefusedLine(line, f"{len(data)} bytes: no payload of such a frame"))
    else:
        stamp_ns = seconds * NS_PER_S + int(found["f"].ljust(9, b"0"))
        return line, stamp_ns, number | EXTENDED if is_long else number, data
    return None


def _unhexed(digits: bytes) -> bytes:
    return b"" if digits.startswith(b"R") else bytes.fromhex(digits.replace(b".", b"").decode("ascii"))
