"""Devices without a process, for a rig in virtual time: the program's loop, and the minimal controller."""

import signal
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import minimal_controller
from minimal_route import read_route
from vehicle_bus_contract.reference import S
from virtual_drive import BenchBus

from vehicle_iface import compose
from vehicle_iface.cli.exit_status import BAD_USAGE, DONE, LATCHED_FAULT, NO_BUS
from vehicle_iface.codec.database import load_database
from vehicle_iface.drivable import load_trajectory
from vehicle_iface.errors import BusError, VehicleIfaceError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.trajectories.source import FixedTrajectory


class VirtualDevice(ABC):
    """What a rig asks of a device."""

    is_started = True

    def __init__(self, log: Path) -> None:
        self.log = log
        self.status: int | None = None
        self.is_paused = False

    def start(self, *, armed: bool = True, recorded: bool = False, open_files: int = 0) -> None:
        """It may end at once, with the status that the program would end with."""
        assert not recorded
        assert not open_files
        self.status = self.build(is_armed=armed)

    @abstractmethod
    def build(self, *, is_armed: bool) -> int | None:
        """Make it; an exit status where it refuses to start."""

    @abstractmethod
    def step(self) -> None:
        """Wait for frames, and process them."""

    @abstractmethod
    def rearm(self) -> None:
        """As SIGUSR1."""

    @abstractmethod
    def stop(self) -> None:
        """As SIGINT."""

    def poll(self) -> int | None:
        """Its exit status."""
        return self.status

    def send(self, number: signal.Signals) -> None:
        """What a process would do on these signals."""
        if number is signal.SIGKILL:
            self.status = -signal.SIGKILL
        elif number in (signal.SIGSTOP, signal.SIGCONT):
            self.is_paused = number is signal.SIGSTOP
        else:
            assert number in (signal.SIGINT, signal.SIGTERM)
            self.stop()

    def kill(self) -> list[str]:
        """Nothing is left of it."""
        return []


class LoopDevice(VirtualDevice):
    """The program's loop."""

    def __init__(self, profile: str, bus: BenchBus, trajectory: Path, log: Path) -> None:
        super().__init__(log)
        self._profile, self._bus, self._trajectory = profile, bus, trajectory

    def build(self, *, is_armed: bool) -> int | None:
        try:
            database = load_database(load_profile(self._profile))
            self.loop = compose.build_loop(
                database=database,
                open_bus=self._bus.open,
                controller=compose.build_controller("pure_pursuit", database.profile),
                source=FixedTrajectory(load_trajectory(str(self._trajectory), database.profile)),
                telemetry=None,
                armed=is_armed,
                now_ns=lambda: self._bus.now_ns,
                sleep_until=self._bus.pass_until,
            )
        except VehicleIfaceError as error:
            self.log.write_text(f"{error}\n", encoding="utf-8")
            return NO_BUS if isinstance(error, BusError) else BAD_USAGE
        return None

    def step(self) -> None:
        self.loop.step()
        if self.loop.shutdown.is_done:
            self.status = LATCHED_FAULT if self.loop.shutdown.ended_in_fault else DONE

    def rearm(self) -> None:
        self.loop.arming.request()

    def stop(self) -> None:
        self.loop.shutdown.request()


class MinimalDevice(VirtualDevice):
    """The minimal controller, with a defect or without."""

    def __init__(self, bus: BenchBus, trajectory: Path, log: Path, defect: str = "") -> None:
        super().__init__(log)
        self._bus, self._trajectory, self._defect = bus, trajectory, defect

    def build(self, *, is_armed: bool) -> int | None:
        vars(minimal_controller).update(
            ready=lambda raw, _event, within_s: self._wait(raw, within_s), Bus=lambda _channel: _RawBus(self._bus)
        )
        try:
            route = read_route(self._trajectory)
            self._controller = minimal_controller.Controller("virtual", route, is_armed=is_armed, defect=self._defect)
        except (OSError, ValueError) as error:
            self.log.write_text(f"{error}\n", encoding="utf-8")
            return NO_BUS if isinstance(error, OSError) else BAD_USAGE
        return None

    def step(self) -> None:
        self._controller.step()
        if self._controller.is_over:
            self.status = self._controller.exit_status

    def rearm(self) -> None:
        self._controller.orders.append(signal.SIGUSR1)

    def stop(self) -> None:
        self._controller.orders.append(signal.SIGINT)

    def _wait(self, raw: object, within_s: float) -> bool:
        until_ns = self._bus.now_ns + max(0, round(within_s * S))
        if raw is not None and self._bus.is_up:
            return self._bus.wait(until_ns)
        self._bus.pass_until(until_ns)
        return False


class _RawBus:
    """The minimal controller's socket."""

    def __init__(self, bus: BenchBus) -> None:
        _check(bus.check_link)
        self._bus = bus
        self.raw = SimpleNamespace(close=bus.close)

    def received(self) -> list[tuple[int, bytes]]:
        """Of its identifiers, as its filters and its decoder let them pass."""
        _check(self._bus.check_link)
        return [
            (frame.can_id, frame.data)
            for frame in self._bus.drain()
            if frame.can_id in minimal_controller.RECEIVED
            and len(frame.data) == 8
            and not (frame.is_extended or frame.is_remote or frame.is_fd)
        ]

    def has_room(self) -> bool:
        return self._bus.has_room()

    def send(self, can_id: int, data: bytes) -> bool:
        _check(lambda: self._bus.send(CanFrame(can_id, data)))
        return True


def _check(call: Callable[[], object]) -> None:
    """Raises `OSError` where the bus is down."""
    try:
        call()
    except BusError as error:
        raise OSError(str(error)) from None
