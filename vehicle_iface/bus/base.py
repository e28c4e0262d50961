"""The interface between the program and a CAN bus."""

from typing import Protocol, runtime_checkable

from vehicle_iface.bus.controller_events import ControllerEvent
from vehicle_iface.bus.traffic_monitor import TrafficSample
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame

MOST_AT_ONCE = 8
"""Frames of one call of `send`: a command, and other messages that are due."""


class Bus(Protocol):
    """One end of a CAN bus, used from one thread.

    `BusError` from `wait`, `drain` and `send` means that the link is gone: after it only `close` may be called.
    """

    description: str
    """For logs and messages: 'SocketCAN vcan0', 'embedded bus', …"""

    def wait(self, until_ns: int) -> bool:
        """Sleep until a frame is received (true) or the monotonic clock reaches `until_ns` (false)."""
        ...

    def drain(self) -> list[CanFrame]:
        """Return all frames received since the last call, oldest first, without waiting. Never our own."""
        ...

    def has_room(self) -> bool:
        """Whether all earlier frames are sent; otherwise a new one would wait behind them."""
        ...

    def send(self, *frames: CanFrame) -> int:
        """Send frames, without waiting, up to the first that the bus has no room for; return how many it has taken.

        The others are lost, not kept. At most `MOST_AT_ONCE` frames.
        """
        ...

    def counters(self) -> dict[str, int]:
        """Frames received, sent and lost, by cause; the counts only grow."""
        ...

    def close(self) -> None:
        """Close the bus. May be called twice."""
        ...


def tell_bus(name: str, text: str) -> str:
    """`text` about one of several buses; "" is the name of the only one."""
    return f"bus {name}: {text}" if name else text


def name_error(name: str, error: BusError) -> BusError:
    """The same error, about the bus of that name."""
    return type(error)(tell_bus(name, str(error))) if name else error


@runtime_checkable
class SupportsErrorEvents(Protocol):
    """A bus that reports events of its controller hardware."""

    def events(self) -> list[ControllerEvent]:
        """Return what the hardware has reported since the last call, without waiting."""
        ...


@runtime_checkable
class SupportsTraffic(Protocol):
    """A bus that receives the other nodes' frames, too."""

    def poll_traffic(self, now_ns: int) -> TrafficSample:
        """Return the traffic of all nodes since the last call, without waiting."""
        ...
