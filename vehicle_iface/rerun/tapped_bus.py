"""A bus that notes what its calls return."""

from collections.abc import Callable, Mapping

from vehicle_iface.bus.base import Bus, SupportsErrorEvents, SupportsTraffic
from vehicle_iface.bus.controller_events import ControllerEvent
from vehicle_iface.bus.several import Described, buses_by_name, name_refusing
from vehicle_iface.bus.traffic_monitor import TrafficSample
from vehicle_iface.errors import BusError, BusGoneError
from vehicle_iface.frame import CanFrame
from vehicle_iface.recorder.inputs import BusFault, PassInputs, SentFrames

LOST = -1
"""What `SentFrames.accepted` is where the call raised."""


def note_fault(notes: PassInputs, call: str, number: int, error: BusError) -> None:
    """Note that a call raised."""
    notes.faults.append(BusFault(call, number, isinstance(error, BusGoneError), str(error)))


class TappedBus:
    """Every call goes to the bus; what it returned, or raised, goes into the notes of the pass."""

    def __init__(self, bus: Bus, notes: Callable[[], PassInputs]) -> None:
        self._bus, self._notes = bus, notes
        self.description = bus.description
        self.parts: Mapping[str, Described] = {
            name: _tap_part(name, part, notes) for name, part in buses_by_name(bus).items()
        }
        self._overflow: dict[str, int] = {}

    @property
    def refusing(self) -> str:
        """The bus that most recently had no room."""
        return name_refusing(self._bus)

    def wait(self, until_ns: int) -> bool:
        try:
            return self._bus.wait(until_ns)
        except BusError as error:
            notes = self._notes()
            note_fault(notes, "wait", len(notes.received), error)
            raise

    def drain(self) -> list[CanFrame]:
        notes = self._notes()
        try:
            frames = self._bus.drain()
        except BusError as error:
            note_fault(notes, "drain", len(notes.received), error)
            raise
        notes.received.append(frames)
        return frames

    def has_room(self) -> bool:
        notes = self._notes()
        try:
            has_room = self._bus.has_room()
        except BusError as error:
            note_fault(notes, "has_room", len(notes.has_room), error)
            raise
        notes.has_room.append(has_room)
        return has_room

    def send(self, *frames: CanFrame) -> int:
        notes = self._notes()
        try:
            accepted = self._bus.send(*frames)
        except BusError as error:
            note_fault(notes, "send", len(notes.sent), error)
            notes.sent.append(SentFrames(frames, LOST))
            raise
        notes.sent.append(SentFrames(frames, accepted))
        return accepted

    def counters(self) -> dict[str, int]:
        counts = self._bus.counters()
        overflow = {name: count for name, count in counts.items() if count and name.startswith("receive_overflow")}
        if overflow != self._overflow:
            self._overflow = self._notes().overflow = overflow
        return counts

    def close(self) -> None:
        self._bus.close()


class _Part:
    """One of the buses, of which only the name is of interest."""

    def __init__(self, name: str, bus: Described, notes: Callable[[], PassInputs]) -> None:
        self._name, self._notes = name, notes
        self.description = bus.description


class _WatchedPart(_Part):
    """One of the buses, with its controller's events and its traffic; the traffic decides nothing and is not noted."""

    def __init__(
        self,
        name: str,
        bus: Described,
        controller: SupportsErrorEvents,
        traffic: SupportsTraffic,
        notes: Callable[[], PassInputs],
    ) -> None:
        super().__init__(name, bus, notes)
        self._bus, self._traffic = controller, traffic

    def events(self) -> list[ControllerEvent]:
        notes = self._notes()
        try:
            events = self._bus.events()
        except BusError as error:
            note_fault(notes, f"events {self._name}", 0, error)
            raise
        if events:
            notes.events.append((self._name, [event.value for event in events]))
        return events

    def poll_traffic(self, now_ns: int) -> TrafficSample:
        try:
            return self._traffic.poll_traffic(now_ns)
        except BusError as error:
            note_fault(self._notes(), f"poll_traffic {self._name}", 0, error)
            raise


def _tap_part(name: str, bus: Described, notes: Callable[[], PassInputs]) -> _Part:
    part: object = bus
    if isinstance(part, SupportsErrorEvents) and isinstance(part, SupportsTraffic):
        return _WatchedPart(name, bus, part, part, notes)
    return _Part(name, bus, notes)
