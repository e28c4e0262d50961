"""Several buses of one vehicle as one: received frames are merged by stamp, each frame is sent on its own bus."""

import heapq
import select
from collections.abc import Mapping
from operator import attrgetter
from typing import Protocol, runtime_checkable

from vehicle_iface import clock
from vehicle_iface.bus.base import Bus
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.units import NS_PER_MS

_stamp = attrgetter("stamp_ns")


class PollableBus(Bus, Protocol):
    """A bus that `select.poll` can wait for; its errors name it."""

    def fileno(self) -> int:
        """Return the descriptor to poll: readable when a frame was received, or when the bus is gone."""
        ...


class SeveralBuses:
    """The buses of a profile, in its order; if one is lost, all count as lost.

    `wait` is one poll for all of them, and ends within 1 ms after `until_ns`.
    """

    def __init__(self, parts: Mapping[str, PollableBus], description: str) -> None:
        """`parts` are open buses by name; a frame's bus number is the position in this order."""
        self.parts = dict(parts)
        self.description = description
        self.refusing = ""
        """The bus that most recently had no room."""
        self._names, self._buses = tuple(parts), tuple(parts.values())
        self._error: BusError | None = None
        self._poll = select.poll()
        for bus in self._buses:
            self._poll.register(bus.fileno(), select.POLLIN)

    def wait(self, until_ns: int) -> bool:
        """Sleep until any bus receives a frame, or until `until_ns`."""
        self._raise_error()
        remaining_ns = until_ns - clock.monotonic_ns()
        return bool(self._poll.poll(max(0, -(-remaining_ns // NS_PER_MS))))

    def drain(self) -> list[CanFrame]:
        """Return all queued frames of all buses in the order of their stamps; each bus keeps its own order."""
        self._raise_error()
        queued = [frames for bus in self._buses if (frames := bus.drain())]
        if len(queued) < 2:
            return queued[0] if queued else []
        return list(heapq.merge(*queued, key=_stamp))

    def has_room(self) -> bool:
        """Return whether every bus has sent all earlier frames."""
        self._raise_error()
        for name, bus in self.parts.items():
            if not bus.has_room():
                self.refusing = name
                return False
        return True

    def send(self, *frames: CanFrame) -> int:
        """Send each frame on its own bus, in order; return how many were accepted before the first that was not."""
        self._raise_error()
        sent = 0
        while sent < len(frames):
            number, end = frames[sent].bus, sent + 1
            while end < len(frames) and frames[end].bus == number:
                end += 1
            try:
                sent += self._buses[number].send(*frames[sent:end])
            except BusError as error:
                if not sent:
                    raise
                self._error = error  # what left on another bus has left: tell that first
                break
            if sent < end:
                self.refusing = self._names[number]
                break
        return sent

    def counters(self) -> dict[str, int]:
        """Return the sums over all buses, and the counts of each bus with its name appended to the key."""
        counts = {name: bus.counters() for name, bus in self.parts.items()}
        causes = dict.fromkeys(cause for of_bus in counts.values() for cause in of_bus)
        sums = {cause: sum(of_bus.get(cause, 0) for of_bus in counts.values()) for cause in causes}
        return sums | {f"{cause} {name}": count for name, of_bus in counts.items() for cause, count in of_bus.items()}

    def close(self) -> None:
        """Close all of them."""
        for bus in self._buses:
            bus.close()

    def _raise_error(self) -> None:
        if self._error is not None:
            raise self._error


class Described(Protocol):
    """One bus, as far as its own controller and its traffic are polled."""

    description: str


@runtime_checkable
class SupportsParts(Protocol):
    """A bus that is made of others."""

    @property
    def parts(self) -> Mapping[str, Described]:
        """The buses by name; a single one has the name ""."""
        ...

    @property
    def refusing(self) -> str:
        """The bus that most recently had no room; "" for a single bus."""
        ...


def buses_by_name(bus: Bus) -> Mapping[str, Described]:
    """Return the buses of `bus` by name; a single bus has the name ""."""
    return bus.parts if isinstance(bus, SupportsParts) else {"": bus}


def name_refusing(bus: Bus | None) -> str:
    """Return the name of the bus that had no room last; "" for a single bus."""
    return bus.refusing if isinstance(bus, SupportsParts) else ""
