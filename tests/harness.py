"""The whole loop and the simulated vehicle, wired back to back in virtual time: real codec, real checksums.

Nothing here reads a clock. What the loop sends is decoded by the bus contract, not by the program's own codec.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from vehicle_bus_contract.reference import CONTROLLER_SENDS, COUNTERS

from tests.contract_frames import intact
from vehicle_iface import BehaviorConfig, PurePursuit, PurePursuitConfig, Trajectory, VehicleState, compose
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.command import SafeCommand
from vehicle_iface.control.base import ControllerBase
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.driver_commands import execute
from vehicle_iface.sim.embedded import EmbeddedBus
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.telemetry import TelemetryWriter
from vehicle_iface.trajectories.source import FixedTrajectory, TrajectorySource
from vehicle_iface.units import NS_PER_MS, ns_from_s, s_from_ns

START_NS = 1_000_000_000


class Clock:
    """Advances only during sleep calls."""

    def __init__(self) -> None:
        self.t_ns = START_NS

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until(self, deadline_ns: int) -> None:
        self.t_ns = max(self.t_ns, deadline_ns)


@dataclass(frozen=True)
class Sent:
    """One frame of the controller, taken apart."""

    at_ns: int
    step: int
    """The loop's pass in which it was sent."""
    name: str
    counter: int
    signals: Mapping[str, float]
    frame: CanFrame

    def __getitem__(self, signal: str) -> float:
        return self.signals[signal]


@dataclass(frozen=True)
class Pair:
    """A DRIVE_COMMAND and the STEER_COMMAND that was sent with it."""

    drive: Sent
    steer: Sent

    def __getitem__(self, signal: str) -> float:
        return self.drive.signals[signal] if signal in self.drive.signals else self.steer.signals[signal]

    @property
    def at_ns(self) -> int:
        return self.drive.at_ns

    @property
    def step(self) -> int:
        return self.drive.step


class Line:
    """The embedded bus with a tap on it, and hands that can cut it, fill it and slip frames in."""

    description = "embedded bus with a tap"

    def __init__(self, inner: EmbeddedBus, clock: Clock) -> None:
        self.inner = inner
        self.clock = clock
        self.step = 0
        self.sent: list[Sent] = []
        self.down = False
        self.full = False
        self.takes: int | None = None
        """Of each command only the first so many frames; None: all."""
        self.waiting = False
        """What was sent last has not left yet."""
        self.opened = 0
        self.samples: list[tuple[int, VehicleState]] = []
        self._waiting: list[CanFrame] = []

    def open(self) -> "Line":
        if self.down:
            raise BusError("tap: down")
        self.opened += 1
        return self

    def wait(self, until_ns: int) -> bool:
        self._check()
        return bool(self._waiting) or self.inner.wait(until_ns)

    def drain(self) -> list[CanFrame]:
        self._check()
        frames, self._waiting = self._waiting + self.inner.drain(), []
        return frames

    def has_room(self) -> bool:
        self._check()
        return not self.waiting

    def send(self, *frames: CanFrame) -> int:
        self._check()
        if self.full:
            return 0
        frames = frames[: self.takes]
        self.sent += [decode_sent(frame, self.clock.t_ns, self.step) for frame in frames]
        return self.inner.send(*frames)

    def counters(self) -> dict[str, int]:
        return self.inner.counters()

    def close(self) -> None:
        self._waiting = []
        self.inner.drain()

    def inject(self, frame: CanFrame) -> None:
        """Another node's frame, received with the next ones."""
        self._waiting.append(frame._replace(stamp_ns=self.clock.t_ns))

    def let_drive(self, until_ns: int) -> None:
        """Time passes while the loop does not run; what the vehicle sends waits, stamped with its own time."""
        vehicle = self.inner.vehicle
        while vehicle.next_due_ns <= until_ns:
            self.clock.sleep_until(vehicle.next_due_ns)
            frames = vehicle.advance(self.clock.t_ns)
            self._waiting += [frame._replace(stamp_ns=self.clock.t_ns) for frame in frames]
        self.clock.sleep_until(until_ns)

    def _check(self) -> None:
        if self.down:
            raise BusError("tap: cut")


