"""The frames of given messages in a log of any kind, in its order."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.frames import EXTENDED, Bools, Chunk, Frames, Ints
from vehicle_iface.logs.kinds import READABLE
from vehicle_iface.logs.reading import open_log

Progress = Callable[[int, int], None]
"""Called with the bytes that are done and all of them."""


class LoggedFrame(NamedTuple):
    """One frame of a known message."""

    name: str
    stamp_ns: int
    data: bytes


def read_frames(
    path: Path, messages: Sequence[BoundMessage], *, channel: str | None = None, progress: Progress | None = None
) -> Iterator[LoggedFrame]:
    """The frames of the messages, of one channel.

    `ConfigError` when the log cannot be read, has none of the messages, or has them on several channels of which none
    is chosen.
    """
    log = open_log(path)
    channels: dict[str, int] = {}
    for chunk in log.chunks:
        yield from _read_chunk(chunk, messages, channel, channels)
        if progress is not None:
            progress(chunk.done_bytes, chunk.total_bytes)
        present = {name: count for name, count in channels.items() if count}
        if channel is None and len(present) > 1:
            raise ConfigError(f"{path}: the profile's messages are on several channels; choose one: {_ways(present)}")
    if not channels:
        raise ConfigError(f"{path}: no frame, read as {log.kind.value}. Logs that can be read: {READABLE}")
    if channel is not None and channel not in channels:
        raise ConfigError(f"--channel {channel}: must be one of {path}: {_ways(channels)}")
    if not channels.get(channel, 0) if channel is not None else not any(channels.values()):
        names = ", ".join(message.name for message in messages[:8])
        raise ConfigError(
            f"{path}: no frame of the profile's messages ({names}); choose another --profile or --channel"
        )


def _ways(counts: dict[str, int]) -> str:
    return ", ".join(f"--channel {name or repr(name)} ({count} frames)" for name, count in sorted(counts.items()))


def _read_chunk(
    chunk: Chunk, messages: Sequence[BoundMessage], channel: str | None, channels: dict[str, int]
) -> Iterator[LoggedFrame]:
    found: list[tuple[int, LoggedFrame]] = []
    for frames in chunk.frames:
        channels.setdefault(frames.channel, 0)
        for message in messages:
            rows = np.flatnonzero(_matches(frames.keys, message))
            channels[frames.channel] += len(rows)
            if channel in (None, frames.channel):
                found += _read_rows(frames, message.name, rows)
    found.sort(key=lambda one: one[0])
    yield from (frame for _, frame in found)


def _matches(keys: Ints, message: BoundMessage) -> Bools:
    key = message.can_id | (EXTENDED if message.is_extended else 0)
    matches: Bools = ((keys ^ key) & (message.id_mask | EXTENDED)) == 0
    return matches


def _read_rows(frames: Frames, name: str, rows: "np.typing.NDArray[np.intp]") -> Iterator[tuple[int, LoggedFrame]]:
    length = frames.data.shape[1]
    payload = frames.data[rows].tobytes()
    pairs = zip(frames.lines[rows].tolist(), frames.stamps_ns[rows].tolist(), strict=True)
    for index, (line, stamp_ns) in enumerate(pairs):
        yield line, LoggedFrame(name, stamp_ns, payload[index * length : (index + 1) * length])
