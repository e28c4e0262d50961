"""The bus that `vehicle-iface demo` drives on: a vcan interface for each of the profile's, else embedded."""

import os
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from vehicle_iface.bus.raw_socket import find_socketcan_error
from vehicle_iface.bus.receive import CANFD_MTU
from vehicle_iface.cli.option_types import EMBEDDED
from vehicle_iface.opening import Channels, describe_channels
from vehicle_iface.profile import Profile

_EMBEDDED_BUS = "embedded bus, simulated vehicle inside the loop's process"
_SYS_NET = Path("/sys/class/net")


@dataclass(frozen=True, slots=True, kw_only=True)
class BusChoice:
    """The bus on which the demo drives."""

    interface: str
    channels: Channels
    """The channel of each bus; empty for the embedded bus."""
    why: str
    """Why this bus was chosen; for the embedded bus also how to create a real one."""

    @property
    def options(self) -> list[str]:
        """The options of `run` and `sim` that choose this bus."""
        channels = [f"{name}={channel}" if name else channel for name, channel in self.channels.items()]
        return ["--interface", self.interface, *(word for text in channels for word in ("--channel", text))]


def choose_bus(profile: Profile) -> BusChoice:
    """Choose vcan0, vcan1, … where SocketCAN exists, creating them if allowed; otherwise the embedded bus."""
    if find_socketcan_error():
        return BusChoice(
            interface=EMBEDDED,
            channels={},
            why=f"{_EMBEDDED_BUS} (this kernel has no SocketCAN). For real CAN frames: tools/vcan tools/demo, "
            "or a Linux kernel with the modules can, can_raw and vcan",
        )
    channels = {name: f"vcan{number}" for number, name in enumerate(profile.all_buses)}
    mtus = {channels[name]: CANFD_MTU if bus.fd else 0 for name, bus in profile.all_buses.items()}
    unusable = [channel for channel, mtu in mtus.items() if not _is_usable(channel, mtu) and not _create(channel, mtu)]
    if unusable:
        how = " && ".join(f"sudo ip {line}" for channel in unusable for line in _setup_lines(channel, mtus[channel]))
        return BusChoice(
            interface=EMBEDDED,
            channels={},
            why=f"{_EMBEDDED_BUS} (not usable, and not to be set up from here: {', '.join(unusable)}). "
            f"For real CAN frames: {how}",
        )
    return BusChoice(
        interface="socketcan",
        channels=channels,
        why=f"SocketCAN {describe_channels(channels)}; candump {' '.join(mtus)} shows it",
    )


def _is_usable(channel: str, mtu: int) -> bool:
    """Whether the interface is up and carries frames of this size."""
    return _is_up(channel) and int((_SYS_NET / channel / "mtu").read_text()) >= mtu


def _is_up(channel: str) -> bool:
    try:
        return bool(int((_SYS_NET / channel / "flags").read_text(), 16) & 1)
    except OSError:
        return False


def _create(channel: str, mtu: int) -> bool:
    """Set up the interface if this process may and nothing can be using it; return whether it is usable."""
    if os.geteuid() != 0 or _is_up(channel):
        return False
    for line in _setup_lines(channel, mtu):
        with suppress(FileNotFoundError):
            subprocess.run(["ip", *line.split()], check=False, stderr=subprocess.DEVNULL)
    return _is_usable(channel, mtu)


def _setup_lines(channel: str, mtu: int) -> list[str]:
    """Return the arguments of `ip` that make the interface usable, one string for each command."""
    if not (_SYS_NET / channel).exists():
        lines = [f"link add dev {channel} type vcan"]
    else:
        lines = [f"link set {channel} down"] if mtu else []
    return [*lines, f"link set {channel} mtu {mtu} up" if mtu else f"link set {channel} up"]
