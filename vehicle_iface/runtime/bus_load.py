"""The load of each bus, now and over the run."""

from collections.abc import Iterable, Mapping
from typing import TypeVar

import msgspec
from msgspec import UNSET

from vehicle_iface.bus.traffic_monitor import TrafficSample
from vehicle_iface.frame import FrameKey
from vehicle_iface.telemetry.details import LinkChange, LinkDetails, LinkSummary
from vehicle_iface.units import NS_PER_S


class BusLoad:
    """Adds up traffic samples of one bus. Loads are in percent of its bit rate, rates in frames per second."""

    def __init__(self, bus: str = "") -> None:
        """`bus` is the name in front of each identifier; empty where there is only one bus."""
        self._bus = bus
        self._span_ns = self._busy_ns = self._frames = 0
        self._by_id: dict[FrameKey, float] = {}
        self._counted: dict[FrameKey, int] = {}
        self._counted_ns = 0
        self._exact: dict[FrameKey, float] = {}
        self._now: TrafficSample | None = None
        self.highest_load_percent = 0.0

    def add(self, sample: TrafficSample) -> None:
        """Add one measured interval."""
        if sample.span_ns <= 0:
            return
        self._now = sample
        self._span_ns += sample.span_ns
        self._busy_ns += sample.busy_ns
        self._frames += sample.frames
        for can_id, count in sample.frames_by_key.items():
            self._by_id[can_id] = self._by_id.get(can_id, 0.0) + count
        self.highest_load_percent = max(self.highest_load_percent, _percent(sample.busy_ns, sample.span_ns))

    def now(self, state: str, names: Mapping[FrameKey, str], counted: Mapping[FrameKey, int]) -> LinkDetails:
        """Return the newest interval; for known messages, counted frames replace the estimates.

        `state` is the link's; it is returned alone if the traffic cannot be measured. `names` are those of known
        identifiers. `counted` are the frames counted since the start.
        """
        if self._now is None:
            return LinkDetails(state=state)
        since = {can_id: count - self._counted.get(can_id, 0) for can_id, count in counted.items()}
        seconds = (self._span_ns - self._counted_ns) / NS_PER_S
        if seconds > 0.0:
            self._exact = {can_id: count / seconds for can_id, count in since.items()}
            self._counted, self._counted_ns = dict(counted), self._span_ns
        load_percent, frames_per_s, rates_hz = self._rates(self._now, self._exact, names)
        return LinkDetails(state=state, load_percent=load_percent, frames_per_s=frames_per_s, rates_hz=rates_hz)

    def whole(
        self,
        state: str,
        transitions: list[LinkChange],
        names: Mapping[FrameKey, str],
        counted: Mapping[FrameKey, int],
    ) -> LinkSummary:
        """Return the same for the whole run."""
        if self._now is None:
            return LinkSummary(state=state, transitions=transitions)
        exact = {can_id: count * NS_PER_S / self._span_ns for can_id, count in counted.items()}
        run = TrafficSample(self._span_ns, self._frames, self._busy_ns, self._by_id)
        load_percent, frames_per_s, rates_hz = self._rates(run, exact, names)
        return LinkSummary(
            state=state,
            transitions=transitions,
            load_percent=load_percent,
            frames_per_s=frames_per_s,
            rates_hz=rates_hz,
            highest_load_percent=round(self.highest_load_percent, 1),
        )

    def _rates(
        self, stretch: TrafficSample, exact: Mapping[FrameKey, float], names: Mapping[FrameKey, str]
    ) -> tuple[float, float, dict[str, float]]:
        """Return the load in percent, the frames per second, and those of each identifier."""
        seconds = stretch.span_ns / NS_PER_S
        rates = {key: count / seconds for key, count in stretch.frames_by_key.items()} | dict(exact)
        return (
            round(_percent(stretch.busy_ns, stretch.span_ns), 1),
            round(stretch.frames / seconds, 1),
            {self._label(key, names): round(rate, 1) for key, rate in sorted(rates.items()) if rate},
        )

    def _label(self, key: FrameKey, names: Mapping[FrameKey, str]) -> str:
        """Return `0x110 POSE`, of several buses `ins 0x110 POSE`; an unknown message has no name.

        An extended identifier is written as `0x0012D687x`.
        """
        number = f"0x{key.can_id:08X}x" if key.is_extended else f"0x{key.can_id:03X}"
        return " ".join(word for word in (self._bus, number, names.get(key)) if word)


class BusLoads:
    """The load of each bus of a vehicle. For several buses, the greatest load and the sum of their frames."""

    def __init__(self, names: Iterable[str]) -> None:
        """`names` are the buses in their order; "" for a single bus."""
        kept = tuple(names)
        self._loads = {name: BusLoad(name if len(kept) > 1 else "") for name in kept}

    def add(self, name: str, sample: TrafficSample) -> None:
        """Add one measured interval of the bus with that name."""
        self._loads[name].add(sample)

    def now(self, state: str, names: Mapping[FrameKey, str], counted: Mapping[FrameKey, int]) -> LinkDetails:
        """As `BusLoad.now`."""
        found = {
            name: load.now(state, names, _on_bus(number, counted))
            for number, (name, load) in enumerate(self._loads.items())
        }
        return _put_together(LinkDetails(state=state), found)

    def whole(
        self,
        state: str,
        transitions: list[LinkChange],
        names: Mapping[FrameKey, str],
        counted: Mapping[FrameKey, int],
    ) -> LinkSummary:
        """As `BusLoad.whole`."""
        found = {
            name: load.whole(state, transitions, names, _on_bus(number, counted))
            for number, (name, load) in enumerate(self._loads.items())
        }
        together = _put_together(LinkSummary(state=state, transitions=transitions), found)
        if together.load_percent is UNSET:
            return together
        highest = max(load.highest_load_percent for load in self._loads.values())
        return msgspec.structs.replace(together, highest_load_percent=round(highest, 1))


_Details = TypeVar("_Details", bound=LinkDetails)


def _put_together(link: _Details, by_bus: Mapping[str, _Details]) -> _Details:
    """Combine the traffic of all buses into `link`; a single bus is taken as it is."""
    if len(by_bus) == 1:
        return next(iter(by_bus.values()))
    loads = {name: of_bus.load_percent for name, of_bus in by_bus.items()}
    known = {name: load for name, load in loads.items() if load is not UNSET}
    if not known:
        return link
    return msgspec.structs.replace(
        link,
        load_percent=max(known.values()),
        loads_percent=known,
        frames_per_s=round(sum(of_bus.frames_per_s or 0.0 for of_bus in by_bus.values()), 1),
        rates_hz={label: rate for of_bus in by_bus.values() for label, rate in (of_bus.rates_hz or {}).items()},
    )


def _on_bus(number: int, counted: Mapping[FrameKey, int]) -> dict[FrameKey, int]:
    return {key: count for key, count in counted.items() if key.bus == number}


def _percent(busy_ns: int, span_ns: int) -> float:
    return 100.0 * busy_ns / span_ns
