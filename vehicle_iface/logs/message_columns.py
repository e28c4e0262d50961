"""The frames of messages as columns: a NumPy array of each signal."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vehicle_iface.codec.cantools_classes import Message
from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.bulk_codec import BulkCodec, Column, Decoded
from vehicle_iface.logs.frames import EXTENDED, Bools, Bytes, Ints


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """The frames of one message, in the order of the log."""

    lines: Ints
    """(n,) Line of the log, from 1."""
    stamps_ns: Ints
    """(n,) Stamps as in the log."""
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


@dataclass(slots=True)
class MessageParts:
    """Decoded parts of one message."""

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
        """Decode some frames; return the lines of those that cannot be decoded."""
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


class MessageGroup:
    """The messages of one channel, or of all channels."""

    def __init__(self, messages: Iterable[Message], checked: bool) -> None:
        parts: dict[int, MessageParts] = {}
        for message in messages:
            key = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
            if key in parts:
                raise ConfigError(f"{message.name} and {parts[key].name} have one identifier, {message.frame_id:#x}")
            parts[key] = MessageParts(message.name, BulkCodec(message, checked))
        self.keys = np.array(sorted(parts), np.int64)
        self.parts = [parts[key] for key in sorted(parts)]
        self.in_order = list(parts.values())

    def by_message(self, keys: Ints) -> Iterator[tuple[int, NDArray[np.intp]]]:
        """Return the index of each present message, and its rows in order."""
        if not len(self.keys) or not len(keys):
            return
        place = np.searchsorted(self.keys, keys).astype(np.uint16)
        place[self.keys[np.minimum(place, len(self.keys) - 1)] != keys] = len(self.keys)
        counts = np.bincount(place, minlength=len(self.keys) + 1)
        rows = np.split(np.argsort(place, kind="stable"), np.cumsum(counts)[:-1])
        for index in np.flatnonzero(counts[:-1]).tolist():
            yield index, rows[index]
