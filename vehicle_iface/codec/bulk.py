"""A whole recording to columns: NumPy arrays of each signal of each message, by the layout that the loop decodes with.

`BulkCodec(message).decode(data)` takes payloads as a matrix and gives what `MessageCodec` gives row by row, to the
last bit. `decode_log(path, messages)` does that for a candump log, and says what became of every line of it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from cantools.database import Message
from cantools.database.conversion import IdentityConversion
from numpy.typing import NDArray

from vehicle_iface.codec.candump import EXTENDED, Bools, Bytes, Chunk, Frames, Ints, RefusedLine, read_candump
from vehicle_iface.codec.layout import Field, Layout
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import CanFrame

Column = NDArray[Any]
"""float64; int64 where scale and offset are whole, uint64 or (beyond 64 bits) Python's int where int64 has no room."""
Progress = Callable[[int, int], None]
"""Called with the bytes that are done and all of them."""
_WORD = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """The frames of one message, in the order of the log."""

    lines: Ints
    """(n,) Line of the log, from 1; position among the frames where there was no log."""
    stamps_ns: Ints
    """(n,) As in the log."""
    values: Mapping[str, Column]
    """(n,) Of each signal, in the DBC's units. A signal that a multiplexer hides in some rows is a masked array:
    a value that was not there is neither 0 nor NaN."""
    out_of_range: Mapping[str, Bools]
    """(n,) With `checked`: where a value is not finite, outside the DBC's range or not one of its VAL_ table. Signals
    without such a row are left out."""

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def in_range(self) -> Bools:
        """(n,) Rows that a checked `MessageCodec` accepts; all of them unless they were `checked`."""
        good = np.ones(len(self), bool)
        for bad in self.out_of_range.values():
            good &= ~bad
        return good


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """What a log came to: `lines` is the sum of all that follows it."""

    messages: Mapping[str, Columns]
    """Of every message that was asked for, also one that never came."""
    lines: int
    decoded: int
    foreign: int
    """Data frames with other identifiers."""
    remote: int
    errors: int
    """Error frames."""
    blank: int
    refused: Sequence[RefusedLine]
    """Lines that are no frame, and frames that are too short or of an unknown multiplexer, in the log's order."""


@dataclass(frozen=True, slots=True)
class Decoded:
    """Payloads after the codec."""

    values: Mapping[str, Column]
    shown: Mapping[str, Bools]
    """(n,) Where a multiplexed signal is there."""
    known: Bools
    """(n,) Where every multiplexer has a known number. Elsewhere `MessageCodec` refuses the frame."""
    out_of_range: Mapping[str, Bools]


class BulkCodec:
    """One message's layout, applied to all its frames at once. `ConfigError` when it cannot be compiled."""

    def __init__(self, message: Message, checked: bool = False) -> None:
        self._layout = Layout.of(message)
        self._checked = checked
        self.names = tuple(field.name for field in self._layout.fields)
        self.length: int = message.length
        """Payload, bytes."""

    def decode(self, data: Bytes) -> Decoded:
        """The values of payloads (n, length or more), longer ones cut as `MessageCodec(checked=False)` does."""
        data = data[:, : self.length]
        words = {is_big: _words(data, is_big) for is_big in {field.is_big for field in self._layout.fields}}
        raw = {field.name: _extracted(field, words[field.is_big]) for field in self._layout.fields}
        with np.errstate(all="ignore"):  # infinities and NaN of float signals are values here
            values = {field.name: _scaled(field, raw[field.name]) for field in self._layout.fields}
        shown, known = self._shown(values, len(data))
        out_of_range: dict[str, Bools] = {}
        for one in self._layout.fields if self._checked else ():
            bad = _out_of_range(one, raw[one.name], values[one.name]) & shown.get(one.name, True)
            if bad.any():
                out_of_range[one.name] = bad
        return Decoded(values, shown, known, out_of_range)

    def _shown(self, values: Mapping[str, Column], count: int) -> tuple[dict[str, Bools], Bools]:
        """Where each dependent signal is there, parents first; and where no multiplexer is unknown."""
        shown: dict[str, Bools] = {}
        known = np.ones(count, bool)
        waiting = [root for root in self._layout.roots if self._layout.branches.get(root.name)]
        while waiting:
            parent = waiting.pop()
            here = shown.get(parent.name, True)
            numbers, any_branch = _whole(values[parent.name]), np.zeros(count, bool)
            for branch in self._layout.branches[parent.name]:
                hit = np.isin(numbers, branch.ids) & here
                any_branch |= hit
                for child in branch.fields:
                    shown[child.name] = shown.get(child.name, False) | hit
            known &= any_branch | ~np.broadcast_to(here, (count,))
            children = {child.name: child for branch in self._layout.branches[parent.name] for child in branch.fields}
            for child in self._layout.fields:
                if child.parent == parent.name:
                    shown.setdefault(child.name, np.zeros(count, bool))
            waiting += [child for child in children.values() if self._layout.branches.get(child.name)]
        return shown, known


