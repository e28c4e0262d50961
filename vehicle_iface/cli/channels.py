"""`--channel`: the interface of each bus of a profile, or its channel in a log."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from vehicle_iface.cli.option_types import EMBEDDED
from vehicle_iface.errors import ConfigError
from vehicle_iface.opening import Channels
from vehicle_iface.profile import Profile

if TYPE_CHECKING:
    from vehicle_iface.review.log_frames import LogChannels

DEFAULT_CHANNEL = "vcan0"


def find_channels(given: Sequence[str], profile: Profile, *, command: str, interface: str = "socketcan") -> Channels:
    """Return the channel of each bus, in the profile's order.

    `given` contains `CHANNEL` for a single bus, or `NAME=CHANNEL` for each named bus. Raises `ConfigError` with the
    corrected command if a channel is missing, unknown or given twice. The embedded interface needs no channels.
    """
    names = list(profile.all_buses)
    if not given and interface == EMBEDDED:
        return dict.fromkeys(names, interface)
    if names == [""]:
        return {"": _find_single(given, profile, is_socketcan=interface == "socketcan")}
    channels = read_pairs(given, profile, command=command)
    missing = [name for name in names if name not in channels]
    if missing:
        text = f"no channel for {' and '.join(missing)} of profile {profile.name}"
        raise ConfigError(f"--channel: {text}; {_suggest(channels, names, command)}")
    return _require_distinct({name: channels[name] for name in names})


def find_log_channels(given: Sequence[str], profile: Profile, *, command: str) -> "LogChannels":
    """Return the channel in a log for each bus, in the profile's order; by default the bus' own name.

    For a single bus the default is None: the channel that contains its messages.
    """
    names = list(profile.all_buses)
    if names == [""]:
        if len(given) > 1:
            raise ConfigError(f"--channel: profile {profile.name} has one bus, and {len(given)} channels were given")
        return {"": given[0] if given else None}
    pairs = read_pairs(given, profile, command=command)
    if len(names) == 1:
        return {name: pairs.get(name) for name in names}
    return _require_distinct({name: pairs.get(name, name) for name in names})


def read_pairs(given: Sequence[str], profile: Profile, *, command: str) -> dict[str, str]:
    """Map the name of each bus to the channel that was given; a single bus need not be named."""
    names, channels = list(profile.all_buses), dict[str, str]()
    for text in given:
        name, equals, channel = text.rpartition("=")
        if not equals and len(names) == 1:
            name = names[0]
        fault = ""
        if not equals and not name:
            fault = f"profile {profile.name} has the buses {' and '.join(names)}"
        elif name not in names:
            fault = f"profile {profile.name} has no bus {name}"
        elif name in channels:
            fault = f"{name} is on {channels[name]} already"
        elif not channel:
            fault = "the channel's name is missing"
        if fault:
            raise ConfigError(f"--channel {text}: {fault}; {_suggest(channels, names, command)}")
        channels[name] = channel
    return channels


def _find_single(given: Sequence[str], profile: Profile, *, is_socketcan: bool) -> str:
    """Return the channel of a bus without a name."""
    if len(given) > 1:
        text = f"profile {profile.name} has one bus, and {len(given)} channels were given"
        raise ConfigError(f"--channel: {text}; write --channel {given[0].rpartition('=')[2]}")
    channel = given[0] if given else DEFAULT_CHANNEL
    if is_socketcan and "=" in channel:
        text = f"profile {profile.name} has one bus, without a name"
        raise ConfigError(f"--channel {channel}: {text}; write --channel {channel.rpartition('=')[2]}")
    return channel


def _require_distinct(channels: Channels) -> Channels:
    names: dict[str, str] = {}
    for name, channel in channels.items():
        if channel in names:
            raise ConfigError(f"--channel {name}={channel}: is that of {names[channel]}; each bus has its own")
        names[channel] = name
    return channels


def _suggest(channels: Channels, names: Sequence[str], command: str) -> str:
    """Return the command with a channel for each bus."""
    free = _free_channels(channels)
    options = " ".join(f"--channel {name}={channels.get(name) or next(free)}" for name in names)
    return f"write vehicle-iface {command} {options}"


def _free_channels(channels: Channels) -> Iterator[str]:
    return (name for number in range(1000) if (name := f"can{number}") not in channels.values())
