"""What this machine lacks for driving a vehicle, each finding with the command that mends it.

Reads and tries, and changes nothing. Needs no rights, and says what it could not see.
"""

import importlib.metadata
import json
import os
import platform
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from vehicle_iface.bus.socketcan import RECEIVE_BUFFER_BYTES
from vehicle_iface.first_use import VIRTUAL_KINDS
from vehicle_iface.profile import Bus
from vehicle_iface.runtime import realtime
from vehicle_iface.runtime.telemetry import telemetry_path

TESTED = {
    "python-can": "4.6.1",
    "cantools": "45.1.0",
    "msgspec": "0.22.0",
    "autosar-e2e": "1.0.0",
    "viser": "1.1.1",
}
"""What the tests run with; requirements.txt has the same."""
CANFD_MTU = 72
FRAME_BITS = 135
"""A classical data frame of 8 bytes with all the stuff bits that it may need, and the gap after it."""
FRAMES_OF_A_PASS = 4
QUEUED_S = 0.01
"""A command that waits longer than this is older than the next one."""
TELEMETRY_BYTES = 4 << 20
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies", "pit")
FAST_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock")


class Verdict(StrEnum):
    """How bad it is."""

    OK = "ok"
    WARN = "warn"
    """Works, but not as well as it could, or not as it was tested."""
    MISSING = "missing"
    """Needed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that was looked at."""

    subject: str
    verdict: Verdict
    text: str
    mend: str = ""
    """A command line; empty where there is nothing to mend."""

    def __str__(self) -> str:
        mend = f"; `{self.mend}`" if self.mend else ""
        return f"{self.verdict:<8} {self.subject:<14} {self.text}{mend}"


def examine(channel: str, bus: Bus, *, system: str = sys.platform) -> list[Finding]:
    """Everything, for a vehicle on `bus` behind the interface `channel`."""
    if system != "linux":
        return [*_elsewhere(system), *of_software()]
    return [
        *of_socketcan(channel),
        *of_interface(channel, bus),
        *of_receive_buffer(_granted_bytes()),
        *of_realtime(),
        *of_throttling(_number("/proc/sys/kernel/sched_rt_runtime_us"), _number("/proc/sys/kernel/sched_rt_period_us")),
        *of_governor(_read(path) for path in Path("/sys/devices/system/cpu").glob("cpu*/cpufreq/scaling_governor")),
        *of_clock(
            *(
                _read(f"/sys/devices/system/clocksource/clocksource0/{which}_clocksource").split()
                for which in ("current", "available")
            )
        ),
        *of_memory_files(telemetry_path("default").parent),
        *of_software(),
    ]


def as_text(findings: Iterable[Finding]) -> str:
    """One line for each, and how it stands."""
    lines = [str(finding) for finding in findings]
    missing = sum(line.startswith(Verdict.MISSING) for line in lines)
    warned = sum(line.startswith(Verdict.WARN) for line in lines)
    verdict = f"{missing} needed and missing" if missing else "nothing needed is missing"
    return "\n".join([*lines, f"{verdict}, {warned} to be better" if warned else verdict])


def as_json(findings: Iterable[Finding]) -> str:
    """The same for a program."""
    found = [asdict(finding) for finding in findings]
    return json.dumps(
        {"is_ready": not any(f["verdict"] is Verdict.MISSING for f in found), "findings": found}, indent=2
    )


def is_ready(findings: Iterable[Finding]) -> bool:
    """Whether nothing needed is missing."""
    return all(finding.verdict is not Verdict.MISSING for finding in findings)


# The bus


def of_socketcan(channel: str) -> Iterator[Finding]:
    """The kernel's side: can, can_raw, and what makes virtual interfaces and gateways."""
    error = _refusal()
    if error:
        if has_module("can_raw"):
            yield _missing("SocketCAN", f"not in use by this kernel ({error})", "sudo modprobe can_raw")
        else:
            yield _missing("SocketCAN", f"not in this kernel ({error}); for one that has it", "tools/vcan tools/demo")
        return
    yield _ok("SocketCAN", "can and can_raw are there")
    if channel.startswith(VIRTUAL_KINDS) and not _exists(channel):
        kind = "vxcan" if channel.startswith("vxcan") else "vcan"
        if has_module(kind):
            yield _ok(kind, "there, for virtual interfaces")
        else:
            yield _warn(kind, "no such module: no virtual interface can be made", "tools/vcan tools/demo")
    gateway = "there" if has_module("can_gw") else "not there"
    yield _ok("can_gw", f"{gateway}; only a bench with a gateway needs it")