class Drive:
    """A loop, a vehicle, and everything that went over the line between them."""

    def __init__(
        self,
        source: TrajectorySource | None = None,
        *,
        controller: ControllerBase | None = None,
        armed: bool = True,
        start: BicycleState | None = None,
        telemetry: TelemetryWriter | None = None,
        database: VehicleDatabase | None = None,
        **vehicle: Any,
    ) -> None:
        """`database` is the reference vehicle's, unless another one is given."""
        database = database if database is not None else reference()
        self.clock = Clock()
        self.vehicle = simulated_vehicle(database, start_ns=START_NS, start=start, **vehicle)
        self.line = Line(EmbeddedBus(self.vehicle, self.clock.now_ns, self.clock.sleep_until), self.clock)
        self.controller = controller or pure_pursuit()
        self.source = source or FixedTrajectory(straight())
        self.loop = compose.build_loop(
            database=database,
            open_bus=self.line.open,
            controller=self.controller,
            source=self.source,
            telemetry=telemetry,
            armed=armed,
            now_ns=self.clock.now_ns,
            sleep_until=self.clock.sleep_until,
        )

    @property
    def now_s(self) -> float:
        """Since the start."""
        return s_from_ns(self.clock.t_ns - START_NS)

    def mode(self) -> Mode:
        return self.loop._engagement.mode

    @property
    def sent(self) -> list[Sent]:
        return self.line.sent

    @property
    def state(self) -> VehicleState:
        """Of the newest complete sample."""
        newest = self.loop._newest
        assert newest is not None
        return newest.state

    def last_command(self) -> SafeCommand | None:
        """What the gate permitted last, sent or not."""
        decision = self.loop._cycle.last
        return decision.permitted if decision is not None else None

    def step(self) -> None:
        self.line.step += 1
        self.loop.step()

    def run_s(self, seconds: float) -> None:
        end_ns = self.clock.t_ns + ns_from_s(seconds)
        while self.clock.t_ns < end_ns and not self.loop.shutdown.is_done:
            self.step()

    def run_until(self, holds: Callable[[], object], within_s: float) -> float:
        """Run until something holds; the seconds that it took."""
        begin_ns = self.clock.t_ns
        while not holds():
            self.step()
            took_s = s_from_ns(self.clock.t_ns - begin_ns)
            assert took_s <= within_s, f"not within {within_s} s: {self.mode().name} {self.loop.reason.name}"
        return s_from_ns(self.clock.t_ns - begin_ns)

    def engage(self, speed_mps: float = 0.0) -> "Drive":
        """Until the controller is engaged and the vehicle at least so fast."""
        self.run_until(lambda: self.mode() is Mode.ENGAGED and abs(self.vehicle.state.speed_mps) >= speed_mps, 20.0)
        return self

    def stall(self, seconds: float) -> None:
        """The loop's process gets no time; the vehicle goes on."""
        self.line.let_drive(self.clock.t_ns + ns_from_s(seconds))

    def send_line(self, line: str) -> None:
        """An order to the vehicle's pedals."""
        assert execute(self.vehicle, line) == "ok"

    def named(self, name: str, since: int = 0) -> list[Sent]:
        return [sent for sent in self.sent[since:] if sent.name == name]

    def pairs(self, since: int = 0) -> list[Pair]:
        """Command pairs from frame number `since` on; fails when a command is not one of a pair."""
        drives, steers = self.named("DRIVE_COMMAND", since), self.named("STEER_COMMAND", since)
        assert [d.step for d in drives] == [s.step for s in steers]
        return [Pair(drive, steer) for drive, steer in zip(drives, steers, strict=True)]

    def last(self) -> Pair:
        return self.pairs(max(0, len(self.sent) - 6))[-1]


@cache
def reference() -> VehicleDatabase:
    """The reference vehicle's profile and DBC."""
    return load_database(load_profile("reference"))


def pure_pursuit(**behavior: Any) -> PurePursuit:
    return PurePursuit(PurePursuitConfig(wheelbase_m=2.7), behavior=BehaviorConfig(**behavior))


def straight(
    length_m: float = 500.0, speed_mps: float = 5.0, *, time_s: float | None = None, frame_id: str = "map"
) -> Trajectory:
    """Along +x from the origin at one speed; `time_s` is when its end shall be reached."""
    count = max(2, round(length_m) + 1)
    x_m = np.linspace(0.0, math.copysign(length_m, speed_mps), count)
    time_s = length_m / abs(speed_mps) if time_s is None else time_s
    return Trajectory(
        stamp_ns=0,
        frame_id=frame_id,
        time_from_start_ns=np.rint(np.linspace(0.0, time_s, count) * 1e9).astype(np.int64),
        x_m=x_m,
        y_m=np.zeros(count),
        heading_rad=np.zeros(count),
        speed_mps=np.full(count, speed_mps),
    )


def decode_sent(frame: CanFrame, at_ns: int = 0, step: int = 0) -> Sent:
    """A frame of the controller by the contract's page; fails when it is not intact."""
    decoded = intact(frame)
    assert decoded is not None
    assert decoded.name in CONTROLLER_SENDS
    return Sent(at_ns, step, decoded.name, decoded.counter, decoded.signals, frame)


def counters_step_by_one(frames: Sequence[Sent]) -> bool:
    """Whether each message's counter runs 0, 1, … 14, 0, … over the frames."""
    newest: dict[str, int] = {}
    for sent in frames:
        if sent.name in newest and sent.counter != (newest[sent.name] + 1) % COUNTERS:
            return False
        newest[sent.name] = sent.counter
    return True


def ms(count: float) -> int:
    """Milliseconds in nanoseconds."""
    return round(count * NS_PER_MS)
