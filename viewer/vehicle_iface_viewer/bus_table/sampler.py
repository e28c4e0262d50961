"""Takes every value of the signals that are plotted from the frames. It reads no clock and no socket."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence

from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.errors import SignalError
from vehicle_iface.frame import CanFrame, FrameKey
from vehicle_iface_viewer.bus_table.finder import MessageFinder
from vehicle_iface_viewer.bus_table.report import Samples, SignalKey


class SignalSampler:
    """Decodes the messages of the chosen signals, and no other ones. Frames with a wrong checksum are decoded, too."""

    def __init__(self, finder: MessageFinder) -> None:
        self._finder = finder
        self._codecs: dict[FrameKey, MessageCodec] = {}
        self._places: dict[FrameKey, list[tuple[int, int]]] = {}
        """Of each identifier: place among the values of its message, and place among the chosen signals."""
        self._taken: list[Samples] = []

    @property
    def identifiers(self) -> list[FrameKey]:
        """Identifiers of the frames that are decoded."""
        return list(self._places)

    def choose(self, signals: Sequence[SignalKey]) -> None:
        """Take the values of these signals from now on; one that does not exist has none."""
        places: dict[FrameKey, list[tuple[int, int]]] = defaultdict(list)
        codecs: dict[FrameKey, MessageCodec] = {}
        for place, chosen in enumerate(signals):
            if chosen.bus not in self._finder.buses:
                continue
            key = FrameKey(int(chosen.can_id, 16), len(chosen.can_id) > 5, self._finder.buses.index(chosen.bus))
            codec = codecs.get(key) or self._codecs.get(key) or self._finder.find(key).compile_codec()
            if codec is not None and chosen.signal in codec.names:
                codecs[key] = codec
                places[key].append((codec.names.index(chosen.signal), place))
        self._codecs, self._places = codecs, places
        self._taken = [Samples([], []) for _ in signals]

    def add(self, frames: Iterable[CanFrame]) -> None:
        """Decode frames, in the order in which they were received."""
        if not self._codecs:
            return
        for frame in frames:
            key = FrameKey(frame.can_id, frame.is_extended, frame.bus)
            codec = self._codecs.get(key)
            if codec is None or frame.is_error:
                continue
            try:
                values = codec.decode(frame.data)
            except SignalError:  # too short
                continue
            for column, place in self._places[key]:
                value = values[column]
                if value is not None and math.isfinite(value):
                    self._taken[place].times_ns.append(frame.stamp_ns)
                    self._taken[place].values.append(float(value))

    def take(self) -> list[Samples]:
        """Return the values since the last call, in the order of the chosen signals."""
        taken, self._taken = self._taken, [Samples([], []) for _ in self._taken]
        return taken
