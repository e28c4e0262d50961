"""A commander and the vehicle, wired back to back in virtual time."""

from typing import Any

from vehicle_bus_contract.reference import DecodedFrame

from tests.contract_frames import intact, pack, unpack
from vehicle_iface.codec.database import load_database
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.driver_commands import execute
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.sim.vehicle import SimulatedVehicle
from vehicle_iface.sim.wire import simulated_vehicle

MS = 1_000_000
START_NS = 5_000_000_000


class VehicleHarness:
    """`now_ns` moves only when set; every frame that the vehicle sends is kept."""

    def __init__(self, start: BicycleState | None = None, **more: Any) -> None:
        self.now_ns = START_NS
        self.vehicle: SimulatedVehicle = simulated_vehicle(
            load_database(load_profile("reference")), start_ns=START_NS, start=start, **more
        )
        self.decoded: list[DecodedFrame] = []
        self.frames: list[CanFrame] = []
        self.drive_counter = 0
        self.steer_counter = 0

    def wait_ms(self, ms: float) -> None:
        """Let time pass; the vehicle gets its turn whenever it is due, as on a machine that is never late."""
        end_ns = self.now_ns + round(ms * MS)
        while (due_ns := self.vehicle.next_due_ns) <= end_ns:
            self.now_ns = max(self.now_ns, due_ns)
            self.tick()
        self.now_ns = end_ns

    def tick(self) -> list[DecodedFrame]:
        """One turn of the vehicle, now."""
        frames = self.vehicle.advance(self.now_ns)
        decoded = [unpack(frame) for frame in frames]
        self.frames += frames
        self.decoded += decoded
        return decoded

    def drive(self, **signals: float) -> None:
        """One DRIVE_COMMAND, enabled unless said otherwise."""
        self.drive_counter = (self.drive_counter + 1) % 15
        self.receive(pack("DRIVE_COMMAND", self.drive_counter, **{"ENABLE": 1, "GEAR_REQUEST": 7} | signals))

    def steer(self, **signals: float) -> None:
        """One STEER_COMMAND, enabled unless said otherwise."""
        self.steer_counter = (self.steer_counter + 1) % 15
        self.receive(pack("STEER_COMMAND", self.steer_counter, **{"ENABLE": 1} | signals))

    def pair(self, angle_rad: float = 0.0, enable: int = 1, **signals: float) -> None:
        """One command pair."""
        self.drive(ENABLE=enable, **signals)
        self.steer(ENABLE=enable, FRONT_WHEEL_ANGLE_REQUEST=angle_rad)

    def receive(self, frame: CanFrame) -> None:
        self.vehicle.receive(frame._replace(stamp_ns=self.now_ns), self.now_ns)

    def command_for_ms(self, ms: float, **pair: Any) -> None:
        """A pair each 10 ms."""
        for _ in range(round(ms / 10)):
            self.pair(**pair)
            self.wait_ms(10)

    def engage(self, gear: float = 3) -> None:
        """Three pairs, and a fourth that the vehicle already obeys."""
        self.command_for_ms(40, GEAR_REQUEST=gear)
        assert self.vehicle.mode.name == "AUTONOMOUS"
        assert self.vehicle.gear == gear

    def send_line(self, line: str) -> str:
        return execute(self.vehicle, line)

    def are_intact(self, *names: str) -> list[bool]:
        """Whether each frame was intact: of the named messages, or of all."""
        pairs = zip(self.frames, self.decoded, strict=True)
        return [intact(frame) is not None for frame, decoded in pairs if not names or decoded.name in names]

    def last(self, name: str) -> DecodedFrame:
        """The newest frame of that name."""
        return next(decoded for decoded in reversed(self.decoded) if decoded.name == name)
