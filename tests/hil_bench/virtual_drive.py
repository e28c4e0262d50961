"""The program's loop and the bench's vehicle of a profile, wired back to back in virtual time."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from hil_bench.applicable import scale_for
from hil_bench.peer.build import build_vehicle, examine, open_wire
from hil_bench.routes import Route
from hil_bench.vehicle import Vehicle
from hil_bench.wire import Wire
from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import Frame, S

from vehicle_iface import compose
from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.trajectories.csv_file import load_csv
from vehicle_iface.trajectories.source import FixedTrajectory

Change = Callable[[Frame], list[Frame]]
"""What is on the bus instead of a frame of the device."""


class BenchBus:
    """A bus of the program's with the bench's vehicle at its other end."""

    description = "the bench's vehicle"

    def __init__(self, vehicle: Vehicle, change: Change) -> None:
        self.now_ns = S
        self.frames: list[Frame] = []
        """Everything that was on the bus."""
        self.of_others: set[int] = set()
        """The numbers of those frames that neither the device nor the vehicle sent."""
        self.vehicle, self._change = vehicle, change
        self._due_ns, self._inbox = S, list[CanFrame]()
        self.ticks = 0
        self.is_up = True
        self.transmits = True
        """Whether the vehicle does."""
        self.delay_s: Callable[[], float] = lambda: 0.0
        """By how much each of the vehicle's samples is late."""

    def open(self) -> "BenchBus":
        self.check_link()
        return self

    def check_link(self) -> None:
        """Raises `BusError` while the link is down."""
        if not self.is_up:
            raise BusError("the bus is down")

    def wait(self, until_ns: int) -> bool:
        self.check_link()
        while not self._inbox:
            due_ns = min(until_ns, self._due_ns)
            self.sleep_until(due_ns)
            if self.now_ns >= self._due_ns:
                self._tick()
            if due_ns >= until_ns:
                break
        return bool(self._inbox)

    def pass_until(self, until_ns: int) -> None:
        """Let time pass for the vehicle, whatever the device does meanwhile."""
        while self._due_ns <= until_ns:
            self.sleep_until(self._due_ns)
            self._tick()
        self.sleep_until(until_ns)

    def pass_tick(self) -> None:
        """Let time pass until the vehicle has sent its next sample."""
        self.pass_until(self._due_ns)

    def drain(self) -> list[CanFrame]:
        self.check_link()
        frames, self._inbox = self._inbox, []
        return frames

    def has_room(self) -> bool:
        return True

    def put(self, frame: Frame, *, to_vehicle: bool) -> None:
        """A frame of another node, which the vehicle obeys or not."""
        if self.is_up:
            self.of_others.add(len(self.frames))
            self._deliver(self._note(frame))
            if to_vehicle:
                self.vehicle.receive(self.frames[-1], self.now_ns)

    def send(self, *frames: CanFrame) -> int:
        self.check_link()
        for sent in frames:
            frame = Frame(0, sent.can_id, sent.data, is_extended=sent.is_extended, is_fd=sent.is_fd, bus=sent.bus)
            for changed in self._change(frame):
                self.vehicle.receive(self._note(changed), self.now_ns)
        return len(frames)

    def counters(self) -> dict[str, int]:
        return {"received": 0, "sent": 0}

    def close(self) -> None:
        self._inbox = []

    def sleep_until(self, deadline_ns: int) -> None:
        self.now_ns = max(self.now_ns, deadline_ns)

    def _tick(self) -> None:
        self._due_ns += self.vehicle.period_ns
        self.ticks += 1
        self.vehicle.move(self.vehicle.period_ns / S, self.now_ns)
        frames = self.vehicle.next_frames()
        if self.is_up and self.transmits:
            self.sleep_until(self.now_ns + round(self.delay_s() * S))
            for frame in frames:
                self._deliver(self._note(frame))

    def _deliver(self, frame: Frame) -> None:
        kind = {"is_extended": frame.is_extended, "is_fd": frame.is_fd, "is_remote": frame.is_remote}
        self._inbox.append(CanFrame(frame.can_id, frame.data, frame.stamp_ns, bus=frame.bus, **kind))

    def _note(self, frame: Frame) -> Frame:
        """Frames of one instant follow one another by 0.1 ms."""
        stamp_ns = max(self.now_ns, self.frames[-1].stamp_ns + 100_000) if self.frames else self.now_ns
        self.frames.append(replace(frame, stamp_ns=stamp_ns))
        return self.frames[-1]


class VirtualDrive:
    """The program drives a route of the bench with the bench's vehicle."""

    def __init__(self, profile: str, route: Route, folder: Path, change: Change = lambda frame: [frame]) -> None:
        self.wire: Wire = open_wire(profile)
        self.vehicle = build_vehicle(self.wire)
        self.bus = BenchBus(self.vehicle, change)
        database = load_database(load_profile(profile))
        driven = scale_for(route, self.wire)
        self.vehicle.drives_to(driven.x_m[-1], driven.y_m[-1])
        path = driven.write(folder / "route.csv", self.wire.frame_id)
        self.loop = compose.build_loop(
            database=database,
            open_bus=self.bus.open,
            controller=compose.build_controller("pure_pursuit", database.profile),
            source=FixedTrajectory(load_csv(path)),
            telemetry=None,
            armed=True,
            now_ns=lambda: self.bus.now_ns,
            sleep_until=self.bus.sleep_until,
        )

    def run_s(self, seconds: float) -> None:
        end_ns = self.bus.now_ns + round(seconds * S)
        while self.bus.now_ns < end_ns and not self.loop.shutdown.is_done:
            self.loop.step()

    def run_until(self, holds: Callable[[], object], within_s: float) -> None:
        end_ns = self.bus.now_ns + round(within_s * S)
        while not holds():
            assert self.bus.now_ns < end_ns, f"not within {within_s} s: {self.loop.reason.name}"
            self.loop.step()

    def record(self) -> Record:
        return examine(self.wire, self.bus.frames)