def decode_log(
    path: Path, messages: Iterable[Message], *, checked: bool = False, progress: Progress | None = None
) -> Recording:
    """All frames of the messages in a candump log (`candump -L`).

    `ConfigError` when the file cannot be read, two of the messages have one identifier, or one cannot be compiled.
    Whether a frame was FD is not looked at, nor a checksum: a recording shows what was on the bus.
    """
    collector = _Collector(messages, checked)
    for chunk in read_candump(path):
        collector.take(chunk)
        if progress is not None:
            progress(chunk.done_bytes, chunk.total_bytes)
    return collector.recording()


def decode_frames(frames: Iterable[CanFrame], messages: Iterable[Message], *, checked: bool = False) -> Recording:
    """The same for frames from any other reader; lines are positions, from 1."""
    collector = _Collector(messages, checked)
    by_length: dict[int, list[tuple[int, int, int, bytes]]] = {}
    rest = Chunk()
    for rest.lines, frame in enumerate(frames, start=1):
        if frame.is_error or frame.is_remote:
            rest.errors += frame.is_error
            rest.remote += not frame.is_error
        else:
            key = frame.can_id | (EXTENDED if frame.is_extended else 0)
            by_length.setdefault(len(frame.data), []).append((rest.lines, frame.stamp_ns, key, frame.data))
    rest.frames = [Frames.of(group) for group in by_length.values()]
    collector.take(rest)
    return collector.recording()


@dataclass(slots=True)
class _Parts:
    """What has come of one message."""

    name: str
    codec: BulkCodec
    lines: list[Ints] = field(default_factory=list)
    stamps_ns: list[Ints] = field(default_factory=list)
    decoded: list[Decoded] = field(default_factory=list)

    def columns(self) -> Columns:
        if not self.decoded:
            self.add(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, self.codec.length), np.uint8))
        lines, decoded = np.concatenate(self.lines), self.decoded
        order = slice(None) if bool(np.all(lines[1:] > lines[:-1])) else np.argsort(lines, kind="stable")
        faulty = {name for part in decoded for name in part.out_of_range}
        return Columns(
            lines=lines[order],
            stamps_ns=np.concatenate(self.stamps_ns)[order],
            values={name: self._column(name)[order] for name in self.codec.names},
            out_of_range={
                name: np.concatenate(
                    [part.out_of_range.get(name, np.zeros(len(part.known), bool)) for part in decoded]
                )[order]
                for name in self.codec.names
                if name in faulty
            },
        )

    def add(self, lines: Ints, stamps_ns: Ints, data: Bytes) -> Ints:
        """Decode some frames; the lines of those that no codec would decode."""
        decoded = self.codec.decode(data)
        known = decoded.known
        if not known.all():
            unknown = lines[~known]
            return np.concatenate((unknown, self.add(lines[known], stamps_ns[known], data[known])))
        self.lines.append(lines)
        self.stamps_ns.append(stamps_ns)
        self.decoded.append(decoded)
        return lines[:0]

    def _column(self, name: str) -> Column:
        values = np.concatenate([part.values[name] for part in self.decoded])
        if name not in self.decoded[0].shown:
            return values
        return np.ma.MaskedArray(values, ~np.concatenate([part.shown[name] for part in self.decoded]))


