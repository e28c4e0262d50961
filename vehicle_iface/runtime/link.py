"""The loop's hold on the bus: it may be lost and come back, and the loop goes on."""

import logging
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from vehicle_iface.bus.base import Bus, Surveyed, Watched
from vehicle_iface.bus.error_frames import LinkEvent
from vehicle_iface.bus.link_state import TABLE, LinkSign, LinkState
from vehicle_iface.errors import BusError, BusGoneError
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.runtime.rate import Grid
from vehicle_iface.runtime.traffic import Traffic
from vehicle_iface.units import NS_PER_MS

log = logging.getLogger(__name__)

REOPEN_NS = 100 * NS_PER_MS
"""How often a lost link is tried again."""
REFUSED_NS = 100 * NS_PER_MS
"""A bus that has refused everything for so long carries nothing any more."""
STALLED_AFTER = 3
"""Commands refused in a row: from then on the vehicle is stopped, until the link is clean again."""
WATCH_NS = 50 * NS_PER_MS
"""How often the controller hardware is asked how it is."""
SURVEY_NS = 500 * NS_PER_MS
"""How often all traffic is looked at."""
CLEAN_NS = 500 * NS_PER_MS
"""Without trouble for so long, while frames come, a link is as good as new."""
MAX_CHANGES = 1000

_ILL = (LinkEvent.WARNING, LinkEvent.PASSIVE)
"""These last until the controller says that it is well."""
_WELL = (LinkEvent.ACTIVE, LinkEvent.RESTARTED)
_USUAL = (LinkEvent.ARBITRATION_LOST,)
"""No trouble on a bus with more than one node."""


