"""The loop's link to the bus: it detects a loss, reports it once, and reopens the bus."""

import logging
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from vehicle_iface.bus.base import Bus, SupportsErrorEvents, SupportsTraffic, prefix_bus
from vehicle_iface.bus.controller_events import ControllerEvent
from vehicle_iface.bus.link_state import TABLE, LinkEvent, LinkState
from vehicle_iface.bus.several import buses_by_name, name_refusing
from vehicle_iface.errors import BusError, BusGoneError
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.bus_load import BusLoads
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.timer import PeriodicTimer
from vehicle_iface.units import NS_PER_MS

log = logging.getLogger(__name__)

REOPEN_NS = 100 * NS_PER_MS
"""Period of the attempts to reopen a lost link."""
REFUSED_NS = 100 * NS_PER_MS
"""A bus that has rejected every frame for this long is lost."""
STALLED_AFTER = 3
"""After this many rejected commands in a row the vehicle is stopped, until the link is clean again."""
WATCH_NS = 50 * NS_PER_MS
"""Period of polling the CAN controller."""
SURVEY_NS = 500 * NS_PER_MS
"""Period of polling the bus load."""
CLEAN_NS = 500 * NS_PER_MS
"""A link that has received frames without errors for this long counts as UP again."""
MAX_TRANSITIONS = 1000

_ERROR_STATES = (ControllerEvent.WARNING, ControllerEvent.PASSIVE)
"""These last until the CAN controller reports one of `_RECOVERED`."""
_RECOVERED = (ControllerEvent.ACTIVE, ControllerEvent.RESTARTED)
_NO_ERRORS = (ControllerEvent.ARBITRATION_LOST,)
"""Not an error on a bus with more than one node."""


class LinkTransition(NamedTuple):
    """One change of the link: time, new state and reason."""

    at_ns: int
    state: LinkState
    why: str


class _Part(NamedTuple):
    """One of the open buses. Whether it supports a protocol is found once: each time would take 10 µs."""

    name: str
    description: str
    controller: SupportsErrorEvents | None
    monitor: SupportsTraffic | None


