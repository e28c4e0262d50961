"""The vehicle's loop over a bus: frames and time in order, nothing lost but what the bus loses."""

import itertools
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.contract_frames import pack, unpack
from tests.narrowing import at_present
from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.driver_socket import DriverSocket
from vehicle_iface.sim.node import run_vehicle
from vehicle_iface.sim.vehicle import SimulatedVehicle
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.status import VehicleMode

from .harness import MS, START_NS


class World:
    """Virtual time and a bus on it: frames that come at given instants, and everything that was sent when."""

    def __init__(self) -> None:
        self.now_ns = START_NS
        self.coming: list[CanFrame] = []
        self.sent: list[tuple[int, CanFrame]] = []
        self.late_ns: dict[int, int] = {}
        """Turn number → how late the machine is on it."""
        self.down = False
        self.has_room = True
        self.turns = 0
        self.closed = 0

    def clock(self) -> int:
        return self.now_ns

    def sleep_until(self, until_ns: int) -> None:
        self.turns += 1
        self.now_ns = max(self.now_ns, until_ns)

    def wait(self, until_ns: int) -> bool:
        if self.down:
            raise BusError("vcan0: Network is down")
        first_ns = min((frame.stamp_ns for frame in self.coming), default=until_ns)
        self.sleep_until(min(first_ns, until_ns))
        self.now_ns += self.late_ns.pop(self.turns, 0)
        return first_ns <= self.now_ns

    def drain(self) -> list[CanFrame]:
        come = [frame for frame in self.coming if frame.stamp_ns <= self.now_ns]
        self.coming = self.coming[len(come) :]
        return come

    def send(self, *frames: CanFrame) -> int:
        if self.down:
            raise BusError("vcan0: Network is down")
        if not self.has_room:
            return 0
        self.sent += [(self.now_ns, frame) for frame in frames]
        return len(frames)

    def close(self) -> None:
        self.closed += 1

    def until_ms(self, ms: int) -> Callable[[], bool]:
        return lambda: self.now_ns >= START_NS + ms * MS


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture
def vehicle() -> SimulatedVehicle:
    return simulated_vehicle(load_database(load_profile("reference")), start_ns=START_NS)


@pytest.fixture
def driver(tmp_path: Path) -> Iterator[DriverSocket]:
    driver = DriverSocket(str(tmp_path / "p.sock"))
    yield driver
    driver.close()


def run(world: World, vehicle: SimulatedVehicle, ms: int, driver: DriverSocket | None = None) -> None:
    run_vehicle(vehicle, world, driver, world.clock, world.until_ms(ms), sleep_until=world.sleep_until)


def commands(first_ms: int, last_ms: int) -> list[CanFrame]:
    frames = []
    for i, ms in enumerate(range(first_ms, last_ms, 10)):
        for name in ("DRIVE_COMMAND", "STEER_COMMAND"):
            frame = pack(name, i % 15, ENABLE=1)
            frames.append(CanFrame(frame.can_id, frame.data, START_NS + ms * MS))
    return frames


def pose_times_ms(world: World) -> list[float]:
    return [(ns - START_NS) / MS for ns, frame in world.sent if frame.can_id == 0x110]


def test_samples_leave_on_the_grid_while_commands_come_between(world: World, vehicle: SimulatedVehicle) -> None:
    world.coming = commands(3, 500)
    run(world, vehicle, 500)
    assert pose_times_ms(world) == [10.0 * i for i in range(len(pose_times_ms(world)))]
    assert len(pose_times_ms(world)) >= 50
    assert vehicle.mode is VehicleMode.AUTONOMOUS
    assert vehicle.counters["overruns"] == 0


def test_one_late_turn_does_not_shift_the_grid(world: World, vehicle: SimulatedVehicle) -> None:
    world.late_ns[5] = 34 * MS
    run(world, vehicle, 200)
    times = pose_times_ms(world)
    assert times[:7] == [0, 10, 20, 30, 74, 80, 90]
    assert vehicle.counters["overruns"] == 3


def test_commands_that_waited_while_it_was_late_count_before_the_watchdog(
    world: World, vehicle: SimulatedVehicle
) -> None:
    world.coming = commands(0, 600)
    world.late_ns[20] = 250 * MS
    run(world, vehicle, 590)
    assert vehicle.counters["overruns"] >= 24
    assert vehicle.mode is VehicleMode.AUTONOMOUS


def test_silence_trips_the_watchdog_on_time(world: World, vehicle: SimulatedVehicle) -> None:
    world.coming = commands(0, 200)
    run(world, vehicle, 400)
    modes = [(ns - START_NS, unpack(frame)["MODE"]) for ns, frame in world.sent if frame.can_id == 0x100]
    assert next(at for at, mode in modes if mode == VehicleMode.FAULT) == 300 * MS


def test_a_driver_command_acts_within_a_tick(world: World, vehicle: SimulatedVehicle, driver: DriverSocket) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(5.0)
        client.connect(driver.path)
        client.sendall(b"fault 9\n")
        run(world, vehicle, 10, driver)
        assert client.recv(100) == b"ok\n"
    assert vehicle.mode is VehicleMode.FAULT


def test_a_bus_without_room_loses_frames_and_counts_them(world: World, vehicle: SimulatedVehicle) -> None:
    world.has_room = False
    run(world, vehicle, 95)
    assert vehicle.counters["unsent"] == vehicle.counters["frames"] == 11 * 3 + 6
    world.has_room = True
    run(world, vehicle, 110)
    assert len(world.sent) == 3


def test_the_bus_is_closed_at_the_end(world: World, vehicle: SimulatedVehicle) -> None:
    run(world, vehicle, 50)
    assert world.closed == 1


def test_a_lost_bus_ends_the_run_unless_it_can_be_reopened(world: World, vehicle: SimulatedVehicle) -> None:
    world.down = True
    with pytest.raises(BusError):
        run(world, vehicle, 50)
    assert world.closed == 1


def test_without_its_bus_the_vehicle_goes_on_and_sends_again_when_it_is_back(
    world: World, vehicle: SimulatedVehicle
) -> None:
    world.coming = commands(0, 100)
    run(world, vehicle, 100)
    assert at_present(vehicle.mode) is VehicleMode.AUTONOMOUS
    world.down = True
    tries: list[int] = []

    def reopen() -> World:
        tries.append(world.now_ns)
        if len(tries) < 4:
            raise BusError("vcan0: Network is down")
        world.down = False
        return world

    sent = len(world.sent)
    run_vehicle(vehicle, world, None, world.clock, world.until_ms(1000), reopen=reopen, sleep_until=world.sleep_until)
    assert vehicle.mode is VehicleMode.FAULT  # its watchdog acted with the cable cut
    assert [round((b - a) / MS) for a, b in itertools.pairwise(tries)] == [100, 100, 100]
    assert len(world.sent) > sent + 100


def test_a_vehicle_whose_process_was_not_scheduled_does_not_lose_its_commander(
    world: World, vehicle: SimulatedVehicle
) -> None:
    """A machine that stood still for 230 ms: the commander on it could not speak either."""
    world.coming = [*commands(0, 200), *commands(440, 600)]
    run(world, vehicle, 200)
    world.late_ns[world.turns + 1] = 230 * MS
    run(world, vehicle, 595)
    assert vehicle.mode is VehicleMode.AUTONOMOUS
    assert vehicle.counters["pauses"] == 1
