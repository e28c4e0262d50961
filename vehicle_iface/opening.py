"""Opening the bus of a profile, or its buses, filtered to the profile's messages."""

from collections.abc import Iterable, Mapping
from contextlib import ExitStack

from vehicle_iface.bus.base import Bus, add_bus_name
from vehicle_iface.bus.several import SeveralBuses
from vehicle_iface.bus.socketcan import SocketCanBus
from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.errors import BusError, ConfigError
from vehicle_iface.frame import IdFilter
from vehicle_iface.profile import Profile
from vehicle_iface.profile.schema import NamedBus

Channels = Mapping[str, str]
"""By the name of each bus, in the profile's order, what the interface calls it; by "" that of the only one."""


def open_buses(
    interface: str,
    channels: Channels,
    profile: Profile,
    *,
    received: Iterable[BoundMessage],
    sent: Iterable[BoundMessage] = (),
    receive_timeout_ns: int | None = None,
) -> Bus:
    """The bus of a profile, filtered to `received`; of several all or none, as one.

    `BusError` with the command that fixes it when one cannot be used. `sent` are confirmed where the bus can tell;
    `receive_timeout_ns` is for an event-driven reader of one bus (see `SocketCanBus`).
    """
    received, sent = tuple(received), tuple(sent)
    if len(channels) == 1:
        (channel,) = channels.values()
        (bus,) = profile.all_buses.values()
        if interface != "socketcan":
            return _open_with_python_can(interface, channel, bus, received)
        return _open_socketcan(channel, bus, received, sent, receive_timeout_ns=receive_timeout_ns)
    require_socketcan(interface, profile)
    parts: dict[str, SocketCanBus] = {}
    with ExitStack() as unless_all_open:
        for number, (name, bus) in enumerate(profile.all_buses.items()):
            mine = [message for message in received if message.bus == number]
            own = [message for message in sent if message.bus == number]
            try:
                parts[name] = _open_socketcan(channels[name], bus, mine, own, name=name, number=number)
            except BusError as error:
                raise add_bus_name(name, error) from error
            unless_all_open.callback(parts[name].close)
        unless_all_open.pop_all()
    return SeveralBuses(parts, f"SocketCAN {describe_channels(channels)}")


def require_socketcan(interface: str, profile: Profile) -> None:
    """Only SocketCAN can wait for several buses at once; `ConfigError` for another interface."""
    if interface != "socketcan" and len(profile.all_buses) > 1:
        names = " and ".join(profile.all_buses)
        raise ConfigError(
            f"--interface {interface}: profile {profile.name} has the buses {names}, and several need socketcan"
        )


def describe_channels(channels: Channels) -> str:
    """For a person: `can0`, or `vehicle=can0, ins=can1`."""
    return ", ".join(f"{name}={channel}" if name else channel for name, channel in channels.items())


def _open_socketcan(
    channel: str,
    bus: NamedBus,
    received: Iterable[BoundMessage],
    sent: Iterable[BoundMessage],
    *,
    receive_timeout_ns: int | None = None,
    name: str = "",
    number: int = 0,
) -> SocketCanBus:
    can_ids, masked = _filters(received)
    return SocketCanBus(
        channel,
        can_ids,
        own_ids=[message.can_id for message in sent],
        masked=masked,
        bitrate=bus.bitrate,
        data_bitrate=bus.data_bitrate or bus.bitrate,
        receive_timeout_ns=receive_timeout_ns,
        name=name,
        number=number,
    )


def _open_with_python_can(interface: str, channel: str, bus: NamedBus, received: Iterable[BoundMessage]) -> Bus:
    from vehicle_iface.bus.python_can import PythonCanBus  # 0.2 s to import, and SocketCAN does not need it

    can_ids, masked = _filters(received)
    return PythonCanBus(interface, channel, can_ids, masked=masked, bitrate=bus.bitrate, is_fd=bus.fd)


def _filters(received: Iterable[BoundMessage]) -> tuple[list[int], list[IdFilter]]:
    """Exact identifiers, and those of which only some bits matter."""
    kept = tuple(received)
    can_ids = [message.can_id for message in kept if not message.is_masked]
    return can_ids, [IdFilter(message.can_id, message.id_mask) for message in kept if message.is_masked]
