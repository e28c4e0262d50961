"""The frames of given messages in a log of any kind, in its order."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.frames import EXTENDED, Bools, Chunk, Frames, Ints
from vehicle_iface.logs.kinds import READABLE
from vehicle_iface.logs.reading import open_log

Progress = Callable[[int, int], None]
"""Called with the number of bytes done and their total."""


LogChannels = Mapping[str, str | None]
"""Name of each bus, in the profile's order → its channel in the log; None: the only channel."""
ANY_CHANNEL: LogChannels = MappingProxyType({"": None})
"""Channels of a profile with one bus."""


class LoggedFrame(NamedTuple):
    """One frame of a known message."""

    name: str
    stamp_ns: int
    data: bytes


def read_frames(
    path: Path,
    messages: Sequence[BoundMessage],
    *,
    channels: LogChannels = ANY_CHANNEL,
    progress: Progress | None = None,
) -> Iterator[LoggedFrame]:
    """Return the frames of the messages, each on the channel of its bus.

    `ConfigError` when the log cannot be read, has none of the messages, has no such channel, or has the messages of the
    only bus on several channels of which none is chosen.
    """
    log, selected = open_log(path), tuple(channels.values())
    counts: dict[str, int] = {}
    has_any = False
    for chunk in log.chunks:
        for frame in _read_chunk(chunk, messages, selected, counts):
            has_any = True
            yield frame
        if progress is not None:
            progress(chunk.done_bytes, chunk.total_bytes)
        present = {name: count for name, count in counts.items() if count}
        if None in selected and len(present) > 1:
            raise ConfigError(f"{path}: the profile's messages are on several channels; choose one: {_ways(present)}")
    if not counts:
        raise ConfigError(f"{path}: no frame, read as {log.kind.value}. Logs that can be read: {READABLE}")
    for bus, channel in channels.items():
        if channel is not None and channel not in counts:
            option = f"--channel {bus}={channel}" if bus else f"--channel {channel}"
            raise ConfigError(f"{option}: must be one of {path}: {_ways(counts, bus)}")
    if not has_any:
        names = ", ".join(message.name for message in messages[:8])
        raise ConfigError(
            f"{path}: no frame of the profile's messages ({names}); choose another --profile or --channel"
        )


def _ways(counts: Mapping[str, int], bus: str = "") -> str:
    option = f"--channel {bus}=" if bus else "--channel "
    return ", ".join(f"{option}{name or repr(name)} ({count} frames)" for name, count in sorted(counts.items()))


def _read_chunk(
    chunk: Chunk, messages: Sequence[BoundMessage], channels: Sequence[str | None], counts: dict[str, int]
) -> Iterator[LoggedFrame]:
    found: list[tuple[int, LoggedFrame]] = []
    for frames in chunk.frames:
        counts.setdefault(frames.channel, 0)
        for message in messages:
            rows = np.flatnonzero(_matches(frames.keys, message))
            counts[frames.channel] += len(rows)
            if channels[message.bus] in (None, frames.channel):
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
