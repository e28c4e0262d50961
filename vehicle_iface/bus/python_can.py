"""CAN adapters supported by python-can (https://python-can.readthedocs.io/en/stable/interfaces.html)."""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import can

from vehicle_iface import clock
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame, IdFilter
from vehicle_iface.units import NS_PER_MS

INTERFACES: frozenset[str] = can.VALID_INTERFACES
"""Names of python-can's interfaces, including those of installed plugins."""
POLL_NS = NS_PER_MS // 2
"""Polling period of an adapter: python-can's own wait uses the wall clock, which may step."""
ECHO_NS = 100 * NS_PER_MS
"""An adapter that hands back what was sent through it does so within this time."""


class _Sent(NamedTuple):
    """A frame that may come back, and until when."""

    content: tuple[int, bool, bytes]
    until_ns: int


class PythonCanBus:
    """An adapter driven by python-can. Frames are stamped when they are read: adapters' clocks differ.

    Some adapters hand back what was sent through them (`udp_multicast`, slcan with local echo). Such a frame is not
    another node's and is left out: one of the same content for each that was sent, in their order, within `ECHO_NS`.
    """

    def __init__(
        self,
        interface: str,
        channel: str,
        can_ids: Iterable[int],
        *,
        masked: Iterable[IdFilter] = (),
        bitrate: int,
        is_fd: bool = False,
    ) -> None:
        self.description = f"python-can {interface} {channel}"
        self._counters = {"received": 0, "sent": 0, "send_no_room": 0, "error_frames": 0, "own_echoes": 0}
        self._may_echo: deque[_Sent] = deque()
        self._next: CanFrame | None = None
        # Filtered here: with its own filters python-can reports an empty queue at the first frame of another node.
        self._can_ids, self._masked = frozenset(can_ids), tuple(masked)
        try:
            self._bus = can.Bus(
                interface=interface,
                channel=channel,
                bitrate=bitrate,
                **({"fd": True} if is_fd else {}),  # type: ignore[arg-type]  # only adapters with FD know it
            )
        except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
            raise BusError(f"{self.description}: cannot be opened: {error}") from error

    def wait(self, until_ns: int) -> bool:
        """Poll the adapter every 0.5 ms until a frame is received or the clock reaches `until_ns`."""
        while self._next is None:
            self._next = self._read()
            now_ns = clock.monotonic_ns()
            if self._next is not None or now_ns >= until_ns:
                break
            clock.sleep_until(min(until_ns, now_ns + POLL_NS))
        return self._next is not None

    def drain(self) -> list[CanFrame]:
        """Return all frames that the adapter has received."""
        frames: list[CanFrame] = []
        frame = self._next or self._read()
        self._next = None
        while frame is not None:
            frames.append(frame)
            frame = self._read()
        self._counters["received"] += len(frames)
        return frames

    def _is_wanted(self, can_id: int) -> bool:
        return can_id in self._can_ids or any(one.matches(can_id) for one in self._masked)

    def has_room(self) -> bool:
        """Return true: python-can does not report the frames that an adapter has not sent yet."""
        return True

    def send(self, *frames: CanFrame) -> int:
        """Hand frames to the adapter, up to the first that it rejects; return how many it accepted."""
        for place, frame in enumerate(frames):
            if not self._send_one(frame):
                return place
        return len(frames)

    def counters(self) -> dict[str, int]:
        """Return the frames received, sent, rejected by the adapter and handed back by it, and the error frames."""
        return dict(self._counters)

    def close(self) -> None:
        """Release the adapter."""
        self._bus.shutdown()

    def _send_one(self, frame: CanFrame) -> bool:
        message = can.Message(
            arbitration_id=frame.can_id,
            data=frame.data,
            is_extended_id=frame.is_extended,
            is_fd=frame.is_fd,
            bitrate_switch=frame.is_fd,
            check=True,
        )
        try:
            self._bus.send(message, timeout=0)
        except can.CanOperationError:
            self._counters["send_no_room"] += 1
            return False
        except (can.CanError, OSError) as error:
            raise BusError(f"{self.description}: {error}") from error
        self._counters["sent"] += 1
        if self._is_wanted(frame.can_id):
            now_ns = clock.monotonic_ns()
            self._forget_sent(now_ns)
            self._may_echo.append(_Sent((frame.can_id, frame.is_extended, frame.data), now_ns + ECHO_NS))
        return True

    def _is_own_echo(self, message: can.Message) -> bool:
        """Whether the frame was sent through this adapter; each that was sent counts once."""
        if not message.is_rx:
            return True
        self._forget_sent(clock.monotonic_ns())
        content = (message.arbitration_id, message.is_extended_id, bytes(message.data))
        for place, sent in enumerate(self._may_echo):
            if sent.content == content:
                for _ in range(place + 1):
                    self._may_echo.popleft()
                return True
        return False

    def _forget_sent(self, now_ns: int) -> None:
        """Forget the frames whose echo is overdue: the record stays short where nothing comes back."""
        while self._may_echo and self._may_echo[0].until_ns < now_ns:
            self._may_echo.popleft()

    def _read(self) -> CanFrame | None:
        """Return the next queued data or remote frame; count and skip error frames."""
        while True:
            try:
                message = self._bus.recv(timeout=0)
            except (can.CanError, OSError) as error:
                raise BusError(f"{self.description}: {error}") from error
            if message is None:
                return None
            if message.is_error_frame:
                self._counters["error_frames"] += 1
            elif not self._is_wanted(message.arbitration_id):
                continue
            elif self._is_own_echo(message):
                self._counters["own_echoes"] += 1
            else:
                return CanFrame(
                    message.arbitration_id,
                    bytes(message.data),
                    clock.monotonic_ns(),
                    message.is_extended_id,
                    message.is_remote_frame,
                    message.is_fd,
                )
