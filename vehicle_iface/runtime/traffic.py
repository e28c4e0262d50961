"""The traffic of the whole bus, now and over the run."""

from collections.abc import Mapping
from typing import Any

from vehicle_iface.bus.survey import Glimpse
from vehicle_iface.units import NS_PER_S

Identifier = tuple[int, bool]
"""Of a frame, and whether it is extended."""


class Traffic:
    """Adds up glimpses of the bus. Loads are in percent of its bit rate, rates in frames per second."""

    def __init__(self) -> None:
        self._span_ns = self._busy_ns = self._frames = 0
        self._by_id: dict[Identifier, float] = {}
        self._counted: dict[Identifier, int] = {}
        self._counted_ns = 0
        self._exact: dict[Identifier, float] = {}
        self._now: Glimpse | None = None
        self.highest_load_percent = 0.0

    def add(self, glimpse: Glimpse) -> None:
        """One more stretch of time."""
        if glimpse.span_ns <= 0:
            return
        self._now = glimpse
        self._span_ns += glimpse.span_ns
        self._busy_ns += glimpse.busy_ns
        self._frames += glimpse.frames
        for can_id, count in glimpse.frames_by_id.items():
            self._by_id[can_id] = self._by_id.get(can_id, 0.0) + count
        self.highest_load_percent = max(self.highest_load_percent, _percent(glimpse.busy_ns, glimpse.span_ns))

    def now(self, names: Mapping[Identifier, str], counted: Mapping[Identifier, int]) -> dict[str, Any]:
        """The newest stretch, with the frames that were counted since the last call in the place of estimates.

        Empty where the bus cannot be surveyed. `names` are those of known identifiers; `counted` grows.
        """
        if self._now is None:
            return {}
        since = {can_id: count - self._counted.get(can_id, 0) for can_id, count in counted.items()}
        seconds = (self._span_ns - self._counted_ns) / NS_PER_S
        if seconds > 0.0:
            self._exact = {can_id: count / seconds for can_id, count in since.items()}
            self._counted, self._counted_ns = dict(counted), self._span_ns
        return _told(self._now, self._exact, names)

    def whole(self, names: Mapping[Identifier, str], counted: Mapping[Identifier, int]) -> dict[str, Any]:
        """The same for the whole run."""
        if self._now is None:
            return {}
        exact = {can_id: count * NS_PER_S / self._span_ns for can_id, count in counted.items()}
        told = _told(Glimpse(self._span_ns, self._frames, self._busy_ns, self._by_id), exact, names)
        return told | {"highest_load_percent": round(self.highest_load_percent, 1)}


def _told(stretch: Glimpse, exact: Mapping[Identifier, float], names: Mapping[Identifier, str]) -> dict[str, Any]:
    seconds = stretch.span_ns / NS_PER_S
    rates = {can_id: count / seconds for can_id, count in stretch.frames_by_id.items()} | dict(exact)
    return {
        "load_percent": round(_percent(stretch.busy_ns, stretch.span_ns), 1),
        "frames_per_s": round(stretch.frames / seconds, 1),
        "rates_hz": {_label(can_id, names): round(rate, 1) for can_id, rate in sorted(rates.items()) if rate},
    }


def _percent(busy_ns: int, span_ns: int) -> float:
    return 100.0 * busy_ns / span_ns


def _label(identifier: Identifier, names: Mapping[Identifier, str]) -> str:
    """`0x110 POSE`; `0x3A0` for a stranger, `0x0012D687x` for an extended one."""
    can_id, is_extended = identifier
    number = f"0x{can_id:08X}x" if is_extended else f"0x{can_id:03X}"
    return f"{number} {names.get(identifier, '')}".rstrip()
