"""Drives each shipped vehicle along a figure of eight, a U-turn and a stop-and-go, and tells its distance from them.

Simulated vehicle and loop are processes of their own on a virtual bus. The distance is that of the simulated vehicle's
true position: what odometry gets wrong counts. Where vcan0 is missing, all of it runs inside tools/vcan.

A kernel that stands still for 100 ms makes samples late, and a vehicle that has lost its place by dead reckoning is
stopped for good, as it must be. A drive with anything wrong is repeated, and each try is told; the last one counts.
"""

import argparse
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from vehicle_bus_contract.judge import Sample, lateral_errors_m
from vehicle_bus_contract.reference import S

from drive_checks.long_drive import (
    CANNOT,
    CLEAN,
    INTERRUPTED,
    TOOLS,
    VCAN,
    WRONG,
    CannotError,
    Programs,
    check_channel,
    interface,
    wrong_with_run,
)
from vehicle_iface.codec.database import load_database
from vehicle_iface.drivable import build_route
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile, load_profile
from vehicle_iface.sim.driver_socket import send_line
from vehicle_iface.trajectories.route import Route

MODULE = "drive_checks.shipped_drives"
DBC = TOOLS.parent / "dbc"
REFERENCE = ("reference", "reference_fd")
ROUTES = ("figure8", "u_turn", "stop_and_go")
DISTANCE_LIMIT_M = 0.3
OWN_LIMITS_M = {"fs_ai_ads_dv": 0.7}
"""Of a vehicle whose odometry is coarse: whole rpm of its wheels are 0.4 % at 3 m/s, and that is its steady speed."""
LOOK_S = 0.1
ENGAGING_S = 30.0
"""Starting two processes and engaging takes less, in a user-mode kernel as well."""
STANDING_S = 15.0
"""A vehicle that has not moved for so long does not go on; at a planned stop it waits for less."""
TRIES = 3
TIME_SHARE = 2.0
"""Of the route's own time that a drive may take."""
ENOUGH_M = 2.0
"""So far before its end a drive is enough: vehicles stop short of it."""


@dataclass(frozen=True, slots=True)
class Drive:
    """What one drive came to."""

    vehicle: str
    route: str
    driven_m: float
    duration_s: float
    distance_m: float
    """The greatest one from the path."""
    stale_stops: int
    wrong: tuple[str, ...]
    tries: int = 1


@dataclass(slots=True)
class Track:
    """The true places of a vehicle."""

    samples: list[Sample] = field(default_factory=list)
    driven_m: float = 0.0
    moved_ns: int | None = None
    """When it last had another place than before."""

    @property
    def standing_s(self) -> float:
        """How long it has had the same place."""
        return (self.samples[-1].stamp_ns - self.moved_ns) / S if self.moved_ns is not None else 0.0

    def add(self, status: dict[str, float]) -> None:
        """One place, from the simulated vehicle's status."""
        x_m, y_m, heading_rad, speed_mps = (status[name] for name in ("x_m", "y_m", "heading_rad", "speed_mps"))
        now_ns = time.monotonic_ns()
        step_m = math.hypot(x_m - self.samples[-1].x_m, y_m - self.samples[-1].y_m) if self.samples else 0.0
        self.driven_m += step_m
        if step_m > 0.0 or self.moved_ns is None:
            self.moved_ns = now_ns
        self.samples.append(Sample(now_ns, x_m, y_m, heading_rad, speed_mps))


def main() -> int:
    """0 when nothing is wrong, 1 when something is, 2 when nothing could be driven."""
    options = _options()
    try:
        vehicles = tuple(options.names) or drivable_vehicles()
        for name in vehicles:
            if load_profile(name).only_watches:
                raise CannotError(f"{name} has no [command] and cannot be driven")
    except (CannotError, ConfigError) as error:
        print(f"shipped_drives: {error}", file=sys.stderr)
        return CANNOT
    if options.channel == VCAN and not interface(VCAN).exists():
        command = [sys.executable, str(TOOLS / "vcan"), sys.executable, "-P", "-m", MODULE, *sys.argv[1:]]
        os.execv(sys.executable, command)
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    try:
        check_channel(options.channel, is_fd=False)
        drives = _drive_all(vehicles, options, over)
    except (CannotError, ConfigError) as error:
        print(f"shipped_drives: {error}", file=sys.stderr)
        return CANNOT
    if options.json:
        print(json.dumps([asdict(drive) for drive in drives], indent=2))
    if over.is_set():
        return INTERRUPTED
    return WRONG if any(drive.wrong for drive in drives) else CLEAN


def drivable_vehicles() -> tuple[str, ...]:
    """The shipped profiles of other makers' vehicles that can be driven."""
    names = sorted(path.stem for path in DBC.glob("*.toml") if path.stem not in REFERENCE)
    return tuple(name for name in names if not load_profile(name).only_watches)


def _drive_all(vehicles: Sequence[str], options: argparse.Namespace, over: threading.Event) -> list[Drive]:
    drives: list[Drive] = []
    for vehicle in vehicles:
        for route in options.route or ROUTES:
            if over.is_set():
                break
            drives.append(_drive_in_tries(vehicle, route, options, over))
    return drives