class _Collector:
    """Sorts frames to their messages, and counts the rest."""

    def __init__(self, messages: Iterable[Message], checked: bool) -> None:
        parts: dict[int, _Parts] = {}
        for message in messages:
            key = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
            if key in parts:
                raise ConfigError(f"{message.name} and {parts[key].name} have one identifier, {message.frame_id:#x}")
            parts[key] = _Parts(message.name, BulkCodec(message, checked))
        self._keys = np.array(sorted(parts), np.int64)
        self._parts = [parts[key] for key in sorted(parts)]
        self._in_order = list(parts.values())
        self._total = Chunk()
        self._decoded = self._foreign = 0

    def take(self, chunk: Chunk) -> None:
        total = self._total
        total.lines += chunk.lines
        total.blank += chunk.blank
        total.remote += chunk.remote
        total.errors += chunk.errors
        total.refused += chunk.refused
        for frames in chunk.frames:
            self._take_frames(frames)

    def recording(self) -> Recording:
        total = self._total
        return Recording(
            messages={parts.name: parts.columns() for parts in self._in_order},
            lines=total.lines,
            decoded=self._decoded,
            foreign=self._foreign,
            remote=total.remote,
            errors=total.errors,
            blank=total.blank,
            refused=tuple(sorted(total.refused, key=lambda refused: refused.line)),
        )

    def _take_frames(self, frames: Frames) -> None:
        for index, rows in self._by_message(frames.keys):
            parts, lines, length = self._parts[index], frames.lines[rows], frames.data.shape[1]
            if length < parts.codec.length:
                self._refuse(lines, f"{parts.name}: {length} bytes: must be {parts.codec.length}")
                continue
            unknown = parts.add(lines, frames.stamps_ns[rows], frames.data[rows])
            self._refuse(unknown, f"{parts.name}: unknown multiplexer")
            self._decoded += len(lines) - len(unknown)

    def _by_message(self, keys: Ints) -> Iterator[tuple[int, NDArray[np.intp]]]:
        """Index of each message that is there, and its rows in their order."""
        if not len(self._keys) or not len(keys):
            self._foreign += len(keys)
            return
        place = np.searchsorted(self._keys, keys).astype(np.uint16)
        place[self._keys[np.minimum(place, len(self._keys) - 1)] != keys] = len(self._keys)
        counts = np.bincount(place, minlength=len(self._keys) + 1)
        self._foreign += int(counts[-1])
        rows = np.split(np.argsort(place, kind="stable"), np.cumsum(counts)[:-1])
        for index in np.flatnonzero(counts[:-1]).tolist():
            yield index, rows[index]

    def _refuse(self, lines: Ints, why: str) -> None:
        self._total.refused += [RefusedLine(line, why) for line in lines.tolist()]