def has_module(name: str) -> bool:
    """Whether it is loaded, built in, or can be loaded."""
    if Path("/sys/module", name).exists():
        return True
    folder = Path("/lib/modules", platform.release())
    file = f"/{name.replace('_', '-')}.ko"
    lists = (_read(folder / which).replace("_", "-") for which in ("modules.builtin", "modules.dep"))
    return any(file in text for text in lists)


def of_interface(channel: str, bus: Bus) -> list[Finding]:
    """The interface as it is set up now; nothing where the kernel has no SocketCAN, which is said elsewhere."""
    if _refusal():
        return []
    if not _exists(channel):
        return [_absent(channel)]
    ip = shutil.which("ip") or shutil.which("ip", path="/usr/sbin:/sbin")
    if ip is None:
        return [_warn(channel, "exists; its settings cannot be seen without iproute2", "sudo apt-get install iproute2")]
    shown = subprocess.run(
        [ip, "-details", "-json", "link", "show", "dev", channel], capture_output=True, text=True, check=False
    )
    try:
        link = json.loads(shown.stdout)[0]
    except (ValueError, LookupError):
        return [_warn(channel, "exists; this `ip` cannot show its settings", "sudo apt-get install iproute2")]
    return list(of_link(link, bus))


def of_link(link: Mapping[str, Any], bus: Bus) -> Iterator[Finding]:
    """What `ip -details -json link show` says about one interface."""
    name = str(link["ifname"])
    if link.get("link_type") != "can":
        yield _missing(name, f"is of type {link.get('link_type')} and carries no CAN", "ip -brief link")
        return
    info = link.get("linkinfo", {})
    kind = str(info.get("info_kind", "unknown kind"))
    if "UP" in link.get("flags", ()):
        yield _ok(name, f"{kind}, up")
    else:
        yield _missing(name, f"{kind}, down", f"sudo ip link set {_up(name, kind, bus)}")
    yield _of_mtu(name, kind, int(link.get("mtu", 0)), bus)
    if kind == "can":
        yield from _of_controller(name, info.get("info_data", {}), bus)
    elif kind in VIRTUAL_KINDS:
        yield _ok("bit rate", "virtual: none, no restart-ms and no error states")
    else:
        yield _warn(
            "bit rate",
            f"cannot be seen on {kind}; the profile wants {bus.bitrate} bit/s",
            f"ip -details link show {name}",
        )
    yield _of_queue(name, str(link.get("qdisc", "")), int(link.get("txqlen", 0)), bus)


def _of_mtu(name: str, kind: str, mtu: int, bus: Bus) -> Finding:
    if mtu >= CANFD_MTU:
        return _ok("MTU", f"{mtu}, classical and FD frames")
    if not bus.fd:
        return _ok("MTU", f"{mtu}, classical frames; the profile has no others")
    how = f"sudo ip link set {name} down && sudo ip link set "
    how += _up(name, kind, bus) if kind == "can" else f"{name} mtu {CANFD_MTU} up"
    return _missing("MTU", f"{mtu}, and the profile's FD frames need {CANFD_MTU}", how)


def _of_controller(name: str, data: Mapping[str, Any], bus: Bus) -> Iterator[Finding]:
    """A real controller's bit rate, recovery and state of errors."""
    again = f"sudo ip link set {name} down && sudo ip link set {_up(name, 'can', bus)}"
    bitrate = int(data.get("bittiming", {}).get("bitrate", 0))
    if bitrate == bus.bitrate:
        yield _ok("bit rate", f"{bitrate} bit/s, as the profile wants")
    else:
        yield _missing("bit rate", f"{bitrate or 'not set'}, and the profile wants {bus.bitrate} bit/s", again)
    restart_ms = int(data.get("restart_ms", 0))
    if restart_ms:
        yield _ok("restart-ms", f"{restart_ms}, back by itself after bus-off")
    else:
        yield _warn("restart-ms", "0: after bus-off the interface stays off until somebody restarts it", again)
    modes = data.get("ctrlmode", ())
    if "LISTEN-ONLY" in modes:
        yield _missing("mode", "listen-only: no command leaves, no frame is acknowledged", f"{again} listen-only off")
    if "LOOPBACK" in modes:
        yield _missing("mode", "loopback: nothing leaves the controller", f"{again} loopback off")
    yield _of_errors(name, data)


