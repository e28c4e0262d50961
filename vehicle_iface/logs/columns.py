"""A whole log to columns: `decode_log(path, messages)` gives a NumPy array of each signal of each message, and says
what became of every line.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from cantools.database import Message
from numpy.typing import NDArray

from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.bulk_codec import BulkCodec, Column, Decoded
from vehicle_iface.logs.frames import EXTENDED, Bools, Bytes, Chunk, Frames, Ints, RefusedLine
from vehicle_iface.logs.kinds import READABLE
from vehicle_iface.logs.reading import OpenedLog, open_log

Progress = Callable[[int, int], None]
"""Called with the bytes that are done and all of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """The frames of one message, in the order of the log."""

    lines: Ints
    """(n,) Line of the log, from 1."""
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
class DecodedLog:
    """What a log came to: `lines` is the sum of all that follows it."""

    messages: Mapping[str, Columns]
    """Of every message that was asked for, also one that never came."""
    lines: int
    decoded: int
    foreign: int
    """Data frames with other identifiers."""
    other_channels: int
    """Data frames of channels that were not asked for."""
    remote: int
    errors: int
    """Error frames."""
    blank: int
    comments: int
    """Headers, comments and events that are no frames."""
    refused: Sequence[RefusedLine]
    """Lines that are no frame, and frames that are too short or of an unknown multiplexer, in the log's order."""
    channels: Mapping[str, int]
    """Each channel of the log, also those that were not asked for, with its frames of the messages."""
    kind: str
    """What the log was read as."""
    stamps: str
    """What the stamps mean, for a person."""

    @property
    def has_frames(self) -> bool:
        """Whether any line is a frame, of whatever identifier or channel."""
        return bool(self.channels or self.remote or self.errors)


def decode_log(
    path: Path,
    messages: Iterable[Message],
    *,
    checked: bool = False,
    channel: str | None = None,
    progress: Progress | None = None,
) -> DecodedLog:
    """All frames of the messages in a log of any kind that can be read (`kinds.LogKind`), of one channel.

    `ConfigError` when the file or none of its lines can be read, the messages come on more than one channel and none
    is chosen, the chosen one is not in the log, two of the messages have one identifier, or one cannot be compiled.
    Whether a frame was FD is not looked at, nor a checksum: a log shows what was on the bus.
    """
    log = scan_log(open_log(path), messages, checked=checked, channel=channel, progress=progress)
    if not log.has_frames:
        why = f"; line {log.refused[0].line}: {log.refused[0].why}" if log.refused else ""
        ways = f"Logs that can be read: {READABLE}; python-can's can_logconvert converts others"
        raise ConfigError(f"{path}: no frame in {log.lines} lines, read as {log.kind}{why}. {ways}")
    present = {name: count for name, count in log.channels.items() if count}
    if channel is None and len(present) > 1:
        listed = _list_channels(present)
        raise ConfigError(
            f"{path}: frames of these messages on {len(present)} channels: {listed}: choose one: --channel"
        )
    if channel is not None and channel not in log.channels:
        raise ConfigError(f"--channel {channel}: must be one of {path}: {_list_channels(log.channels)}")
    return log


def _list_channels(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name or 'without a name'} ({count} frames)" for name, count in sorted(counts.items()))


def scan_log(
    opened: OpenedLog,
    messages: Iterable[Message],
    *,
    checked: bool = False,
    channel: str | None = None,
    progress: Progress | None = None,
) -> DecodedLog:
    """As `decode_log`, but a log without frames is no error, and without a channel all of them are put together."""
    collector = _Collector(messages, checked, channel)
    for chunk in opened.chunks:
        collector.take(chunk)
        if progress is not None:
            progress(chunk.done_bytes, chunk.total_bytes)
    return collector.result(opened.kind.value, opened.describe_stamps())


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

    def __init__(self, messages: Iterable[Message], checked: bool, channel: str | None) -> None:
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
        self._channel = channel
        self._channels: dict[str, int] = {}
        self._decoded = self._foreign = self._other_channels = 0

    def take(self, chunk: Chunk) -> None:
        total = self._total
        total.lines += chunk.lines
        total.blank += chunk.blank
        total.comments += chunk.comments
        total.remote += chunk.remote
        total.errors += chunk.errors
        total.refused += chunk.refused
        for frames in chunk.frames:
            self._take_frames(frames)

    def result(self, kind: str, stamps: str) -> DecodedLog:
        total = self._total
        return DecodedLog(
            messages={parts.name: parts.columns() for parts in self._in_order},
            lines=total.lines,
            decoded=self._decoded,
            foreign=self._foreign,
            other_channels=self._other_channels,
            remote=total.remote,
            errors=total.errors,
            blank=total.blank,
            comments=total.comments,
            refused=tuple(sorted(total.refused, key=lambda refused: refused.line)),
            channels=self._channels,
            kind=kind,
            stamps=stamps,
        )

    def _take_frames(self, frames: Frames) -> None:
        found = list(self._by_message(frames.keys))
        bound = sum(len(rows) for _, rows in found)
        self._channels[frames.channel] = self._channels.get(frames.channel, 0) + bound
        if self._channel not in (None, frames.channel):
            self._other_channels += len(frames.keys)
            return
        self._foreign += len(frames.keys) - bound
        for index, rows in found:
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
            return
        place = np.searchsorted(self._keys, keys).astype(np.uint16)
        place[self._keys[np.minimum(place, len(self._keys) - 1)] != keys] = len(self._keys)
        counts = np.bincount(place, minlength=len(self._keys) + 1)
        rows = np.split(np.argsort(place, kind="stable"), np.cumsum(counts)[:-1])
        for index in np.flatnonzero(counts[:-1]).tolist():
            yield index, rows[index]

    def _refuse(self, lines: Ints, why: str) -> None:
        self._total.refused += [RefusedLine(line, why) for line in lines.tolist()]


def summarize(log: DecodedLog) -> Iterator[str]:
    """Lines for a person: what was found."""
    yield f"read as {log.kind}; stamps: {log.stamps}"
    for name, columns in log.messages.items():
        bad = len(columns) - int(columns.in_range.sum())
        yield f"{name}: {len(columns)} frames" + (f", {bad} with values out of range" if bad else "")
    counts = {
        "lines": log.lines,
        "decoded": log.decoded,
        "of other identifiers": log.foreign,
        "of other channels": log.other_channels,
        "remote": log.remote,
        "error frames": log.errors,
        "blank": log.blank,
        "headers, comments or events": log.comments,
        "refused": len(log.refused),
    }
    yield ", ".join(f"{count} {what}" for what, count in counts.items() if count or what in ("lines", "decoded"))


def save(log: DecodedLog, file: BinaryIO) -> None:
    """The arrays of a log (`to_arrays`) in NumPy's npz format."""
    np.savez(file, allow_pickle=False, **to_arrays(log))


def to_arrays(log: DecodedLog) -> dict[str, NDArray[Any]]:
    """Names and arrays for npz: MESSAGE.SIGNAL, MESSAGE:stamp_ns, MESSAGE:line; for a signal that a
    multiplexer hides also MESSAGE.SIGNAL:shown. Whole numbers beyond 64 bits become floats."""
    found: dict[str, NDArray[Any]] = {}
    for name, columns in log.messages.items():
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
