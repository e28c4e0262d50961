"""Two ends of a bus in this process, wired back to back: for tests and for the embedded demo."""

from collections import deque
from collections.abc import Callable

from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame

ROOM_FRAMES = 278
"""What a default SocketCAN receive buffer holds; a full end keeps the oldest, as the kernel does."""


class MemoryBus:
    """One end; what it sends comes out at the other, stamped by the given clock.

    `sleep` is how `wait` passes time: `clock.sleep_until` in a process, a virtual clock's in tests.
    """

    def __init__(self, now_ns: Callable[[], int], sleep: Callable[[int], None], description: str) -> None:
        self.description = description
        self._now_ns = now_ns
        self._sleep = sleep
        self._inbox: deque[CanFrame] = deque()
        self._peer: MemoryBus | None = None
        self._counters = {"received": 0, "sent": 0, "send_no_room": 0}

    @classmethod
    def pair(
        cls,
        now_ns: Callable[[], int],
        sleep: Callable[[int], None],
        description: str = "memory bus",
    ) -> tuple["MemoryBus", "MemoryBus"]:
        """Two ends that hear each other."""
        one, other = cls(now_ns, sleep, description), cls(now_ns, sleep, description)
        one._peer, other._peer = other, one
        return one, other

    def wait(self, until_ns: int) -> bool:
        """Sleep until `until_ns` unless there is a frame already; nobody else runs meanwhile to send one."""
        if not self._inbox:
            self._sleep(until_ns)
        return bool(self._inbox)

    def drain(self) -> list[CanFrame]:
        """All frames that the other end has sent since the last call."""
        frames = list(self._inbox)
        self._inbox.clear()
        self._counters["received"] += len(frames)
        return frames

    def has_room(self) -> bool:
        """Always: what is sent is at the other end at once."""
        return True

    def send(self, *frames: CanFrame) -> int:
        """Put the frames into the other end's inbox; `BusError` when either end is closed."""
        if self._peer is None or self._peer._peer is None:
            raise BusError(f"{self.description}: the other end is closed")
        taken = frames[: ROOM_FRAMES - len(self._peer._inbox)]
        self._peer._inbox.extend(frame._replace(stamp_ns=self._now_ns()) for frame in taken)
        self._counters["sent"] += len(taken)
        self._counters["send_no_room"] += len(taken) < len(frames)
        return len(taken)

    def counters(self) -> dict[str, int]:
        """Frames received, sent, and refused because the other end was full."""
        return dict(self._counters)

    def close(self) -> None:
        """Cut the wire."""
        self._peer = None