def _of_errors(name: str, data: Mapping[str, Any]) -> Finding:
    state = str(data.get("state", "unknown"))
    counters = data.get("berr_counter")
    counted = f", errors sending {counters['tx']} receiving {counters['rx']}" if counters else ""
    if state == "ERROR-ACTIVE":
        return _ok("errors", f"error-active{counted}")
    if state == "BUS-OFF":
        return _missing("errors", f"bus-off{counted}", f"sudo ip link set {name} type can restart")
    if state == "STOPPED":
        return _ok("errors", f"stopped{counted}: nothing to say while it is down")
    why = "is anybody there to acknowledge, at the same bit rate, with 60 Ω between the wires?"
    return _warn("errors", f"{state.lower()}{counted}: {why}", f"ip -details -statistics link show {name}")


def _of_queue(name: str, qdisc: str, frames: int, bus: Bus) -> Finding:
    """Short is good: a command that waits behind old frames arrives old, and a full queue is noticed at once."""
    if qdisc == "noqueue":
        return _ok("txqueuelen", "no queue: each frame is there at once")
    waiting_s = frames * FRAME_BITS / bus.bitrate
    said = f"{frames} frames, {waiting_s * 1e3:.1f} ms at {bus.bitrate} bit/s"
    best = max(FRAMES_OF_A_PASS, min(10, int(QUEUED_S * bus.bitrate / FRAME_BITS)))
    mend = f"sudo ip link set {name} txqueuelen {best}"
    if frames < FRAMES_OF_A_PASS:
        return _warn("txqueuelen", f"{said}: one pass sends up to {FRAMES_OF_A_PASS}", mend)
    if frames > best:
        return _warn("txqueuelen", f"{said}: commands grow old behind other programs' frames", mend)
    return _ok("txqueuelen", f"{said}: short, so no command grows old there")


def of_receive_buffer(granted_bytes: int) -> Iterator[Finding]:
    """Whether the kernel gives the receive buffer that the bus asks for."""
    if granted_bytes >= RECEIVE_BUFFER_BYTES:
        yield _ok("rmem_max", f"{RECEIVE_BUFFER_BYTES} bytes of receive buffer granted")
    else:
        yield _warn(
            "rmem_max",
            f"{granted_bytes} of {RECEIVE_BUFFER_BYTES} bytes of receive buffer: a flood drops frames sooner",
            f"sudo sysctl -w net.core.rmem_max={RECEIVE_BUFFER_BYTES}",
        )


# The machine


def of_realtime() -> Iterator[Finding]:
    """What a loop would be granted; each is tried."""
    if realtime.may_fifo():
        yield _ok("SCHED_FIFO", f"granted, priority {realtime.FIFO_PRIORITY}")
    else:
        yield _warn(
            "SCHED_FIFO",
            "no right to it: other programs delay the loop, by 10 ms and more; then log in again",
            realtime.MEND_FIFO,
        )
    if realtime.may_lock():
        yield _ok("memory lock", "granted")
    else:
        yield _warn(
            "memory lock",
            "no right to it: a pass can wait for the disk when memory runs short; then log in again",
            realtime.MEND_LOCK,
        )


def of_throttling(runtime_us: int | None, period_us: int | None) -> Iterator[Finding]:
    """How much of each second real-time threads may have."""
    subject, mend = "throttling", "sudo sysctl -w kernel.sched_rt_runtime_us=950000 kernel.sched_rt_period_us=1000000"
    if runtime_us is None or not period_us:
        yield _ok(subject, "this kernel has none to set")
    elif runtime_us < 0:
        yield _warn(subject, "off: a real-time thread that hangs takes the machine with it", mend)
    elif runtime_us < 0.5 * period_us:
        yield _warn(subject, f"real-time threads get {runtime_us} of each {period_us} µs, and then wait", mend)
    else:
        yield _ok(subject, f"real-time threads get {runtime_us / period_us:.0%}, the loop needs a few")


def of_governor(governors: Iterable[str]) -> Iterator[Finding]:
    """Whether processors slow down between two samples."""
    names = sorted({name for governor in governors if (name := governor.strip())})
    if not names:
        yield _ok("CPU frequency", "not to be seen here (fixed, or a virtual machine)")
    elif names == ["performance"]:
        yield _ok("CPU frequency", "governor performance")
    else:
        mend = "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"
        yield _warn("CPU frequency", f"governor {', '.join(names)}: a processor that dozed answers late", mend)


