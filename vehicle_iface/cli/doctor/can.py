"""Checks the bus: the kernel's CAN modules, the interface and its queues."""

import json
import platform
import shlex
import shutil
import socket
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from vehicle_iface.arming import VIRTUAL_KINDS
from vehicle_iface.bus.raw_socket import find_socketcan_error
from vehicle_iface.bus.receive import CANFD_MTU
from vehicle_iface.bus.socketcan import RECEIVE_BUFFER_BYTES
from vehicle_iface.cli.doctor.findings import Diagnostic, missing, ok, read_text, warn
from vehicle_iface.profile import Bus

FRAME_BITS = 135
"""Length in bits of a classical data frame of 8 bytes with the most stuff bits, and the gap after it."""
FRAMES_OF_A_PASS = 4
QUEUED_S = 0.01
"""Longest time in s that a command may wait in the queue before it is older than the next one."""


def check_socketcan(channels: Iterable[str]) -> Iterator[Diagnostic]:
    """Check the kernel modules for CAN sockets, virtual interfaces and gateways."""
    error = find_socketcan_error()
    if error:
        if has_module("can_raw"):
            yield missing("SocketCAN", f"not in use by this kernel ({error})", "sudo modprobe can_raw")
        else:
            yield missing("SocketCAN", f"not in this kernel ({error}), run in one that has it", "tools/vcan tools/demo")
        return
    yield ok("SocketCAN", "can and can_raw are loaded")
    absent = [channel for channel in channels if channel.startswith(VIRTUAL_KINDS) and not _has_interface(channel)]
    for kind in sorted({"vxcan" if channel.startswith("vxcan") else "vcan" for channel in absent}):
        if has_module(kind):
            yield ok(kind, "there, for virtual interfaces")
        else:
            yield warn(kind, "no such module: virtual interfaces cannot be created", "tools/vcan tools/demo")
    gateway = "there" if has_module("can_gw") else "not there"
    yield ok("can_gw", f"{gateway}; only a bench with a gateway needs it")


def has_module(name: str) -> bool:
    """Whether a kernel module is loaded, built in, or can be loaded."""
    if Path("/sys/module", name).exists():
        return True
    folder = Path("/lib/modules", platform.release())
    file = f"/{name.replace('_', '-')}.ko"
    lists = (read_text(folder / which).replace("_", "-") for which in ("modules.builtin", "modules.dep"))
    return any(file in text for text in lists)


def check_interface(channel: str, bus: Bus) -> list[Diagnostic]:
    """Check how the interface is set up; return nothing if the kernel has no SocketCAN."""
    if find_socketcan_error():
        return []
    if not _has_interface(channel):
        return [_describe_absent(channel)]
    ip = shutil.which("ip") or shutil.which("ip", path="/usr/sbin:/sbin")
    if ip is None:
        return [warn(channel, "exists; its settings cannot be seen without iproute2", "sudo apt-get install iproute2")]
    shown = subprocess.run(
        [ip, "-details", "-json", "link", "show", "dev", channel], capture_output=True, text=True, check=False
    )
    try:
        link = json.loads(shown.stdout)[0]
    except (ValueError, LookupError):
        return [warn(channel, "exists; this `ip` cannot show its settings", "sudo apt-get install iproute2")]
    return list(check_link(link, bus))


def check_link(link: Mapping[str, Any], bus: Bus) -> Iterator[Diagnostic]:
    """Check what `ip -details -json link show` reports about one interface."""
    name = str(link["ifname"])
    if link.get("link_type") != "can":
        yield missing(name, f"is of type {link.get('link_type')} and carries no CAN", "ip -brief link")
        return
    info = link.get("linkinfo", {})
    kind = str(info.get("info_kind", "unknown kind"))
    if "UP" in link.get("flags", ()):
        yield ok(name, f"{kind}, up")
    else:
        yield missing(name, f"{kind}, down", f"sudo ip link set {_up_arguments(name, kind, bus)}")
    yield _check_mtu(name, kind, int(link.get("mtu", 0)), bus)
    if kind == "can":
        yield from _check_controller(name, info.get("info_data", {}), bus)
    elif kind in VIRTUAL_KINDS:
        yield ok("bit rate", "virtual: none, no restart-ms and no error states")
    else:
        yield warn(
            "bit rate",
            f"not visible on {kind}; the profile has {bus.bitrate} bit/s",
            f"ip -details link show {name}",
        )
    yield _check_queue(name, str(link.get("qdisc", "")), int(link.get("txqlen", 0)), bus)


def _check_mtu(name: str, kind: str, mtu: int, bus: Bus) -> Diagnostic:
    if mtu >= CANFD_MTU:
        return ok("MTU", f"{mtu}, classical and FD frames")
    if not bus.fd:
        return ok("MTU", f"{mtu}, classical frames; the profile has no others")
    how = f"sudo ip link set {name} down && sudo ip link set "
    how += _up_arguments(name, kind, bus) if kind == "can" else f"{name} mtu {CANFD_MTU} up"
    return missing("MTU", f"{mtu}, and the profile's FD frames need {CANFD_MTU}", how)