def _words(data: Bytes, is_big: bool) -> NDArray[np.uint64]:
    """Payloads as rows of 64-bit words, the least significant first: a big-endian payload is read from its end."""
    count, length = data.shape
    ordered = data[:, ::-1] if is_big else data
    width = max(1, -(-length // 8)) * 8
    if length == width:
        return np.ascontiguousarray(ordered).view("<u8").astype(np.uint64, copy=False)
    padded = np.zeros((count, width), np.uint8)
    padded[:, :length] = ordered
    return padded.view("<u8").astype(np.uint64, copy=False)


def _extracted(one: Field, words: NDArray[np.uint64]) -> Column:
    """The raw integer of a signal, sign extended, as int64 (uint64 for 64 unsigned bits)."""
    index, shift = divmod(one.shift, _WORD)
    bits = words[:, index]
    if shift + one.width > _WORD:
        bits = bits >> np.uint64(shift) | words[:, index + 1] << np.uint64(_WORD - shift)
        shift = 0
    if one.is_signed:
        lifted = bits << np.uint64(_WORD - shift - one.width)
        return lifted.view(np.int64) >> np.int64(_WORD - one.width)
    if shift:
        bits = bits >> np.uint64(shift)
    if one.width == _WORD:
        return np.ascontiguousarray(bits)
    return (bits & np.uint64((1 << one.width) - 1)).view(np.int64)


def _scaled(one: Field, raw: Column) -> Column:
    """The physical values by the very operations of `MessageCodec`."""
    if one.is_float:
        kind, bits = {16: (np.float16, np.uint16), 32: (np.float32, np.uint32), 64: (np.float64, np.uint64)}[one.width]
        number = raw.astype(bits).view(kind).astype(np.float64)
        return number if one.kind is IdentityConversion else number * float(one.scale) + float(one.offset)
    if one.kind is IdentityConversion:
        return raw
    scale, offset = one.scale, one.offset
    if isinstance(scale, int):
        product = _whole_product(one, raw, scale)
        if isinstance(offset, int):
            return _shifted(one, product, scale, offset)
        return product.astype(np.float64) + offset
    if offset == 0 and scale > 0:
        return raw * scale
    return raw * scale + offset


def _whole_product(one: Field, raw: Column, scale: int) -> Column:
    if _has_room(one.raw_minimum * scale, one.raw_maximum * scale) and raw.dtype == np.int64:
        return raw * scale
    return raw.astype(object) * scale


def _shifted(one: Field, product: Column, scale: int, offset: int) -> Column:
    """A whole product with a whole offset, in the narrowest exact type."""
    ends = (one.raw_minimum * scale + offset, one.raw_maximum * scale + offset)
    if product.dtype == np.int64 and _has_room(*ends):
        return product + offset
    exact = product.astype(object) + offset
    if _has_room(*ends):
        return exact.astype(np.int64)
    return exact.astype(np.uint64) if min(ends) >= 0 and max(ends) < 1 << 64 else exact


def _has_room(*numbers: int) -> bool:
    return all(-(1 << 63) <= number < 1 << 63 for number in numbers)


def _whole(values: Column) -> Column:
    """A multiplexer's number; one that is not finite, or beyond all ids, is none of them."""
    if values.dtype != np.float64:
        return values
    usable = np.isfinite(values) & (np.abs(values) < 1 << 62)
    return np.where(usable, values, -(1 << 62)).astype(np.int64)


def _out_of_range(one: Field, raw: Column, values: Column) -> Bools:
    if one.is_float:
        with np.errstate(invalid="ignore"):
            inside = (values >= one.lowest) & (values <= one.highest)
        bad: Bools = ~(np.isfinite(values) & inside)
        return bad
    low, high, named = one.allowed_raw()
    if named is not None:
        return ~np.isin(raw, np.array(sorted(named), raw.dtype))
    if (low, high) == (one.raw_minimum, one.raw_maximum):
        return np.zeros(len(raw), bool)
    if low > high:
        return np.ones(len(raw), bool)
    outside: Bools = (raw < low) | (raw > high)
    return outside


def summary(recording: Recording) -> Iterator[str]:
    """Lines for a person: what was found."""
    for name, columns in recording.messages.items():
        bad = len(columns) - int(columns.in_range.sum())
        yield f"{name}: {len(columns)} frames" + (f", {bad} with values out of range" if bad else "")
    counts = {
        "lines": recording.lines,
        "decoded": recording.decoded,
        "of other identifiers": recording.foreign,
        "remote": recording.remote,
        "error frames": recording.errors,
        "blank": recording.blank,
        "refused": len(recording.refused),
    }
    yield ", ".join(f"{count} {what}" for what, count in counts.items() if count or what in ("lines", "decoded"))


def save(recording: Recording, file: BinaryIO) -> None:
    """The `arrays` of a recording in NumPy's npz format."""
    np.savez(file, allow_pickle=False, **arrays(recording))


def arrays(recording: Recording) -> dict[str, NDArray[Any]]:
    """Names and arrays for npz: MESSAGE.SIGNAL, MESSAGE:stamp_ns, MESSAGE:line; for a signal that a
    multiplexer hides also MESSAGE.SIGNAL:shown. Whole numbers beyond 64 bits become floats."""
    found: dict[str, NDArray[Any]] = {}
    for name, columns in recording.messages.items():
        found[f"{name}:stamp_ns"] = columns.stamps_ns
        found[f"{name}:line"] = columns.lines
        for signal, values in columns.values.items():
            plain = np.ma.getdata(values)
            found[f"{name}.{signal}"] = plain.astype(np.float64) if plain.dtype == object else plain
            if isinstance(values, np.ma.MaskedArray):
                found[f"{name}.{signal}:shown"] = ~np.ma.getmaskarray(values)
        for signal, bad in columns.out_of_range.items():
            found[f"{name}.{signal}:out_of_range"] = bad
    return found