def _drive_in_tries(vehicle: str, route: str, options: argparse.Namespace, over: threading.Event) -> Drive:
    """Repeat a drive while something is wrong with it."""
    for tries in range(1, options.tries + 1):
        with (
            tempfile.TemporaryDirectory(prefix="shipped-drive-", dir=_memory()) as folder,
            _channels(load_profile(vehicle), options.channel) as channels,
        ):
            drive = replace(_drive(vehicle, route, channels, Path(folder), over), tries=tries)
        if not options.json:
            print(line(drive), flush=True)
        if not drive.wrong or over.is_set():
            break
    return drive


def _memory() -> str | None:
    """Where the programs' files go: into memory, if that can be."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


@contextmanager
def _channels(profile: Profile, channel: str) -> Iterator[list[str]]:
    """The options for the channels: `channel` for the first bus, and an interface made for each other one."""
    first, *others = profile.all_buses
    if not others:
        yield ["--channel", channel]
        return
    made = {name: f"{channel[:8]}-{name[:6]}" for name in others}
    try:
        for name in made.values():
            _ip("add", "dev", name, "type", "vcan")
            _ip("set", name, "up")
        yield [word for name, one in {first: channel, **made}.items() for word in ("--channel", f"{name}={one}")]
    finally:
        for name in made.values():
            if interface(name).exists():
                _ip("del", name)


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", "link", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise CannotError(f"ip link {' '.join(words)}: {done.stderr.strip()}")


def _drive(vehicle: str, route_name: str, channels: list[str], folder: Path, over: threading.Event) -> Drive:
    """One vehicle along one route, until it is at the end."""
    route = build_route(route_name, load_profile(vehicle))
    programs, begun_s = Programs(folder), time.monotonic()
    socket, summary = str(folder / "driver.sock"), folder / "summary.json"
    bus = [*channels, "--profile", vehicle]
    track = Track()
    try:
        programs.start_ours("sim", "sim", *bus, "--driver-socket", socket)
        files = ["--telemetry", f"shipped-drive-{os.getpid()}", "--summary", str(summary)]
        programs.start_ours("loop", "run", *bus, "--route", route_name, "--arm", *files)
        _follow(programs, socket, route, track, over)
    finally:
        programs.end()
    told = json.loads(summary.read_text() or "{}") if summary.exists() else {}
    if told:
        told["incomplete_samples"] = max(0, told["incomplete_samples"] - incomplete_at_start(vehicle))
    distance_m = max(lateral_errors_m(track.samples, route.x_m.tolist(), route.y_m.tolist()), default=0.0)
    wrong = [*programs.wrong, *wrong_with_run(told, programs.status("loop"))]
    limit_m = OWN_LIMITS_M.get(vehicle, DISTANCE_LIMIT_M)
    if distance_m >= limit_m:
        wrong.append(f"{distance_m:.2f} m from the path: must be below {limit_m} m")
    return Drive(
        vehicle=vehicle,
        route=route_name,
        driven_m=round(track.driven_m, 1),
        duration_s=round(time.monotonic() - begun_s, 1),
        distance_m=round(distance_m, 3),
        stale_stops=told.get("counts", {}).get("stops_on_stale_state", 0),
        wrong=tuple(wrong),
    )


def incomplete_at_start(vehicle: str) -> int:
    """How many samples may be incomplete because their slowest part has not come for the first time."""
    database = load_database(load_profile(vehicle))
    slowest_s = max(message.cycle_s or 0.0 for message in database.sample)
    return math.ceil(slowest_s / database.profile.timing.sample_period_s - 1e-6)


def _follow(programs: Programs, socket: str, route: Route, track: Track, over: threading.Event) -> None:
    """Look where the vehicle is until it has driven the route."""
    planned_s = route.to_trajectory().time_from_start_ns[-1] / S
    deadline_s = time.monotonic() + ENGAGING_S + TIME_SHARE * planned_s
    while track.driven_m < route.length_m - ENOUGH_M:
        if over.wait(LOOK_S):
            return
        gone = programs.ended()
        if gone is not None:
            programs.fail(gone)
            return
        if time.monotonic() > deadline_s:
            programs.wrong.append(f"driven {track.driven_m:.1f} m of {route.length_m:.1f} m when its time was over")
            return
        if track.standing_s > STANDING_S:
            programs.wrong.append(f"driven {track.driven_m:.1f} m of {route.length_m:.1f} m, then it stood")
            return
        if Path(socket).exists():
            track.add(json.loads(send_line(socket, "status", timeout_s=5.0)))


def line(drive: Drive) -> str:
    """A drive for people."""
    verdict = "; ".join(drive.wrong) or "nothing is wrong"
    stops = f", {drive.stale_stops} stops for late samples" if drive.stale_stops else ""
    stops += f", try {drive.tries}" if drive.tries > 1 else ""
    return (
        f"{drive.vehicle:<16} {drive.route:<12} {drive.driven_m:6.1f} m in {drive.duration_s:5.1f} s, "
        f"at most {drive.distance_m:.3f} m from the path{stops}: {verdict}"
    )


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="tools/shipped_drives",
        description=__doc__,
        epilog="Exit status: 0 nothing is wrong, 1 something is, 2 nothing could be driven, 130 interrupted.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="profiles in dbc/ (default: all that can be driven)")
    parser.add_argument("--route", action="append", choices=ROUTES, help="only this one; may be repeated")
    parser.add_argument("--channel", default=VCAN, help="a virtual CAN interface (default vcan0)")
    parser.add_argument(
        "--tries",
        type=int,
        choices=range(1, 10),
        default=TRIES,
        metavar="N",
        help=f"of a drive with something wrong, at most (default {TRIES})",
    )
    parser.add_argument("--json", action="store_true", help="everything, for programs")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
