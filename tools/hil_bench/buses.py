"""The interfaces of a vehicle: one, or one for each of its buses."""

import errno
import os
from collections.abc import Collection, Iterator, Sequence
from operator import attrgetter

from vehicle_bus_contract.reference import Frame

from hil_bench.bus import Bus, RxFrame, is_virtual
from hil_bench.profile import ProfileError
from hil_bench.wire import Wire


class Buses:
    """All buses of a vehicle as one: each frame is sent on its bus, and received with the number of its bus.

    What concerns one interface (`channel`, `packets`, `reopen`) is the first bus'.
    """

    def __init__(self, channels: Sequence[str], identifiers: Sequence[Collection[int] | None]) -> None:
        """Raises `OSError` when an interface cannot be used."""
        self._parts: list[Bus] = []
        try:
            for number, (channel, received) in enumerate(zip(channels, identifiers, strict=True)):
                self._parts.append(Bus(channel, received, number))
        except OSError:
            self.close()
            raise
        self.channel = channels[0]

    @property
    def rejected(self) -> int:
        """Frames that the transmit queues had no room for."""
        return sum(part.rejected for part in self._parts)

    def send(self, frame: Frame) -> bool:
        """True if the kernel accepted it. `drain` yields it when it was on the bus."""
        return self._parts[frame.bus].send(frame)

    def drain(self) -> Iterator[RxFrame]:
        """All frames received since the last call, in the order of their stamps."""
        yield from sorted((rx for part in self._parts for rx in part.drain()), key=attrgetter("frame.stamp_ns"))

    def packets(self) -> int:
        """Number of frames that the first interface has sent, of all programs."""
        return self._parts[0].packets()

    def close(self) -> None:
        """May be called twice."""
        for part in self._parts:
            part.close()

    def reopen(self) -> None:
        """Reopen the first by name, after the interface was created again."""
        self._parts[0].reopen()


def open_bus(channels: Sequence[str], wire: Wire, *, everything: bool = False) -> Bus | Buses:
    """The interface of each bus, for the vehicle's frames or for all. Raises `OSError` when one cannot be used."""
    identifiers = [None if everything else wire.ids_on(number) for number in range(len(channels))]
    return Bus(channels[0], identifiers[0]) if len(channels) == 1 else Buses(channels, identifiers)


def read_channels(given: Sequence[str], wire: Wire) -> tuple[str, ...]:
    """The interface of each bus, in the profile's order: `can0`, or `NAME=can0` for each of several.

    Raises `ProfileError` for other than one for each, and `OSError` for a further virtual one that does not exist.
    """
    names = wire.buses
    if len(names) == 1 and len(given) == 1 and given[0].partition("=")[0] in (given[0], names[0]):
        return (given[0].rpartition("=")[2],)
    found = dict(text.split("=", 1) for text in given if "=" in text)
    channels = tuple(found.get(name, "") for name in names)
    if len(given) != len(names) or not all(channels) or len(set(channels)) < len(channels):
        usage = " ".join(f"--channel {name}=can{number}" for number, name in enumerate(names))
        usage = usage if len(names) > 1 else "--channel can0"
        raise ProfileError(
            f"--channel {' '.join(given)}: the vehicle {wire.name} needs an interface for each bus: {usage}"
        )
    for channel in channels[1:]:
        if is_virtual(channels[0]) and not os.path.exists(f"/sys/class/net/{channel}"):
            make = f"ip link add {channel} type vcan && ip link set {channel} mtu 72 up"
            raise OSError(errno.ENODEV, f"does not exist; make it as root: {make}", channel)
    return channels


def describe_channels(channels: Sequence[str], wire: Wire) -> str:
    """The interfaces, of several buses each with the bus' name."""
    return channels[0] if len(channels) == 1 else ", ".join(map("=".join, zip(wire.buses, channels, strict=True)))


def channel_options(channels: Sequence[str], wire: Wire) -> str:
    """The options of a command line, as `vehicle-iface run` takes them."""
    words = channels if len(channels) == 1 else map("=".join, zip(wire.buses, channels, strict=True))
    return " ".join(f"--channel {word}" for word in words)
