"""The demo: simulated vehicle, loop and viewer as processes of their own, started and ended together."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from vehicle_iface import clock
from vehicle_iface.process import python_module
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.telemetry import Snapshot, TelemetryReader
from vehicle_iface.status import ControllerState
from vehicle_iface.units import s_from_ns

CHANNEL = "vcan0"
ENDING_S = 20.0
"""The vehicle has 10 s to stop, and the recorder 5 s to end; what runs longer than this is killed."""
PR_SET_PDEATHSIG = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class BusChoice:
    """The bus that the demo drives on."""

    interface: str
    channel: str
    why: str
    """In words, with the way to a real one where this is none."""


def run(
    *,
    route: str,
    port: int,
    duration_s: float | None,
    summary: str | None,
    record: str | None,
    viewer: bool,
    open_page: bool,
) -> int:
    """Run until the loop ends, one process fails, or SIGINT or SIGTERM comes; the loop's exit status."""
    bus = choose_bus()
    print(f"bus: {bus.why}", flush=True)
    address = f"demo-{port}"
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    processes = _Processes()
    try:
        if bus.interface == "socketcan":
            processes.start("sim", ["sim", "--channel", bus.channel])
        if viewer:
            page = ["view", "--connect", address, "--port", str(port), *(["--open"] if open_page else [])]
            processes.start("viewer", page)
        loop = ["run", "--interface", bus.interface, "--channel", bus.channel, "--route", route, "--arm"]
        loop += ["--telemetry", address]
        loop += ["--duration", str(duration_s)] if duration_s is not None else []
        loop += ["--summary", str(Path(summary).absolute())] if summary else []
        loop += ["--record", str(Path(record).absolute())] if record else []
        processes.start("loop", loop)
        _watch(processes, address, ended)
    finally:
        processes.end()
    return processes.status()


def choose_bus() -> BusChoice:
    """vcan0 where SocketCAN exists (created where that is allowed), else the embedded bus."""
    embedded = "embedded bus, simulated vehicle inside the loop's process"
    if not _has_socketcan():
        return BusChoice(
            interface="embedded",
            channel="embedded",
            why=f"{embedded} (this kernel has no SocketCAN). For real CAN frames: tools/vcan tools/demo, "
            "or a Linux kernel with the modules can, can_raw and vcan",
        )
    how = f"sudo ip link add dev {CHANNEL} type vcan && sudo ip link set {CHANNEL} up"
    if not _is_up(CHANNEL) and not _created():
        return BusChoice(
            interface="embedded",
            channel="embedded",
            why=f"{embedded} ({CHANNEL} is missing or down, and may not be created). For real CAN frames: {how}",
        )
    return BusChoice(interface="socketcan", channel=CHANNEL, why=f"SocketCAN {CHANNEL}; candump {CHANNEL} shows it")


def _has_socketcan() -> bool:
    if not hasattr(socket, "AF_CAN"):
        return False
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def _is_up(channel: str) -> bool:
    try:
        return bool(int(Path(f"/sys/class/net/{channel}/flags").read_text(), 16) & 1)
    except OSError:
        return False


def _created() -> bool:
    """Make vcan0 with the rights of this process; whether it is up now."""
    if os.geteuid() != 0:
        return False
    for line in (f"link add dev {CHANNEL} type vcan", f"link set {CHANNEL} up"):
        with suppress(FileNotFoundError):
            subprocess.run(["ip", *line.split()], check=False, stderr=subprocess.DEVNULL)
    return _is_up(CHANNEL)


class _Processes:
    """The demo's children. Each is out of the terminal's reach, so that Ctrl-C ends them in order."""

    def __init__(self) -> None:
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.failed: str | None = None

    def start(self, name: str, arguments: Sequence[str]) -> None:
        command_line, environment = python_module("vehicle_iface")
        self._running[name] = subprocess.Popen(
            [*command_line, *arguments],
            env=environment,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            preexec_fn=_die_with_parent if sys.platform == "linux" else None,
        )

    def all_run(self) -> bool:
        """Whether everything still runs; remembers who ended first."""
        for name, process in self._running.items():
            if process.poll() is not None:
                self.failed = name if name != "loop" else None
                return False
        return True

    def end(self) -> None:
        """The loop first, for it has to stop the vehicle; then the others."""
        for name in ("loop", "sim", "viewer"):
            process = self._running.get(name)
            if process is None:
                continue
            if process.poll() is None:
                process.terminate()
            try:
                process.wait(ENDING_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def status(self) -> int:
        """Of whoever ended unasked, else of the loop."""
        status = self._running[self.failed or "loop"].returncode if self._running else 0
        if self.failed is not None:
            print(f"demo: {self.failed} ended by itself with status {status}", file=sys.stderr)
            return status or 1
        return status


def _die_with_parent() -> None:
    """A demo that is killed leaves nobody driving."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _watch(processes: _Processes, address: str, ended: threading.Event) -> None:
    """Say once a second how it goes, until it ends."""
    in_place = sys.stdout.isatty()
    with TelemetryReader(address) as reader:
        before: Snapshot | None = None
        while processes.all_run() and not ended.wait(1.0 if in_place else 5.0):
            reader.poll()
            now = reader.newest()
            if now is not None:
                line = _line(before, now)
                _say(f"\r\x1b[2K{line}" if in_place else f"{line}\n")
            before = now
    if in_place:
        _say("\n")


def _say(text: str) -> None:
    """Print, unless nobody reads: the drive goes on."""
    try:
        print(text, end="", flush=True)
    except OSError:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  # stays until the end


def _line(before: Snapshot | None, now: Snapshot) -> str:
    state, reason = ControllerState(now.controller_state).name, Reason(now.reason).name
    rate = ""
    if before is not None and now.published_ns > before.published_ns:
        elapsed_s = s_from_ns(now.published_ns - before.published_ns)
        rate = f"{(now.commands - before.commands) / elapsed_s:5.1f} commands/s"
    age_ms = s_from_ns(clock.monotonic_ns() - now.stamp_ns) * 1e3
    return (
        f"{state} {reason}  {now.speed_mps:5.2f} m/s  lateral error {now.lateral_error_m:+.3f} m  "
        f"{rate}  state age {age_ms:.0f} ms  drops {now.drops}"
    )
