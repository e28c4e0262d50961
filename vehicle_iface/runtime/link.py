"""The loop's hold on the bus: it may be lost and come back, and the loop goes on."""

import logging
from collections import Counter
from collections.abc import Callable

from vehicle_iface.bus.base import Bus, Watched
from vehicle_iface.bus.error_frames import LinkEvent
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.runtime.rate import Grid
from vehicle_iface.units import NS_PER_MS

log = logging.getLogger(__name__)

REOPEN_NS = 100 * NS_PER_MS
"""How often a lost link is tried again."""
REFUSED_NS = 100 * NS_PER_MS
"""A bus that has refused every frame for so long carries nothing any more."""
WATCH_NS = 50 * NS_PER_MS
"""How often the controller hardware is asked how it is."""


class Link:
    """Hears and sends while there is a bus; `on_lost` is called once for each loss."""

    def __init__(
        self,
        open_bus: Callable[[], Bus],
        counts: Counts,
        *,
        now_ns: Callable[[], int],
        sleep_until: Callable[[int], None],
        on_lost: Callable[[], None],
    ) -> None:
        """Opens the bus; `BusError` when that is not possible now."""
        self._open_bus = open_bus
        self._bus: Bus | None = open_bus()
        self.description = self._bus.description
        self._counts = counts
        self._now_ns, self._sleep_until = now_ns, sleep_until
        self._on_lost = on_lost
        self._reopen_grid = Grid(REOPEN_NS, now_ns())
        self._watch_grid = Grid(WATCH_NS, now_ns())
        self._refused_since_ns: int | None = None
        self.events: Counter[str] = Counter()
        """What the controller hardware reported, by kind."""
        self._closed_counters: dict[str, int] = {}

    def hear(self, until_ns: int) -> list[CanFrame]:
        """What has come, after waiting for it until `until_ns` at most."""
        if self._bus is None:
            self._sleep_until(until_ns)
            self._reopen()
            return []
        try:
            self._bus.wait(until_ns)
            return self._bus.drain()
        except BusError as error:
            self._lose(error)
            return []

    def send(self, frame: CanFrame) -> bool:
        """Hand one frame over, at most once; whether the bus took it."""
        if self._bus is None:
            return False
        try:
            sent = self._bus.send(frame)
        except BusError as error:
            self._lose(error)
            return False
        self._counts.frames_sent += sent
        self._counts.frames_not_sent += not sent
        if sent:
            self._refused_since_ns = None
        elif self._refused_since_ns is None:
            self._refused_since_ns = self._now_ns()
        return sent

    def watch(self, now_ns: int) -> None:
        """Ask how the link is: a bus that takes nothing, or whose controller took itself off, is lost."""
        if self._refused_since_ns is not None and now_ns - self._refused_since_ns > REFUSED_NS:
            self._lose(BusError(f"{self.description}: takes no frames; is anybody else on the bus?"))
        bus: object = self._bus
        if not self._watch_grid.due(now_ns) or not isinstance(bus, Watched):
            return
        try:
            events = bus.events()
        except BusError as error:
            self._lose(error)
            return
        for event in events:
            if not self.events[event.value]:
                log.warning("%s: %s (further ones are counted)", self.description, event.value)
            self.events[event.value] += 1
        if LinkEvent.BUS_OFF in events:
            self._lose(
                BusError(f"{self.description}: bus off; `ip link set DEVICE type can restart-ms 100` restarts it")
            )

    def counters(self) -> dict[str, int]:
        """The bus' own counters, over all times that it was open."""
        now = self._bus.counters() if self._bus is not None else {}
        names = self._closed_counters.keys() | now.keys()
        return {name: self._closed_counters.get(name, 0) + now.get(name, 0) for name in sorted(names)}

    def close(self) -> None:
        """Give the bus back."""
        if self._bus is not None:
            self._closed_counters = self.counters()
            self._bus.close()
            self._bus = None

    def _lose(self, error: BusError) -> None:
        self._refused_since_ns = None
        log.error("link lost: %s", error)
        self.close()
        self._counts.link_losses += 1
        self._on_lost()

    def _reopen(self) -> None:
        if not self._reopen_grid.due(self._now_ns()):
            return
        try:
            self._bus = self._open_bus()
        except BusError:
            return  # the loss is counted and told; the next try is 100 ms away
        log.warning("link is back: %s", self._bus.description)
