"""The first time that a vehicle may be commanded by somebody's profile: refused until two things were said."""

import ctypes
import fcntl
import socket
import struct
from pathlib import Path

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile

VIRTUAL_KINDS = ("vcan", "vxcan")
VIRTUAL_INTERFACES = ("embedded", "virtual", "udp_multicast")
"""Of `--interface`: no wire leads out of these."""

# From <linux/sockios.h> and <linux/ethtool.h>
SIOCETHTOOL, ETHTOOL_GDRVINFO = 0x8946, 3
_DRIVER_INFO = struct.Struct("=I32s160x")
_REQUEST = struct.Struct("@16sP16x")


def guarded(profile: Profile, *, interface: str, channel: str, speed_cap_mps: float | None) -> Profile:
    """The profile to be armed with, its greatest speed capped; `ConfigError` for a real bus without review and cap."""
    if not is_virtual(interface, channel):
        if not profile.reviewed:
            raise ConfigError(
                f"{channel} is a real bus and {profile.name} is not reviewed: check limits and signs against the "
                "vehicle, then set reviewed = true in the profile"
            )
        if speed_cap_mps is None:
            raise ConfigError(
                f"{channel} is a real bus: say how fast the vehicle may be driven, for a first run --speed-cap 1.0 "
                f"(m/s; the profile allows {profile.limits.speed_max_mps})"
            )
    if speed_cap_mps is None or speed_cap_mps >= profile.limits.speed_max_mps:
        return profile
    limits = msgspec.structs.replace(profile.limits, speed_max_mps=speed_cap_mps)
    return msgspec.structs.replace(profile, limits=limits)


def is_virtual(interface: str, channel: str) -> bool:
    """Whether no wire can lead out of this bus. What cannot be told is real."""
    if interface != "socketcan":
        return interface in VIRTUAL_INTERFACES
    if Path(f"/sys/class/net/{channel}/device").exists():
        return False
    return _kind_of(channel).startswith(VIRTUAL_KINDS)


def _kind_of(channel: str) -> str:
    """What the kernel calls the interface's driver; its name where an older kernel says nothing of virtual ones."""
    info = ctypes.create_string_buffer(_DRIVER_INFO.pack(ETHTOOL_GDRVINFO, b""), _DRIVER_INFO.size)
    request = _REQUEST.pack(channel.encode()[:15], ctypes.addressof(info))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        try:
            fcntl.ioctl(any_socket, SIOCETHTOOL, request)
        except OSError:
            return channel
    driver: bytes = _DRIVER_INFO.unpack(info.raw)[1]
    return driver.split(b"\0")[0].decode(errors="replace") or channel
