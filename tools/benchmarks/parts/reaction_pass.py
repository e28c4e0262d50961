"""One whole pass of the `reaction` benchmark, in one process, the contestants in turns.

The frames are queued, the clock is read, the contestant steps, the clock is read again. A pair of AF_UNIX datagram
sockets stands in the place of each CAN socket: it exists everywhere, carries one struct can_frame a datagram, and takes
the same system calls (recvmmsg, kernel stamps, time-outs), so that they cost what they cost.
"""

import json
import logging
import math
import os
import socket
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from unittest import mock

import can
import msgspec
from vehicle_bus_contract.reference import intact
from vehicle_bus_contract.socketcan import decode

from benchmarks.parts.reaction_contestants import Bare, Contestant, Echo, PythonCan
from benchmarks.parts.reaction_vehicle import Course, RailVehicle, figure_of_eight
from vehicle_iface import compose, opening, wire
from vehicle_iface.bus import socketcan, traffic_monitor
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime import realtime
from vehicle_iface.runtime.command_pace import CommandPace
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.runtime.transmit_periods import allowed_messages
from vehicle_iface.safety.transmit_filter import TransmitFilter
from vehicle_iface.telemetry import SessionInfo, TelemetryWriter
from vehicle_iface.trajectories.source import FixedTrajectory, TrajectorySource
from vehicle_iface.units import ns_from_s

HOT, IDLE = "hot", "after 4 ms idle"
IDLE_S = 0.004
BLOCK = 5
"""Hot passes of one contestant in a row, behind one that is not counted, for it is not hot."""
HOT_SAMPLE_PERIOD_S = 0.0002
"""What the profile says instead of 10 ms: the state assembler keeps rounds of the counter apart by it, and hot passes
come faster than the vehicle's 100 Hz. The transmit filter that limits the rate of what is sent is told the same."""
STATE_STALE_S = 0.5
"""What the profile says instead of 50 ms: while the others have their turns no samples come."""
SO_TIMESTAMPNS = 35
STATUS_S = 0.05
PROOFS, PROOF_S = 100, 0.01
SAME_RAD, SIMILAR_RAD = 0.0011, 0.1
"""Ten steps of the wire, for the trajectories begin some milliseconds apart; another pure pursuit steers otherwise."""


@dataclass(slots=True)
class Runner:
    """Runs one contestant and collects its times."""

    name: str
    contestant: Contestant
    far: socket.socket
    vehicle: RailVehicle
    rest: Callable[[], None]
    """What it does between two samples."""
    passes_ns: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    sent_ns: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    """From the begin of the pass to the kernel's stamp on the second command."""
    unanswered: int = 0
    last_status_s: float = -math.inf
    last_counter: int = -1
    front_wheel_angle_rad: float = math.nan
    """In the last answer."""
    is_judged: bool = True
    clock_ns: Callable[[], int] = time.perf_counter_ns
    """What the duration of a pass is read from."""

    def one_pass(self, how: str | None, now_s: float | None = None) -> None:
        """Three frames in, one pass, the two commands taken out and judged."""
        now_s = time.monotonic() if now_s is None else now_s
        is_status_due = now_s - self.last_status_s > STATUS_S
        if is_status_due:
            self.last_status_s = now_s
            self.far.send(self.vehicle.status())
        self.rest()
        received(self.far)  # what waits there counts as not sent yet
        frames = self.vehicle.sample(now_s)
        if how == IDLE:
            time.sleep(IDLE_S)
        for frame in frames:
            self.far.send(frame)
        wall_ns, begin_ns = time.time_ns(), self.clock_ns()
        self.contestant.step()
        took_ns = self.clock_ns() - begin_ns
        last_ns = self._hear(now_s)
        if last_ns is None:
            self.unanswered += how is not None
        elif how is not None and not is_status_due:
            self.passes_ns[how].append(took_ns)
            self.sent_ns[how].append(last_ns - wall_ns)

    def _hear(self, now_s: float) -> int | None:
        """When the second command was sent, if there were exactly two: intact, stepping by one, and no stop."""
        pair = []
        for raw, stamp_ns in received(self.far):
            frame = decode(raw, stamp_ns)
            self.vehicle.receive(frame, now_s)
            if frame.can_id in (0x080, 0x081):
                pair.append(frame)
        if [frame.can_id for frame in pair] != [0x080, 0x081]:
            return None
        if self.is_judged:
            drive, steer = (intact(frame) for frame in pair)
            if drive is None or steer is None:
                return None
            self.front_wheel_angle_rad = steer["FRONT_WHEEL_ANGLE_REQUEST"]
            expected, self.last_counter = (self.last_counter + 1) % 15, drive.counter
            if drive.counter != expected or steer.counter != expected or drive.reason != "NOMINAL":
                return None
        return pair[-1].stamp_ns