class Link:
    """Receives and sends while the bus is open. `take_loss` reports each loss once, wherever it was detected."""

    def __init__(
        self,
        open_bus: Callable[[], Bus],
        counters: Counters,
        *,
        now_ns: Callable[[], int],
        sleep_until: Callable[[int], None],
    ) -> None:
        """Open the bus. Raises `BusError` when that fails."""
        self._open_bus = open_bus
        self._bus: Bus | None
        self._parts: tuple[_Part, ...]
        bus = open_bus()
        self._use(bus)
        self.description = bus.description
        self._counters = counters
        self._now_ns, self._sleep_until = now_ns, sleep_until
        self._reopen_timer = PeriodicTimer(REOPEN_NS, now_ns())
        self._watch_timer = PeriodicTimer(WATCH_NS, now_ns())
        self._survey_timer = PeriodicTimer(SURVEY_NS, now_ns())
        self._refused_since_ns: int | None = None
        self._refused_in_row = 0
        self._troubled_ns = 0
        self._with_errors: set[str] = set()
        """The buses whose controllers report so."""
        self._overflow: dict[str, int] = {}
        self._received_since_open = False
        self._was_lost = False
        self._draining: Bus | None = None
        """A bus that accepted no frames any more; it is used again once its transmit queue is empty."""
        self._closed_counters: dict[str, int] = {}
        self.state = LinkState.UP
        self.why = ""
        """Why the state is as it is."""
        self.is_stalled = False
        """Several commands in a row were rejected: the next one must be a stop."""
        self.transitions: list[LinkTransition] = []
        """The first state changes of the run, at most `MAX_TRANSITIONS`."""
        self.events: Counter[str] = Counter()
        """Events that the CAN controllers reported, by kind."""
        self._bus_names = tuple(buses_by_name(bus))
        self.load = BusLoads(self._bus_names)

    def take_loss(self) -> bool:
        """Whether the bus was lost since the last call."""
        was_lost, self._was_lost = self._was_lost, False
        return was_lost

    def receive(self, until_ns: int) -> list[CanFrame]:
        """Wait for frames until `until_ns` at most, and return all that have arrived."""
        if self._bus is None:
            self._sleep_until(until_ns)
            self._reopen()
            return []
        try:
            self._bus.wait(until_ns)
            frames = self._bus.drain()
        except BusError as error:
            self._drop(error)
            return []
        self._received_since_open = self._received_since_open or bool(frames)
        return frames

    def has_room(self) -> bool:
        """Return whether the transmit queue accepts a command now; false is counted as a rejected command."""
        if self._bus is None:
            return False
        try:
            has_room = self._bus.has_room()
        except BusError as error:
            self._drop(error)
            return False
        if not has_room:
            self._counters.commands_refused += 1
            self._note_refusal()
        return has_room

    def send(self, *frames: CanFrame) -> int:
        """Send each frame at most once; return how many the bus accepted, counted from the first."""
        if self._bus is None:
            return 0
        try:
            sent = self._bus.send(*frames)
        except BusError as error:
            self._drop(error)
            return 0
        self._counters.frames_sent += sent
        self._counters.frames_not_sent += len(frames) - sent
        if sent == len(frames):
            self._refused_since_ns, self._refused_in_row = None, 0
        else:
            self._note_refusal()
        return sent

    def watch(self, now_ns: int) -> None:
        """Poll the link: a bus that accepts nothing, or whose CAN controller is bus off, is lost."""
        if self._refused_since_ns is not None and now_ns - self._refused_since_ns > REFUSED_NS:
            self._draining = self._bus
            self._use(None)
            text = f"{self.description}: accepts no frames; is another node on the bus?"
            self._on_drop(BusError(prefix_bus(name_refusing(self._draining), text)))
        if not self._watch_timer.is_due(now_ns):
            return
        self._poll_controller()
        self._poll_traffic(now_ns)
        self._check_overflow()
        if now_ns - self._troubled_ns >= CLEAN_NS and self._received_since_open and not self._with_errors:
            self.is_stalled = False
            self._apply(LinkEvent.CLEAN, "no errors for 0.5 s")

    def counters(self) -> dict[str, int]:
        """The bus' own counters, summed over every time that it was open."""
        bus = self._bus or self._draining
        now = bus.counters() if bus is not None else {}
        names = self._closed_counters.keys() | now.keys()
        return {name: self._closed_counters.get(name, 0) + now.get(name, 0) for name in sorted(names)}

    def close(self) -> None:
        """Close the bus."""
        bus = self._bus or self._draining
        if bus is not None:
            self._closed_counters = self.counters()
            bus.close()
            self._draining = None
            self._use(None)

    def _use(self, bus: Bus | None) -> None:
        """Work with this bus from now on; None: there is none."""
        self._bus, self._parts = bus, () if bus is None else _find_parts(bus)

    def _poll_controller(self) -> None:
        for name, description, controller, _ in self._parts:
            if controller is None:
                continue
            try:
                events = controller.events()
            except BusError as error:
                self._drop(error)
                return
            for event in events:
                self._note_event(event, name, description)
            if ControllerEvent.BUS_OFF in events:
                text = f"{description}: bus off; `sudo ip link set DEVICE type can restart` restarts it"
                self._drop(BusError(prefix_bus(name, text)))
                return

    def _note_event(self, event: ControllerEvent, name: str, description: str) -> None:
        kind = prefix_bus(name, event.value)
        if not self.events[kind]:
            log.warning("%s: %s (further ones are counted)", description, kind)
        self.events[kind] += 1
        if event in _RECOVERED:
            self._with_errors.discard(name)
        elif event is not ControllerEvent.BUS_OFF and event not in _NO_ERRORS:
            if event in _ERROR_STATES:
                self._with_errors.add(name)
            self._degrade(kind)

    def _poll_traffic(self, now_ns: int) -> None:
        if not self._survey_timer.is_due(now_ns):
            return
        for part in self._parts:
            if part.monitor is None:
                continue
            try:
                self.load.add(part.name, part.monitor.poll_traffic(now_ns))
            except BusError as error:
                self._drop(error)
                return

    def _check_overflow(self) -> None:
        """Degrade the link when a kernel's receive queue has dropped frames."""
        counts = self.counters()
        for name in self._bus_names:
            overflow = counts.get(f"receive_overflow {name}".rstrip(), 0)
            if overflow > self._overflow.get(name, 0):
                self._overflow[name] = overflow
                self._degrade(prefix_bus(name, "receive overflow"))

    def _note_refusal(self) -> None:
        if self._refused_since_ns is None:
            self._refused_since_ns = self._now_ns()
        self._refused_in_row += 1
        self.is_stalled = self.is_stalled or self._refused_in_row >= STALLED_AFTER
        self._degrade(prefix_bus(name_refusing(self._bus), "transmit queue full"))

    def _degrade(self, why: str) -> None:
        self._troubled_ns = self._now_ns()
        self._apply(LinkEvent.TROUBLE, why)

    def _apply(self, event: LinkEvent, why: str) -> None:
        """Change the state by the table."""
        state = TABLE.get((self.state, event), self.state)
        if state is self.state:
            return
        self.state, self.why = state, why
        log.log(logging.INFO if state is LinkState.UP else logging.WARNING, "link %s: %s", state.name, why)
        if len(self.transitions) < MAX_TRANSITIONS:
            self.transitions.append(LinkTransition(self._now_ns(), state, why))

    def _drop(self, error: BusError) -> None:
        self.close()
        self._on_drop(error)

    def _on_drop(self, error: BusError) -> None:
        self._refused_since_ns, self._refused_in_row = None, 0
        self.is_stalled = False
        self._with_errors.clear()
        self._apply(_event_of(error), str(error))
        self._counters.link_losses += 1
        self._was_lost = True

    def _reopen(self) -> None:
        if not self._reopen_timer.is_due(self._now_ns()):
            return
        if self._is_draining():
            return
        try:
            bus = self._draining or self._open_bus()
        except BusError as error:
            self._apply(_event_of(error), str(error))
            return
        self._draining = None
        self._use(bus)
        self._received_since_open = False
        self._troubled_ns = self._now_ns()
        self._apply(LinkEvent.OPENED, f"{bus.description} is open again")

    def _is_draining(self) -> bool:
        """Whether frames still wait in the stuck bus. A new socket beside it could not see them."""
        if self._draining is None:
            return False
        try:
            if not self._draining.has_room():
                return True
            self._draining.drain()  # what came meanwhile is old
        except BusError:  # the interface went down, and what waited in it is gone
            self.close()
        return False


def _find_parts(bus: Bus) -> tuple[_Part, ...]:
    return tuple(_describe(name, part.description, part) for name, part in buses_by_name(bus).items())


def _describe(name: str, description: str, part: object) -> _Part:
    controller = part if isinstance(part, SupportsErrorEvents) else None
    return _Part(name, description, controller, part if isinstance(part, SupportsTraffic) else None)


def _event_of(error: BusError) -> LinkEvent:
    return LinkEvent.GONE if isinstance(error, BusGoneError) else LinkEvent.LOST
