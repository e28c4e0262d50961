"""Arming on a real bus requires a reviewed profile and --speed-cap."""

import ctypes
import fcntl
import socket
import struct
from pathlib import Path

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile
from vehicle_iface.profile.review_record import find_changes
from vehicle_iface.value import Value

VIRTUAL_KINDS = ("vcan", "vxcan")
VIRTUAL_INTERFACES = ("embedded", "virtual", "udp_multicast")
"""Values of `--interface` that no wire leads out of."""

# From <linux/sockios.h> and <linux/ethtool.h>
SIOCETHTOOL, ETHTOOL_GDRVINFO = 0x8946, 3
_DRIVER_INFO = struct.Struct("=I32s160x")
_REQUEST = struct.Struct("@16sP16x")


def require_reviewed_profile(profile: Profile, *, interface: str, channel: str, speed_cap_mps: float | None) -> Profile:
    """The profile with its maximum speed capped; raises `ConfigError` for a real bus without review or cap."""
    if not is_virtual(interface, channel):
        if not profile.reviewed:
            raise ConfigError(
                f"{channel} is a real bus and {profile.name} is not reviewed: check limits and signs against the "
                "vehicle, then set reviewed = true in the profile"
            )
        if speed_cap_mps is None:
            raise ConfigError(
                f"{channel} is a real bus: limit the speed, for a first run with --speed-cap 1.0 "
                f"(m/s; the profile allows {profile.limits.speed_max_mps})"
            )
    return cap_speed(profile, speed_cap_mps)


def cap_speed(profile: Profile, speed_cap_mps: float | None) -> Profile:
    """The profile with its maximum speed capped; None for no cap."""
    if speed_cap_mps is None or speed_cap_mps >= profile.limits.speed_max_mps:
        return profile
    limits = msgspec.structs.replace(profile.limits, speed_max_mps=speed_cap_mps)
    return msgspec.structs.replace(profile, limits=limits)


class ReviewReport(Value, frozen=True, kw_only=True):
    """What is known about the review of a profile that may command a real bus."""

    text: str
    changes: tuple[str, ...]
    """Files that have changed since."""


def report_review(profile: Profile) -> ReviewReport:
    """The record of a profile's review, and what has changed since; `ConfigError` when a file cannot be read."""
    record = profile.review
    if record is None:
        return ReviewReport(text="reviewed = true, without a record of a walk", changes=())
    changes = tuple(
        find_changes(record, profile=Path(profile.file), dbcs=profile.dbc_files, checksums=profile.checksum_files)
    )
    since = f"; changed since: {' and '.join(changes)}" if changes else ""
    checks = f"{len(record.checks)} checks" if len(record.checks) > 1 else "1 check"
    log = f"{record.log}, SHA-256 {record.log_sha256[:12]}…"
    return ReviewReport(text=f"{record.date.isoformat()}, {checks} ({log}){since}", changes=changes)


def is_virtual(interface: str, channel: str) -> bool:
    """Whether no wire can lead out of this bus; False where that is unknown."""
    if interface != "socketcan":
        return interface in VIRTUAL_INTERFACES
    if Path(f"/sys/class/net/{channel}/device").exists():
        return False
    return _driver_name(channel).startswith(VIRTUAL_KINDS)


def _driver_name(channel: str) -> str:
    """The kernel's name of the interface's driver; the interface's name where an older kernel has none."""
    info = ctypes.create_string_buffer(_DRIVER_INFO.pack(ETHTOOL_GDRVINFO, b""), _DRIVER_INFO.size)
    request = _REQUEST.pack(channel.encode()[:15], ctypes.addressof(info))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        try:
            fcntl.ioctl(any_socket, SIOCETHTOOL, request)
        except OSError:
            return channel
    driver: bytes = _DRIVER_INFO.unpack(info.raw)[1]
    return driver.split(b"\0")[0].decode(errors="replace") or channel
