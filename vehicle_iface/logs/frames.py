"""Frames of a log as arrays, and an account of the lines that are not frames."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicle_iface.units import NS_PER_S

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

EXTENDED = 1 << 31
"""Set in the key of an extended identifier."""
LAST_ID, LAST_STANDARD_ID = 0x1FFFFFFF, 0x7FF
MAX_CLASSICAL_BYTES, MAX_FD_BYTES = 8, 64
GREATEST_STAMP_S = (2**63 - 1) // NS_PER_S - 1


class Frame(NamedTuple):
    """One data frame."""

    line: int
    stamp_ns: int
    key: int
    """Identifier, plus `EXTENDED` for one of 29 bits."""
    data: bytes
    channel: str
    """The bus as the log names it; empty where the log names none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Data frames of one channel with payloads of one length, in the order of the log."""

    lines: Ints
    """(n,) Line of the file, from 1."""
    stamps_ns: Ints
    """(n,) The log's own stamps, mostly of a wall clock."""
    keys: Ints
    """(n,) Identifier, plus `EXTENDED` for one of 29 bits."""
    data: Bytes
    """(n, length)"""
    channel: str
    """The bus as the log names it; empty where the log names none."""


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
    comments: int = 0
    """Headers, comments and events that are no frames."""
    remote: int = 0
    errors: int = 0
    """Error frames: what the adapter said of the bus."""
    refused: list[RefusedLine] = field(default_factory=list)
    done_bytes: int = 0
    """From the beginning of the file."""
    total_bytes: int = 0

    def add(self, frames: Iterable[Frame]) -> None:
        """Add some frames, arranged by channel and length."""
        groups: dict[tuple[str, int], list[Frame]] = {}
        for frame in frames:
            groups.setdefault((frame.channel, len(frame.data)), []).append(frame)
        for (channel, length), group in groups.items():
            lines, stamps_ns, keys, data, _ = zip(*group, strict=True)
            self.frames.append(
                Frames(
                    lines=np.array(lines, np.int64),
                    stamps_ns=np.array(stamps_ns, np.int64),
                    keys=np.array(keys, np.int64),
                    data=np.frombuffer(b"".join(data), np.uint8).reshape(len(group), length),
                    channel=channel,
                )
            )