def received(far: socket.socket) -> list[tuple[bytes, int]]:
    """What has come, each with its kernel stamp."""
    found: list[tuple[bytes, int]] = []
    while True:
        try:
            raw, ancillary, _, _ = far.recvmsg(72, 64, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return found
        seconds, nanoseconds = (int.from_bytes(ancillary[0][2][at : at + 8], "little") for at in (0, 8))
        found.append((raw, seconds * 1_000_000_000 + nanoseconds))


class Wires:
    """Makes socket pairs; the far ends are kept."""

    def __init__(self) -> None:
        self.far: list[socket.socket] = []

    def near(self) -> socket.socket:
        """The contestant's end."""
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        near.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        far.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.far.append(far)
        return near


def _answer_every_sample(database: VehicleDatabase, transmit_filter: TransmitFilter) -> CommandPace:
    """A pace by which samples may come faster than the profile says."""
    periods_ns = dict.fromkeys((message.name for message in database.commands), 1)
    return CommandPace(database.commands, periods_ns, sample_period_ns=1, transmit_filter=transmit_filter)


def build_ours(
    wires: Wires, course: Course, telemetry: TelemetryWriter, source: TrajectorySource | None = None
) -> Loop:
    """(b) The program, put together as `vehicle-iface run --arm --trajectory` does; with another source if given."""
    profile = load_profile("reference")
    timing = msgspec.structs.replace(profile.timing, sample_period_s=HOT_SAMPLE_PERIOD_S, state_stale_s=STATE_STALE_S)
    database = replace(load_database(profile), profile=msgspec.structs.replace(profile, timing=timing))
    near = mock.Mock(side_effect=lambda *_, **__: wires.near())
    outgoing = [m._replace(period_ns=ns_from_s(HOT_SAMPLE_PERIOD_S)) for m in allowed_messages(database)]
    with (
        mock.patch.object(socketcan, "open_socket", near),
        mock.patch.object(traffic_monitor, "open_socket", near),
        mock.patch.object(compose, "allowed_messages", return_value=outgoing),
        mock.patch.object(compose, "build_pace", _answer_every_sample),
    ):
        return compose.build_loop(
            database=database,
            open_bus=lambda: opening.open_buses(
                "socketcan",
                {"": "socket pair"},
                database.profile,
                received=(*database.received, *database.sent),
                sent=database.sent,
                receive_timeout_ns=ns_from_s(timing.command_period_s),
            ),
            controller=compose.build_controller("pure_pursuit", database.profile),
            source=source or FixedTrajectory(course.trajectory()),
            telemetry=telemetry,
            armed=True,
        )


def build_python_can(wires: Wires, course: Course, *, searches_all: bool) -> PythonCan:
    """python-can's own SocketCAN bus on a socket pair."""
    from can.interfaces.socketcan import socketcan as theirs

    logging.getLogger("can").setLevel(logging.CRITICAL)  # it says at the start that this is no CAN socket
    with (
        mock.patch.object(theirs, "create_socket", wires.near),
        mock.patch.object(theirs, "bind_socket"),
    ):
        bus = can.Bus(channel="socket pair", interface="socketcan")
    return PythonCan(bus, course, searches_all=searches_all)


@contextmanager
def open_runners() -> Iterator[list[Runner]]:
    """All contestants, engaged and driving."""
    course = figure_of_eight()
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        info = SessionInfo(channel="socket pair", bus="AF_UNIX")
        with ExitStack() as writers:
            telemetry = [writers.enter_context(TelemetryWriter(f"{folder}/{name}", info)) for name in NAMES]
            yield [_runner(name, course, writer) for name, writer in zip(NAMES, telemetry, strict=True)]


OURS, OURS_IN_PYTHON = "ours", "ours, wire in Python"
"""The second without the C code for the wire, whatever is built."""
NAMES = ("echo", "bare", OURS, OURS_IN_PYTHON, "python-can", "python-can, incremental search")


def _runner(name: str, course: Course, telemetry: TelemetryWriter) -> Runner:
    wires = Wires()
    rest: Callable[[], None] = lambda: None  # noqa: E731
    contestant: Contestant
    if name in (OURS, OURS_IN_PYTHON):
        choice = {wire.VARIABLE: "python"} if name == OURS_IN_PYTHON else {}
        with mock.patch.dict(os.environ, choice):
            contestant = loop = build_ours(wires, course, telemetry)
        rest = keep_time_of(loop)
    elif name == "echo":
        contestant = Echo(wires.near(), course)
    elif name == "bare":
        contestant = Bare(wires.near(), course)
    else:
        contestant = build_python_can(wires, course, searches_all="incremental" not in name)
    return Runner(name, contestant, wires.far[0], RailVehicle(course), rest, is_judged=name != "echo")


def keep_time_of(loop: Loop) -> Callable[[], None]:
    """What serves the loop's own time grid between the samples, as on a bus."""

    def keep_time() -> None:
        if loop.timer.next_ns <= time.monotonic_ns():
            loop.step()

    return keep_time


def measure(*, hot_rounds: int, idle_rounds: int) -> list[Runner]:
    """Passes of each contestant in turns, hot and after idling."""
    with open_runners() as found:
        realtime.apply_settings(cpu=max(os.sched_getaffinity(0)))
        engage(found)
        prove_fair(found)
        for number in range(hot_rounds):
            for runner in _rotated(found, number):
                runner.one_pass(None)
                for _ in range(BLOCK):
                    runner.one_pass(HOT)
        for number in range(idle_rounds):
            for runner, how in _idle_turns(found, number):
                runner.one_pass(how)
    return found


def engage(found: list[Runner]) -> None:
    """As on a bus: a sample each 5 ms until all drive, and for a while more."""
    for left in range(400, 0, -1):
        for runner in found:
            runner.one_pass(None)
        time.sleep(0.005)
        if all(runner.vehicle.is_autonomous for runner in found if runner.is_judged) and left > 50:
            break
    else:
        raise RuntimeError("not all contestants engaged")
    for _ in range(50):
        for runner in found:
            runner.one_pass(None)
        time.sleep(0.005)


def prove_fair(found: list[Runner]) -> None:
    """All at the same place of the course steer as the bare loop does, and ours exactly so."""
    judged = {runner.name: runner for runner in found if runner.is_judged}
    # Ours drives off last, and believes no vehicle that is suddenly elsewhere.
    last_s = max(runner.vehicle.left_s for runner in judged.values())
    for runner in judged.values():
        runner.vehicle.left_s = last_s
    for _ in range(PROOFS):
        now_s = time.monotonic()
        for runner in judged.values():
            runner.one_pass(None, now_s)
        time.sleep(PROOF_S)
    angles_rad = {name: runner.front_wheel_angle_rad for name, runner in judged.items()}
    for name, angle_rad in angles_rad.items():
        if not abs(angle_rad - angles_rad["bare"]) <= (SAME_RAD if name.startswith(OURS) else SIMILAR_RAD):
            raise RuntimeError(f"contestants steer differently at the same place: {angles_rad}")


def _rotated(found: list[Runner], by: int) -> list[Runner]:
    """Each round every one a place later: none waits for much more than the turns of all others."""
    by = -by % len(found)
    return found[by:] + found[:by]


def _idle_turns(found: list[Runner], number: int) -> list[tuple[Runner, str | None]]:
    """The turns of one round after idling. The second of ours in it does not count: it finds its code in the caches."""
    turns = _rotated(found, number)
    ours = [turns.index(runner) for runner in turns if runner.name in (OURS, OURS_IN_PYTHON)]
    if number // len(found) % 2:
        turns[ours[0]], turns[ours[1]] = turns[ours[1]], turns[ours[0]]
    return [(runner, None if place == ours[1] else IDLE) for place, runner in enumerate(turns)]


def main() -> None:
    hot_rounds, idle_rounds = map(int, sys.argv[1:])
    found = measure(hot_rounds=hot_rounds, idle_rounds=idle_rounds)
    result = {
        runner.name: {
            "passes_us": {how: [took_ns / 1e3 for took_ns in took] for how, took in runner.passes_ns.items()},
            "sent_us": {how: [took_ns / 1e3 for took_ns in took] for how, took in runner.sent_ns.items()},
            "unanswered": runner.unanswered,
        }
        for runner in found
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