def _check_controller(name: str, data: Mapping[str, Any], bus: Bus) -> Iterator[Diagnostic]:
    """Check a hardware controller's bit rate, automatic restart and error state."""
    again = f"sudo ip link set {name} down && sudo ip link set {_up_arguments(name, 'can', bus)}"
    bitrate = int(data.get("bittiming", {}).get("bitrate", 0))
    if bitrate == bus.bitrate:
        yield ok("bit rate", f"{bitrate} bit/s, as in the profile")
    else:
        yield missing("bit rate", f"{bitrate or 'not set'}, the profile has {bus.bitrate} bit/s", again)
    restart_ms = int(data.get("restart_ms", 0))
    if restart_ms:
        yield ok("restart-ms", f"{restart_ms}, restarts by itself after bus-off")
    else:
        yield warn("restart-ms", "0: after bus-off the interface stays off until it is restarted", again)
    modes = data.get("ctrlmode", ())
    if "LISTEN-ONLY" in modes:
        yield missing("mode", "listen-only: no command leaves, no frame is acknowledged", f"{again} listen-only off")
    if "LOOPBACK" in modes:
        yield missing("mode", "loopback: nothing leaves the controller", f"{again} loopback off")
    yield _check_errors(name, data)


def _check_errors(name: str, data: Mapping[str, Any]) -> Diagnostic:
    state = str(data.get("state", "unknown"))
    counters = data.get("berr_counter")
    counted = f", errors sending {counters['tx']} receiving {counters['rx']}" if counters else ""
    if state == "ERROR-ACTIVE":
        return ok("errors", f"error-active{counted}")
    if state == "BUS-OFF":
        return missing("errors", f"bus-off{counted}", f"sudo ip link set {name} type can restart")
    if state == "STOPPED":
        return ok("errors", f"stopped{counted}: no error state while it is down")
    why = "no node acknowledges, bit rates differ, or there are no 60 Ω between the wires"
    return warn("errors", f"{state.lower()}{counted}: {why}", f"ip -details -statistics link show {name}")


def _check_queue(name: str, qdisc: str, frames: int, bus: Bus) -> Diagnostic:
    """Check the length of the transmit queue.

    In a long queue, a command arrives late behind other frames; a short queue fills up, which is noticed at once.
    """
    if qdisc == "noqueue":
        return ok("txqueuelen", "no queue: each frame arrives at once")
    waiting_s = frames * FRAME_BITS / bus.bitrate
    queue = f"{frames} frames, {waiting_s * 1e3:.1f} ms at {bus.bitrate} bit/s"
    best = max(FRAMES_OF_A_PASS, min(10, int(QUEUED_S * bus.bitrate / FRAME_BITS)))
    fix = f"sudo ip link set {name} txqueuelen {best}"
    if frames < FRAMES_OF_A_PASS:
        return warn("txqueuelen", f"{queue}: one pass sends up to {FRAMES_OF_A_PASS}", fix)
    if frames > best:
        return warn("txqueuelen", f"{queue}: commands wait behind other programs' frames", fix)
    return ok("txqueuelen", f"{queue}: short, so commands do not wait long")


def check_receive_buffer(granted_bytes: int) -> Iterator[Diagnostic]:
    """Check that the kernel grants the receive buffer that the bus requests."""
    if granted_bytes >= RECEIVE_BUFFER_BYTES:
        yield ok("rmem_max", f"{RECEIVE_BUFFER_BYTES} bytes of receive buffer granted")
    else:
        yield warn(
            "rmem_max",
            f"{granted_bytes} of {RECEIVE_BUFFER_BYTES} bytes of receive buffer: a flood drops frames sooner",
            f"sudo sysctl -w net.core.rmem_max={RECEIVE_BUFFER_BYTES}",
        )


def _has_interface(channel: str) -> bool:
    try:
        socket.if_nametoindex(channel)
    except OSError:
        return False
    return True


def _describe_absent(channel: str) -> Diagnostic:
    name = shlex.quote(channel)
    if channel.startswith("vcan"):
        fix = f"sudo modprobe vcan && sudo ip link add dev {name} type vcan && sudo ip link set {name} up"
        return missing(channel, "no such interface", fix)
    return missing(channel, "no such interface; the adapter may be unplugged", "ip -brief link show type can")


def _up_arguments(name: str, kind: str, bus: Bus) -> str:
    """Return the arguments of `ip link set` that bring the interface up as the profile states."""
    if kind != "can":
        return f"{name} up"
    fd = f" dbitrate {bus.data_bitrate or bus.bitrate} fd on" if bus.fd else ""
    return f"{name} up type can bitrate {bus.bitrate} restart-ms 100{fd}"


def granted_bytes() -> int:
    """Return the size in bytes of the receive buffer that a socket is granted. It asks a socket, since some systems
    lack the file with the limit."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asked:
        asked.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        return asked.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2  # Linux doubles it for its own use
