"""A simulated vehicle in the loop's own process, for machines without a CAN bus."""

from collections.abc import Callable

from vehicle_iface.frame import CanFrame
from vehicle_iface.sim.vehicle import SimulatedVehicle


class EmbeddedBus:
    """A `Bus` whose other end is a simulated vehicle; the vehicle moves while the loop waits.

    `now_ns` and `sleep_until` are the machine's clock in the demo and a virtual one in tests.
    """

    description = "embedded bus (simulated vehicle in the loop's process)"

    def __init__(
        self, vehicle: SimulatedVehicle, now_ns: Callable[[], int], sleep_until: Callable[[int], None]
    ) -> None:
        self.vehicle = vehicle
        self._now_ns, self._sleep_until = now_ns, sleep_until
        self._inbox: list[CanFrame] = []
        self._counters = {"received": 0, "sent": 0}

    def wait(self, until_ns: int) -> bool:
        """Advance the vehicle until it sends a frame or `until_ns` is reached."""
        while not self._inbox:
            due_ns = min(until_ns, self.vehicle.next_due_ns)
            self._sleep_until(due_ns)
            self._advance()
            if due_ns >= until_ns:
                break
        return bool(self._inbox)

    def drain(self) -> list[CanFrame]:
        """Return the frames that the vehicle has sent."""
        frames, self._inbox = self._inbox, []
        self._counters["received"] += len(frames)
        return frames

    def has_room(self) -> bool:
        """Return true: the vehicle receives at once."""
        return True

    def send(self, *frames: CanFrame) -> int:
        """Hand the frames to the vehicle; all are accepted."""
        now_ns = self._now_ns()
        for frame in frames:
            self.vehicle.receive(frame, now_ns)
        self._counters["sent"] += len(frames)
        return len(frames)

    def counters(self) -> dict[str, int]:
        """Return the frames received and sent."""
        return dict(self._counters)

    def close(self) -> None:
        """Do nothing: there are no resources to release."""

    def _advance(self) -> None:
        now_ns = self._now_ns()
        for frame in self.vehicle.advance(now_ns):
            self._inbox.append(frame._replace(stamp_ns=now_ns))
