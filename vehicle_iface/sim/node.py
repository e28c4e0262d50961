"""The simulated vehicle on a real bus: waits for frames or the next due instant, whichever comes first."""

import logging
from collections.abc import Callable
from typing import Protocol

from vehicle_iface import clock as machine
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.sim.driver_commands import execute
from vehicle_iface.sim.driver_socket import DriverSocket
from vehicle_iface.sim.vehicle import SimulatedVehicle
from vehicle_iface.units import NS_PER_MS

log = logging.getLogger(__name__)

PAUSE_NS = 20 * NS_PER_MS
"""A pass this late after its due instant means that the process, or the whole machine, was not scheduled."""
REOPEN_EVERY_NS = 100 * NS_PER_MS
"""Period of attempts to reopen a lost bus."""


class VehicleBus(Protocol):
    """The part of a bus that the vehicle needs; `BusError` means that the link is gone."""

    def wait(self, until_ns: int) -> bool:
        """Sleep until a frame is received or the clock reaches `until_ns`."""
        ...

    def drain(self) -> list[CanFrame]:
        """Return all received frames, oldest first."""
        ...

    def send(self, *frames: CanFrame) -> int:
        """Send frames without waiting; return how many were accepted, the others are lost."""
        ...

    def close(self) -> None:
        """Close the bus."""
        ...


def run_vehicle(
    vehicle: SimulatedVehicle,
    bus: VehicleBus,
    driver: DriverSocket | None,
    clock: Callable[[], int],
    stop: Callable[[], bool],
    *,
    reopen: Callable[[], VehicleBus] | None = None,
    sleep_until: Callable[[int], None] = machine.sleep_until,
) -> None:
    """Run the vehicle until `stop()` is true; at the end the bus is closed, the driver socket is not.

    A lost bus ends this with `BusError`, unless `reopen` is given: then the vehicle continues, like
    one with a cut cable, and tries to reopen the bus every 100 ms. The driver socket is polled each pass.
    """
    line = _Line(bus, reopen, clock, sleep_until)
    try:
        while not stop():
            _run_pass(vehicle, line, driver, clock)
    finally:
        line.close()


def _run_pass(vehicle: SimulatedVehicle, line: "_Line", driver: DriverSocket | None, clock: Callable[[], int]) -> None:
    """Receive, execute the driver's commands, send: commands received in time count before the watchdog checks."""
    due_ns = vehicle.next_due_ns
    frames = line.receive(due_ns)
    now_ns = clock()
    if now_ns - due_ns > PAUSE_NS:
        vehicle.extend_watchdog(now_ns - due_ns)
    for frame in frames:
        vehicle.receive(frame, now_ns)
    if driver is not None:
        driver.poll(lambda text: execute(vehicle, text))
    for frame in vehicle.advance(now_ns):
        vehicle.counters["unsent"] += not line.send(frame)


class _Line:
    """The bus while it is open."""

    def __init__(
        self,
        bus: VehicleBus,
        reopen: Callable[[], VehicleBus] | None,
        clock: Callable[[], int],
        sleep_until: Callable[[int], None],
    ) -> None:
        self._bus: VehicleBus | None = bus
        self._reopen, self._clock, self._sleep_until = reopen, clock, sleep_until
        self._retry_ns = 0

    def receive(self, until_ns: int) -> list[CanFrame]:
        if self._bus is None:
            self._sleep_until(until_ns)
            self._try_again()
            return []
        try:
            self._bus.wait(until_ns)
            return self._bus.drain()
        except BusError as error:
            self._lose(error)
            return []

    def send(self, frame: CanFrame) -> bool:
        if self._bus is None:
            return False
        try:
            return self._bus.send(frame) == 1
        except BusError as error:
            self._lose(error)
            return False

    def close(self) -> None:
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def _lose(self, error: BusError) -> None:
        self.close()
        if self._reopen is None:
            raise error
        log.warning("the simulated vehicle lost its link: %s", error)
        self._retry_ns = self._clock() + REOPEN_EVERY_NS

    def _try_again(self) -> None:
        now_ns = self._clock()
        if self._reopen is None or now_ns < self._retry_ns:
            return
        self._retry_ns = now_ns + REOPEN_EVERY_NS
        try:
            self._bus = self._reopen()
        except BusError:
            return  # reported when it was lost
        log.warning("the simulated vehicle's link is open again")