class Change(NamedTuple):
    """When the link changed, to what, and why."""

    at_ns: int
    state: LinkState
    why: str


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
        self._survey_grid = Grid(SURVEY_NS, now_ns())
        self._refused_since_ns: int | None = None
        self._refused_in_row = 0
        self._troubled_ns = 0
        self._is_ill = False
        self._overflow = 0
        self._has_heard = False
        self._stuck: Bus | None = None
        """A bus that took nothing any more; it is used again when what waits in it has left."""
        self._closed_counters: dict[str, int] = {}
        self.state = LinkState.UP
        self.is_stalled = False
        """Commands are not taken one after another: whatever leaves next has to be a stop."""
        self.changes: list[Change] = []
        """Of the state, the first ones of the run."""
        self.events: Counter[str] = Counter()
        """What the controller hardware reported, by kind."""
        self.traffic = Traffic()

    def hear(self, until_ns: int) -> list[CanFrame]:
        """What has come, after waiting for it until `until_ns` at most."""
        if self._bus is None:
            self._sleep_until(until_ns)
            self._reopen()
            return []
        try:
            self._bus.wait(until_ns)
            frames = self._bus.drain()
        except BusError as error:
            self._lose(error)
            return []
        self._has_heard = self._has_heard or bool(frames)
        return frames

    def has_room(self) -> bool:
        """Whether a command that is sent now leaves now; false is counted as a command refused."""
        if self._bus is None:
            return False
        try:
            has_room = self._bus.has_room()
        except BusError as error:
            self._lose(error)
            return False
        if not has_room:
            self._counts.commands_refused += 1
            self._refused()
        return has_room

    def send(self, *frames: CanFrame) -> int:
        """Hand frames over, each at most once; how many the bus took, counted from the first."""
        if self._bus is None:
            return 0
        try:
            sent = self._bus.send(*frames)
        except BusError as error:
            self._lose(error)
            return 0
        self._counts.frames_sent += sent
        self._counts.frames_not_sent += len(frames) - sent
        if sent == len(frames):
            self._refused_since_ns, self._refused_in_row = None, 0
        else:
            self._refused()
        return sent

    def watch(self, now_ns: int) -> None:
        """Ask how the link is: a bus that takes nothing, or whose controller took itself off, is lost."""
        if self._refused_since_ns is not None and now_ns - self._refused_since_ns > REFUSED_NS:
            self._stuck, self._bus = self._bus, None
            self._lost(BusError(f"{self.description}: takes no frames; is anybody else on the bus?"))
        if not self._watch_grid.due(now_ns):
            return
        self._look_at_hardware()
        self._look_at_traffic(now_ns)
        self._look_for_overflow()
        if now_ns - self._troubled_ns >= CLEAN_NS and self._has_heard and not self._is_ill:
            self.is_stalled = False
            self._sign(LinkSign.CLEAN, "no trouble for a while")

    def counters(self) -> dict[str, int]:
        """The bus' own counters, over all times that it was open."""
        bus = self._bus or self._stuck
        now = bus.counters() if bus is not None else {}
        names = self._closed_counters.keys() | now.keys()
        return {name: self._closed_counters.get(name, 0) + now.get(name, 0) for name in sorted(names)}

    def close(self) -> None:
        """Give the bus back."""
        bus = self._bus or self._stuck
        if bus is not None:
            self._closed_counters = self.counters()
            bus.close()
            self._bus = self._stuck = None

    def _look_at_hardware(self) -> None:
        bus: object = self._bus
        if not isinstance(bus, Watched):
            return
        try:
            events = bus.events()
        except BusError as error:
            self._lose(error)
            return
        for event in events:
            self._hear_of(event)
        if LinkEvent.BUS_OFF in events:
            self._lose(
                BusError(f"{self.description}: bus off; `ip link set DEVICE type can restart-ms 100` restarts it")
            )

    def _hear_of(self, event: LinkEvent) -> None:
        if not self.events[event.value]:
            log.warning("%s: %s (further ones are counted)", self.description, event.value)
        self.events[event.value] += 1
        if event in _WELL:
            self._is_ill = False
        elif event is not LinkEvent.BUS_OFF and event not in _USUAL:
            self._is_ill = self._is_ill or event in _ILL
            self._trouble(event.value)

    def _look_at_traffic(self, now_ns: int) -> None:
        bus: object = self._bus
        if not self._survey_grid.due(now_ns) or not isinstance(bus, Surveyed):
            return
        try:
            self.traffic.add(bus.look(now_ns))
        except BusError as error:
            self._lose(error)

    def _look_for_overflow(self) -> None:
        """Frames that the kernel had no room for are lost to us, not to the bus."""
        overflow = self.counters().get("receive_overflow", 0)
        if overflow > self._overflow:
            self._overflow = overflow
            self._trouble("receive overflow")

    def _refused(self) -> None:
        if self._refused_since_ns is None:
            self._refused_since_ns = self._now_ns()
        self._refused_in_row += 1
        self.is_stalled = self.is_stalled or self._refused_in_row >= STALLED_AFTER
        self._trouble("transmit queue full")

    def _trouble(self, why: str) -> None:
        self._troubled_ns = self._now_ns()
        self._sign(LinkSign.TROUBLE, why)

    def _sign(self, sign: LinkSign, why: str) -> None:
        """Move by the table."""
        state = TABLE.get((self.state, sign), self.state)
        if state is self.state:
            return
        self.state = state
        log.log(logging.INFO if state is LinkState.UP else logging.WARNING, "link %s: %s", state.name, why)
        if len(self.changes) < MAX_CHANGES:
            self.changes.append(Change(self._now_ns(), state, why))

    def _lose(self, error: BusError) -> None:
        self.close()
        self._lost(error)

    def _lost(self, error: BusError) -> None:
        self._refused_since_ns, self._refused_in_row = None, 0
        self.is_stalled = self._is_ill = False
        self._sign(_sign_of(error), str(error))
        self._counts.link_losses += 1
        self._on_lost()

    def _reopen(self) -> None:
        if not self._reopen_grid.due(self._now_ns()):
            return
        if self._is_stuck():
            return
        try:
            self._bus, self._stuck = self._stuck or self._open_bus(), None
        except BusError as error:
            self._sign(_sign_of(error), str(error))
            return
        self._has_heard = False
        self._troubled_ns = self._now_ns()
        self._sign(LinkSign.OPENED, f"{self._bus.description} is open again")

    def _is_stuck(self) -> bool:
        """Whether frames still wait in a bus that took nothing any more; a new one beside it could not see them."""
        if self._stuck is None:
            return False
        try:
            if not self._stuck.has_room():
                return True
            self._stuck.drain()  # what came meanwhile is old
        except BusError:  # the interface went down, and what waited in it is gone
            self.close()
        return False


def _sign_of(error: BusError) -> LinkSign:
    return LinkSign.GONE if isinstance(error, BusGoneError) else LinkSign.LOST
