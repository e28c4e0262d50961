"""`vehicle-iface demo`: runs simulated vehicle, loop and viewer as separate processes, started and ended together."""

import argparse
import ctypes
import shlex
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from vehicle_iface import clock
from vehicle_iface.cli.demo_bus import choose_bus
from vehicle_iface.cli.logging import CLEAR_LINE
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.codec.database import load_database
from vehicle_iface.drivable import build_route
from vehicle_iface.errors import ConfigError
from vehicle_iface.process import module_command
from vehicle_iface.profile import Profile, load_profile
from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import Snapshot, TelemetryReader, WriterState
from vehicle_iface.units import s_from_ns

ENDING_S = 20.0
"""Time limit for the processes to end. The vehicle has 10 s to stop, and the recorder 5 s to end; a process that takes
longer is killed."""
PR_SET_PDEATHSIG = 1


def run_demo(options: argparse.Namespace) -> int:
    """Run until the loop ends, a process fails, or SIGINT or SIGTERM is received; return the loop's exit status."""
    has_page, port = not options.no_viewer, options.port
    profile = load_drivable_profile(options.profile, options.route)
    if has_page:
        require_free_port(port)
    bus = choose_bus(profile)
    print(f"bus: {bus.why}", flush=True)
    address = f"demo-{port}"
    ended = threading.Event()
    processes = _Processes()

    def end(*_: object) -> None:
        if ended.is_set():
            processes.end_at_once()
        ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    try:
        if bus.interface == "socketcan":
            processes.start("sim", ["sim", "--profile", options.profile, *bus.options])
        if has_page:
            page = ["view", "--connect", address, "--port", str(port), *(["--open"] if options.open else [])]
            processes.start("viewer", page)
        loop = ["run", "--profile", options.profile, *bus.options, "--route", options.route, "--arm"]
        loop += ["--telemetry", address]
        loop += ["--duration", str(options.duration)] if options.duration is not None else []
        loop += ["--summary", str(Path(options.summary).absolute())] if options.summary else []
        loop += ["--record", str(Path(options.record).absolute())] if options.record else []
        processes.start("loop", loop)
        _watch(processes, address, ended)
    finally:
        processes.end()
        _remove_telemetry(address)
    return processes.status()


def load_drivable_profile(name: str, route: str) -> Profile:
    """Load the profile and check its DBCs and the route, so that a fault is reported once, before any process starts.

    Raise `ConfigError` if one is faulty or the profile only watches.
    """
    profile = load_profile(name)
    if profile.only_watches:
        raise ConfigError(
            f"--profile {name}: has no [command], so nothing can drive it here; to watch it: vehicle-iface run "
            f"--interface embedded --profile {shlex.quote(name)} --route {route}, and vehicle-iface view beside it"
        )
    build_route(route, load_database(profile).profile)
    return profile


def require_free_port(port: int) -> None:
    """Raise `ConfigError` if another program uses the page's port: its page would be mistaken for the demo's."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise ConfigError(
                f"--port {port}: {error.strerror}. Another demo or viewer may be running; "
                f"end it, or use another port, like --port {port + 1 if port < 0xFFFF else port - 1}"
            ) from None


def _remove_telemetry(address: str) -> None:
    """Remove the demo's own telemetry file, unless another loop writes to that address."""
    with TelemetryReader(address) as reader:
        if reader.poll() in (WriterState.ENDED, WriterState.DEAD):
            reader.path.unlink(missing_ok=True)


class _Processes:
    """The demo's child processes, each in its own session, so that the demo decides the order in which Ctrl-C ends
    them."""

    def __init__(self) -> None:
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.failed: str | None = None

    def start(self, name: str, arguments: Sequence[str]) -> None:
        command_line, environment = module_command("vehicle_iface")
        self._running[name] = subprocess.Popen(
            [*command_line, *arguments],
            env=environment,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            preexec_fn=_die_with_parent if sys.platform == "linux" else None,
        )

    def all_run(self) -> bool:
        """Whether every process still runs; remember the first one that ended."""
        for name, process in self._running.items():
            if process.poll() is not None:
                self.failed = name if name != "loop" else None
                return False
        return True

    def end(self) -> None:
        """End the loop first, which stops the vehicle, then the others."""
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

    def end_at_once(self) -> None:
        """Send each process a second end signal: the loop releases the vehicle without stopping it first."""
        for process in self._running.values():
            if process.poll() is None:
                process.terminate()

    def status(self) -> int:
        """Return the exit status of the process that ended first without being asked, otherwise the loop's."""
        status = self._running[self.failed or "loop"].returncode if self._running else 0
        if self.failed is not None:
            print(f"demo: {self.failed} exited unexpectedly with status {status}", file=sys.stderr)
            return status or 1
        return status


def _die_with_parent() -> None:
    """Make the kernel signal this process when the demo is killed."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _watch(processes: _Processes, address: str, ended: threading.Event) -> None:
    """Print the state of the drive once a second until it ends."""
    in_place = sys.stdout.isatty()
    with TelemetryReader(address) as reader:
        before: Snapshot | None = None
        while processes.all_run() and not ended.wait(1.0 if in_place else 5.0):
            reader.poll()
            now = reader.newest()
            if now is not None:
                line = _line(before, now)
                print_safely(CLEAR_LINE + line if in_place else line, end="" if in_place else "\n")
            before = now
    if in_place:
        print_safely("")


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
