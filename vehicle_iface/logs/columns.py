"""A whole log to columns: `decode_log(path, messages)` gives a NumPy array of each signal of each message, and says
what became of every line.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vehicle_iface.codec.cantools_classes import Message
from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.frames import Chunk, Frames, Ints, RefusedLine
from vehicle_iface.logs.kinds import READABLE
from vehicle_iface.logs.message_columns import Columns, MessageGroup
from vehicle_iface.logs.reading import OpenedLog, open_log

Progress = Callable[[int, int], None]
"""Called with the number of bytes done and their total."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DecodedLog:
    """Content of a log: `lines` is the sum of all counts below it."""

    messages: Mapping[str, Columns]
    """Columns of every requested message, also one without frames."""
    lines: int
    decoded: int
    foreign: int
    """Number of data frames with other identifiers."""
    other_channels: int
    """Number of data frames of other channels."""
    remote: int
    errors: int
    """Number of error frames."""
    blank: int
    comments: int
    """Number of headers, comments and events that are no frames."""
    refused: Sequence[RefusedLine]
    """Lines that are no frame, and frames that are too short or of an unknown multiplexer, in the log's order."""
    channels: Mapping[str, int]
    """Each channel of the log, also those that were not asked for, with its frames of the messages."""
    kind: str
    """Recognised kind of the log."""
    stamps: str
    """Meaning of the stamps, for a person."""

    @property
    def has_frames(self) -> bool:
        """Whether any line is a frame, of any identifier and channel."""
        return bool(self.channels or self.remote or self.errors)


def decode_log(
    path: Path,
    messages: Iterable[Message],
    *,
    checked: bool = False,
    channel: str | None = None,
    progress: Progress | None = None,
) -> DecodedLog:
    """Decode all frames of the messages on one channel in a log of any supported kind (`kinds.LogKind`).

    `ConfigError` when the file or none of its lines can be read, the messages come on more than one channel and none
    is chosen, the chosen one is not in the log, two of the messages have one identifier, or one cannot be compiled.
    FD flags and checksums are not checked: a log shows what was on the bus.
    """
    log = scan_log(open_log(path), messages, checked=checked, channel=channel, progress=progress)
    _require_frames(path, log)
    present = {name: count for name, count in log.channels.items() if count}
    if channel is None and len(present) > 1:
        listed = _list_channels(present)
        raise ConfigError(
            f"{path}: frames of these messages on {len(present)} channels: {listed}: choose one: --channel"
        )
    if channel is not None and channel not in log.channels:
        raise ConfigError(f"--channel {channel}: must be one of {path}: {_list_channels(log.channels)}")
    return log


def decode_buses(
    path: Path,
    messages: Mapping[str, Iterable[Message]],
    *,
    checked: bool = False,
    progress: Progress | None = None,
) -> DecodedLog:
    """Decode a log of several buses, as `decode_log`; `messages` are by channel."""
    groups: dict[str | None, MessageGroup] = {}
    for channel, on_channel in messages.items():
        groups[channel] = MessageGroup(on_channel, checked)
    log = _collect(open_log(path), _Collector(groups), progress)
    _require_frames(path, log)
    for channel in messages:
        if channel not in log.channels:
            ways = _list_channels(log.channels)
            raise ConfigError(f"{path}: no channel {channel}, but {ways}: say which bus is which: --channel BUS=NAME")
    return log


def _require_frames(path: Path, log: DecodedLog) -> None:
    if not log.has_frames:
        why = f"; line {log.refused[0].line}: {log.refused[0].why}" if log.refused else ""
        ways = f"Logs that can be read: {READABLE}; python-can's can_logconvert converts others"
        raise ConfigError(f"{path}: no frame in {log.lines} lines, read as {log.kind}{why}. {ways}")


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
    """Decode as `decode_log`, but accept a log without frames; without a channel, all channels are merged."""
    return _collect(opened, _Collector({channel: MessageGroup(messages, checked)}), progress)


def _collect(opened: OpenedLog, collector: "_Collector", progress: Progress | None) -> DecodedLog:
    for chunk in opened.chunks:
        collector.take(chunk)
        if progress is not None:
            progress(chunk.done_bytes, chunk.total_bytes)
    return collector.result(opened.kind.value, opened.describe_stamps())


class _Collector:
    """Sorts frames to their messages, and counts the rest."""

    def __init__(self, groups: Mapping[str | None, MessageGroup]) -> None:
        """Messages by channel; None for those of any channel."""
        self._groups = groups
        self._keys = np.concatenate([group.keys for group in self._groups.values()])
        self._total = Chunk()
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
            messages={parts.name: parts.columns() for group in self._groups.values() for parts in group.in_order},
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
        group = self._groups.get(frames.channel, self._groups.get(None))
        counted = self._channels.get(frames.channel, 0)
        if group is None:
            self._channels[frames.channel] = counted + int(np.isin(frames.keys, self._keys).sum())
            self._other_channels += len(frames.keys)
            return
        found = list(group.by_message(frames.keys))
        bound = sum(len(rows) for _, rows in found)
        self._channels[frames.channel] = counted + bound
        self._foreign += len(frames.keys) - bound
        for index, rows in found:
            parts, lines, length = group.parts[index], frames.lines[rows], frames.data.shape[1]
            if length < parts.codec.length:
                self._refuse(lines, f"{parts.name}: {length} bytes: must be {parts.codec.length}")
                continue
            unknown = parts.add(lines, frames.stamps_ns[rows], frames.data[rows])
            self._refuse(unknown, f"{parts.name}: unknown multiplexer")
            self._decoded += len(lines) - len(unknown)

    def _refuse(self, lines: Ints, why: str) -> None:
        self._total.refused += [RefusedLine(line, why) for line in lines.tolist()]


def summarize(log: DecodedLog) -> Iterator[str]:
    """Return the counts as lines for a person."""
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
    """Save the arrays of a log (`to_arrays`) in NumPy's npz format."""
    np.savez(file, allow_pickle=False, **to_arrays(log))


def to_arrays(log: DecodedLog) -> dict[str, NDArray[Any]]:
    """Return names and arrays for npz: MESSAGE.SIGNAL, MESSAGE:stamp_ns, MESSAGE:line; for a signal that a
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
