"""The seam between the program and whatever carries its frames."""

from typing import Protocol, runtime_checkable

from vehicle_iface.bus.error_frames import LinkEvent
from vehicle_iface.bus.survey import Glimpse
from vehicle_iface.frame import CanFrame

MOST_AT_ONCE = 8
"""Frames of one hand-over: a command and what is due behind it."""


class Bus(Protocol):
    """One end of a CAN bus, used from one thread.

    `BusError` from `wait`, `drain` and `send` means that the link is gone: nothing more can be had from this
    object but `close`.
    """

    description: str
    """What this is, for people: 'SocketCAN vcan0', 'embedded bus', …"""

    def wait(self, until_ns: int) -> bool:
        """Sleep until a frame has come (true) or the monotonic clock shows `until_ns` (false)."""
        ...

    def drain(self) -> list[CanFrame]:
        """All frames that have come since the last call, oldest first, without waiting. Never our own."""
        ...

    def has_room(self) -> bool:
        """Whether everything that was handed over earlier has left; what is sent now would wait behind the rest."""
        ...

    def send(self, *frames: CanFrame) -> int:
        """Hand frames to the bus, without waiting, up to the first that it has no room for; how many it has taken.

        The others are lost, not kept. At most `MOST_AT_ONCE` frames.
        """
        ...

    def counters(self) -> dict[str, int]:
        """What happened to frames here, by cause; grows only."""
        ...

    def close(self) -> None:
        """Give the bus back. May be called twice."""
        ...


@runtime_checkable
class Watched(Protocol):
    """A bus whose controller hardware can be asked how it is."""

    def events(self) -> list[LinkEvent]:
        """What the hardware reported since the last call, without waiting."""
        ...


@runtime_checkable
class Surveyed(Protocol):
    """A bus that sees the other nodes' frames, too."""

    def look(self, now_ns: int) -> Glimpse:
        """What has been on the bus since the last call, without waiting."""
        ...