def of_clock(current: list[str], available: list[str]) -> Iterator[Finding]:
    """Whether reading the clock is cheap."""
    name = current[0] if current else ""
    better = next((clock for clock in FAST_CLOCKS if clock in available), None)
    if not name:
        yield _ok("clock source", "not to be seen here")
    elif name not in SLOW_CLOCKS:
        yield _ok("clock source", name)
    elif better is None:
        yield _warn(
            "clock source", f"{name}, each reading takes about 1 µs, and there is no better one", "dmesg | grep -i tsc"
        )
    else:
        mend = f"echo {better} | sudo tee /sys/devices/system/clocksource/clocksource0/current_clocksource"
        yield _warn("clock source", f"{name}: each reading takes about 1 µs", mend)


def of_memory_files(folder: Path) -> Iterator[Finding]:
    """The place of the file through which the viewer sees the loop."""
    subject = "/dev/shm"
    if str(folder) != subject:
        yield _warn(
            subject,
            f"missing or not writable: the viewer's file goes to {folder}, where a disk can hold up the loop",
            f"sudo mkdir -p {subject} && sudo mount -t tmpfs -o mode=1777 tmpfs {subject}",
        )
        return
    space = os.statvfs(folder)
    free_bytes = space.f_bavail * space.f_frsize
    if free_bytes < TELEMETRY_BYTES:
        yield _missing(subject, f"{free_bytes} bytes free of {TELEMETRY_BYTES} needed", f"ls -lS {subject}")
    else:
        yield _ok(subject, f"writable, {free_bytes >> 20} MiB free")


def of_software() -> Iterator[Finding]:
    """Python, and the packages beside the versions that were tested."""
    yield _ok("Python", f"{platform.python_version()} ({platform.python_implementation()})")
    for name, tested in TESTED.items():
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            version = ""
        yield of_package(name, version, tested)


def of_package(name: str, version: str, tested: str) -> Finding:
    """One package; `version` is empty where there is none."""
    mend = f"{shlex.quote(sys.executable)} -m pip install {name}=={tested}"
    if not version:
        return _missing(name, "not installed", mend)
    if version != tested:
        return _warn(name, f"{version}, tested with {tested}", mend)
    return _ok(name, f"{version}, as tested")


def _elsewhere(system: str) -> Iterator[Finding]:
    """What is Linux's alone."""
    yield _warn(
        "SocketCAN",
        f"does not apply to {system}: a python-can adapter, or the simulated vehicle in the loop's process",
        "vehicle-iface demo",
    )
    yield _warn(
        "real time",
        f"does not apply to {system}: no SCHED_FIFO, no /dev/shm; other programs delay the loop (take Linux)",
        "vehicle-iface demo",
    )


def _refusal() -> str:
    """Why there is no SocketCAN; empty where there is."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _exists(channel: str) -> bool:
    try:
        socket.if_nametoindex(channel)
    except OSError:
        return False
    return True


def _absent(channel: str) -> Finding:
    name = shlex.quote(channel)
    if channel.startswith("vcan"):
        mend = f"sudo modprobe vcan && sudo ip link add dev {name} type vcan && sudo ip link set {name} up"
        return _missing(channel, "no such interface", mend)
    return _missing(
        channel, "no such interface; is the adapter plugged in? It would be in", "ip -brief link show type can"
    )


def _up(name: str, kind: str, bus: Bus) -> str:
    """What comes after `ip link set`, to bring it up as the profile wants it."""
    if kind != "can":
        return f"{name} up"
    fd = f" dbitrate {bus.data_bitrate or bus.bitrate} fd on" if bus.fd else ""
    return f"{name} up type can bitrate {bus.bitrate} restart-ms 100{fd}"


def _granted_bytes() -> int:
    """Of the receive buffer that the bus asks for; a socket is asked, the limit's file is not everywhere."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asked:
        asked.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        return asked.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2  # Linux doubles it for its own use


def _read(path: str | Path) -> str:
    """The text there, empty where there is none."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError:
        return ""


def _number(path: str) -> int | None:
    text = _read(path).strip()
    return int(text) if text.lstrip("-").isdigit() else None


def _ok(subject: str, text: str) -> Finding:
    return Finding(subject=subject, verdict=Verdict.OK, text=text)


def _warn(subject: str, text: str, mend: str) -> Finding:
    return Finding(subject=subject, verdict=Verdict.WARN, text=text, mend=mend)


def _missing(subject: str, text: str, mend: str) -> Finding:
    return Finding(subject=subject, verdict=Verdict.MISSING, text=text, mend=mend)
