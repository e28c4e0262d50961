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
        self.vehicle, self._change = vehicle, change
        self._due_ns, self._inbox = S, list[CanFrame]()
        self.ticks = 0

    def open(self) -> "BenchBus":
        return self

    def wait(self, until_ns: int) -> bool:
        while not self._inbox:
            due_ns = min(until_ns, self._due_ns)
            self.sleep_until(due_ns)
            if self.now_ns >= self._due_ns:
                self._tick()
            if due_ns >= until_ns:
                break
        return bool(self._inbox)

    def drain(self) -> list[CanFrame]:
        frames, self._inbox = self._inbox, []
        return frames

    def has_room(self) -> bool:
        return True

    def send(self, *frames: CanFrame) -> int:
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
        self.vehicle.move(self.vehicle.period_ns / S, self.now_ns)
        for frame in map(self._note, self.vehicle.next_frames()):
            kind = {"is_extended": frame.is_extended, "is_fd": frame.is_fd, "is_remote": frame.is_remote}
            self._inbox.append(CanFrame(frame.can_id, frame.data, frame.stamp_ns, bus=frame.bus, **kind))
        self._due_ns += self.vehicle.period_ns
        self.ticks += 1

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
