"""The interface between the program and a CAN bus."""

from typing import Protocol, runtime_checkable

from vehicle_iface.bus.controller_events import ControllerEvent
from vehicle_iface.bus.traffic_monitor import TrafficSample
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame

MOST_AT_ONCE = 8
"""Maximum number of frames in one call of `send`: a command, and other messages that are due."""


class Bus(Protocol):
    """One end of a CAN bus, used from one thread.

    `BusError` from `wait`, `drain` and `send` means that the link is gone: after it only `close` may be called.
    """

    description: str
    """Name for logs and messages: 'SocketCAN vcan0', 'embedded bus', …"""

    def wait(self, until_ns: int) -> bool:
        """Sleep until a frame is received (true) or the monotonic clock reaches `until_ns` (false)."""
        ...

    def drain(self) -> list[CanFrame]:
        """Return all frames received since the last call, oldest first, without waiting; own frames are left out."""
        ...

    def has_room(self) -> bool:
        """Return whether all earlier frames are sent; otherwise a new one would wait behind them."""
        ...

    def send(self, *frames: CanFrame) -> int:
        """Send frames without waiting, up to the first that the bus has no room for; return how many it accepted.

        The others are discarded. At most `MOST_AT_ONCE` frames.
        """
        ...

    def counters(self) -> dict[str, int]:
        """Return the frames received, sent and lost, by cause; the counts only grow."""
        ...

    def close(self) -> None:
        """Close the bus. May be called twice."""
        ...


def prefix_bus(name: str, text: str) -> str:
    """Prefix `text` with the name of the bus; "" is the name of the only bus."""
    return f"bus {name}: {text}" if name else text


def add_bus_name(name: str, error: BusError) -> BusError:
    """Return `error` with the name of the bus in its message."""
    return type(error)(prefix_bus(name, str(error))) if name else error


@runtime_checkable
class SupportsErrorEvents(Protocol):
    """A bus that reports events of its controller hardware."""

    def events(self) -> list[ControllerEvent]:
        """Return what the hardware has reported since the last call, without waiting."""
        ...


@runtime_checkable
class SupportsTraffic(Protocol):
    """A bus that can measure the traffic of all nodes."""

    def poll_traffic(self, now_ns: int) -> TrafficSample:
        """Return the traffic of all nodes since the last call, without waiting."""
        ...
