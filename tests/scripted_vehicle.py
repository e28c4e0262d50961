"""A vehicle of `plain_vehicle` that a test enables in its own way, in the loop's process and in virtual time.

Its frames are encoded, and the loop's are decoded, with cantools: nothing here is the program's own codec.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cantools
from cantools.database import Database

from tests.harness import START_NS, Clock, ms, pure_pursuit, straight
from tests.inbox_bus import InboxBus
from vehicle_iface import compose
from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.frame import CanFrame
from vehicle_iface.safety.modes import Mode
from vehicle_iface.status import VehicleMode
from vehicle_iface.trajectories.source import FixedTrajectory
from vehicle_iface.units import ns_from_s


@dataclass(frozen=True)
class Received:
    """A frame of the loop's."""

    at_ns: int
    name: str
    signals: Mapping[str, float]

    def __getitem__(self, signal: str) -> float:
        return self.signals[signal]


Obey = Callable[["ScriptedVehicle", Received], VehicleMode | None]
"""The mode that a frame puts the vehicle in; None where it changes nothing."""


class ScriptedVehicle(InboxBus):
    """A `Bus` whose other end drives along +x: a pose every 10 ms, a status every 20 ms."""

    description = "scripted vehicle"

    def __init__(self, dbc: Path, clock: Clock, obey: Obey) -> None:
        super().__init__()
        database = cantools.database.load_file(dbc)
        assert isinstance(database, Database)
        self._database, self._clock, self._obey = database, clock, obey
        self.mode = VehicleMode.READY
        self.brake = False
        self.sends_status = True
        self.handshake = 0
        self.x_m = self.speed_mps = 0.0
        self.received: list[Received] = []
        self._accel_mps2 = 0.0
        self._tick = 0

    def open(self) -> "ScriptedVehicle":
        return self

    def wait(self, until_ns: int) -> bool:
        while not self.inbox:
            due_ns = START_NS + self._tick * ms(10)
            if due_ns > until_ns:
                self._clock.sleep_until(until_ns)
                break
            self._clock.sleep_until(due_ns)
            self._advance()
        return bool(self.inbox)

    def send(self, *frames: CanFrame) -> int:
        for frame in frames:
            message = self._database.get_message_by_frame_id(frame.can_id)
            signals = message.decode_simple(frame.data, decode_choices=False, allow_truncated=False)
            got = Received(self._clock.t_ns, message.name, {name: float(str(value)) for name, value in signals.items()})
            self.received.append(got)
            self.mode = self._obey(self, got) or self.mode
            self._accel_mps2 = got.signals.get("ACC", self._accel_mps2)
        return len(frames)

    def _advance(self) -> None:
        if self.mode is VehicleMode.AUTONOMOUS:
            self.speed_mps = max(0.0, self.speed_mps + 0.01 * self._accel_mps2)
        self.x_m += 0.01 * self.speed_mps
        if self.brake and self.mode is VehicleMode.AUTONOMOUS:
            self.mode = VehicleMode.MANUAL
        if self.sends_status and self._tick % 2 == 0:
            alive = self._tick // 2 % 256
            self._send("STATUS", MODE=self.mode, BRAKE=self.brake, HANDSHAKE=self.handshake, ALIVE=alive)
        self._send("POSE", X=self.x_m, Y=0.0, YAW=0.0, V=self.speed_mps)
        self._tick += 1

    def _send(self, name: str, **signals: float) -> None:
        message = self._database.get_message_by_name(name)
        data = message.encode({signal: float(value) for signal, value in signals.items()})
        self.inbox.append(CanFrame(message.frame_id, bytes(data), self._clock.t_ns))


class ScriptedDrive:
    """A loop and a scripted vehicle."""

    def __init__(self, database: VehicleDatabase, obey: Obey, *, armed: bool = True) -> None:
        self.clock = Clock()
        self.vehicle = ScriptedVehicle(Path(database.profile.dbc), self.clock, obey)
        self.loop = compose.build_loop(
            database=database,
            open_bus=self.vehicle.open,
            controller=pure_pursuit(),
            source=FixedTrajectory(straight()),
            telemetry=None,
            armed=armed,
            now_ns=self.clock.now_ns,
            sleep_until=self.clock.sleep_until,
        )

    def mode(self) -> Mode:
        return self.loop._engagement.mode

    def run_s(self, seconds: float) -> None:
        end_ns = self.clock.t_ns + ns_from_s(seconds)
        while self.clock.t_ns < end_ns and not self.loop.shutdown.is_done:
            self.loop.step()

    def run_until(self, mode: Mode, within_s: float = 3.0) -> None:
        end_ns = self.clock.t_ns + ns_from_s(within_s)
        while self.mode() is not mode:
            self.loop.step()
            assert self.clock.t_ns <= end_ns, f"{self.mode().name} {self.loop.reason.name}"

    def named(self, name: str, since_ns: int = 0) -> list[Received]:
        return [one for one in self.vehicle.received if one.name == name and one.at_ns >= since_ns]
