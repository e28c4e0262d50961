"""Compares frames that were sent when a drive was recorded with those of today."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest

from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.errors import SignalError
from vehicle_iface.frame import FrameKey
from vehicle_iface.recorder.inputs import FrameFields
from vehicle_iface.rerun.report import Difference, FieldDifference

AHEAD = 64
"""So many frames of one identifier may be missing in a log, or be another node's, before the next one is found."""


class Comparison:
    """Names the messages of a vehicle and their signals."""

    def __init__(self, database: VehicleDatabase) -> None:
        self._messages = {message.key: message for message in database.sent}

    def compare_pass(
        self, number: int, at_s: float, recorded: Sequence[FrameFields], today: Sequence[FrameFields]
    ) -> Iterator[Difference]:
        """Yield each frame of a pass that differs: the first with the first of the same identifier, and so on."""
        if recorded == today:  # stamps of frames to be sent are 0
            return
        groups: dict[FrameKey, tuple[list[bytes], list[bytes]]] = {}
        for side, frames in enumerate((recorded, today)):
            for frame in frames:
                groups.setdefault(key_of(frame), ([], []))[side].append(frame[1])
        for key, (then, now) in groups.items():
            for before, after in zip_longest(then, now):
                if before != after:
                    yield self.describe(number, at_s, key, before, after)

    def compare_log(
        self, sent: Iterable[tuple[int, float, FrameFields]], logged: dict[FrameKey, list[bytes]]
    ) -> Iterator[Difference | None]:
        """Yield for each frame that was sent, with pass and time, None where the log has it next, or the difference."""
        places = dict.fromkeys(logged, 0)
        for number, at_s, frame in sent:
            key, data = key_of(frame), frame[1]
            place, lines = places.get(key, 0), logged.get(key, [])
            try:
                places[key] = lines.index(data, place, place + AHEAD) + 1
            except ValueError:
                nearest = lines[place] if place < len(lines) else None
                yield self.describe(number, at_s, key, nearest, data, is_in_log=True)
            else:
                yield None

    def describe(
        self,
        number: int,
        at_s: float,
        key: FrameKey,
        recorded: bytes | None,
        today: bytes | None,
        *,
        is_in_log: bool = False,
    ) -> Difference:
        """Describe a difference, signal by signal."""
        return Difference(
            number=number,
            at_s=at_s,
            message=self.name(key),
            recorded="" if recorded is None else recorded.hex().upper(),
            today="" if today is None else today.hex().upper(),
            fields=[] if recorded is None or today is None else self._fields(key, recorded, today),
            is_in_log=is_in_log,
        )

    def name(self, key: FrameKey) -> str:
        """Return the name of a message, or its identifier."""
        message = self._messages.get(key)
        return message.name if message is not None else f"0x{key.can_id:X}"

    def signals(self, key: FrameKey) -> Sequence[str]:
        """Return the names of the signals of a message that the profile binds."""
        message = self._messages.get(key)
        return () if message is None else message.codec.names

    def _fields(self, key: FrameKey, recorded: bytes, today: bytes) -> list[FieldDifference]:
        before, after = self.decode(key, recorded), self.decode(key, today)
        return [
            FieldDifference(signal=name, recorded=before.get(name, "invalid"), today=after.get(name, "invalid"))
            for name in before | after
            if before.get(name) != after.get(name)
        ]

    def decode(self, key: FrameKey, data: bytes) -> dict[str, float]:
        """Return the signals of a payload in the DBC's units; none where it cannot be decoded."""
        message = self._messages.get(key)
        if message is None or len(data) != message.length:
            return {}
        try:
            values = message.codec.decode(data)
        except SignalError:
            return {}
        return {name: value for name, value in zip(message.codec.names, values, strict=True) if value is not None}


def key_of(frame: FrameFields) -> FrameKey:
    """Return the identity of a frame."""
    return FrameKey(frame[0], frame[3], frame[7])
