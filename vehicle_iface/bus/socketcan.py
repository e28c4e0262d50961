"""A SocketCAN interface, through raw sockets.

Raw sockets instead of python-can's reader: they give the kernel's receive stamp and the count of frames that the kernel
had to drop, distinguish an error from silence, and cost one system call for a frame.
"""

import select
import socket
import struct
from collections.abc import Iterable
from contextlib import ExitStack

from vehicle_iface import clock
from vehicle_iface.bus.base import add_bus_name
from vehicle_iface.bus.controller_events import ControllerEvent, parse_error_frame
from vehicle_iface.bus.frame_io import open_receiver, open_sender
from vehicle_iface.bus.raw_socket import ERR_FLAG, ERR_MASK, count_unsent_bytes, gone_error, open_socket
from vehicle_iface.bus.receive import BATCH, BatchReceiver, Packet
from vehicle_iface.bus.traffic_monitor import TrafficMonitor, TrafficSample
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame, IdFilter
from vehicle_iface.units import NS_PER_MS

RECEIVE_BUFFER_BYTES = 1 << 20
"""Room for about 3,600 queued frames where the kernel allows it; the default holds 278."""
CONFIRMED_WITHIN_NS = 50 * NS_PER_MS
"""A sent frame that is not seen on the bus within this time counts as missed."""
CLOCK_STEP_NS = 5 * NS_PER_MS
"""A wall clock that moves this far against the monotonic clock between two readings counts as stepped."""

_TIMEVAL = struct.Struct("@ll")


class SocketCanBus:
    """One SocketCAN interface, classical and FD, filtered by the kernel to the identifiers asked for.

    A frame of the right identifier but the wrong kind (remote, extended, FD) is received, so that the decoder
    rejects and counts it. A second socket receives error frames and our own frames once they are on the bus. A third
    one samples all traffic.
    """

    def __init__(
        self,
        channel: str,
        can_ids: Iterable[int],
        *,
        own_ids: Iterable[int] = (),
        masked: Iterable[IdFilter] = (),
        bitrate: int,
        data_bitrate: int,
        receive_timeout_ns: int | None = None,
        name: str = "",
        number: int = 0,
    ) -> None:
        """Receive `can_ids` and `masked`; confirm frames of `own_ids` when they are seen on the bus.

        `name` and `number` identify one of several buses, in its errors and its frames.

        The bit rates, in bits per second, are for the bus load only: the interface has its own.

        With `receive_timeout_ns`, `wait` is one call that sleeps and receives, for at most this long (in the kernel's
        ticks, up to 10 ms more), whatever `until_ns` is: one system call a frame, for an event-driven reader. Without
        it, `wait` ends within 1 ms after `until_ns`.
        """
        self.channel = channel
        self._name = name
        self.description = f"SocketCAN {channel}"
        self._counters = {
            "received": 0,
            "sent": 0,
            "send_no_room": 0,
            "send_confirmed": 0,
            "send_missed": 0,
            "receive_overflow": 0,
            "wall_clock_steps": 0,
            "error_frames": 0,
        }
        self._offset_ns = clock.monotonic_ns() - clock.wall_ns()
        self._inbox: list[CanFrame] = []
        self._waits_in_receive = receive_timeout_ns is not None
        self._to_confirm, self._to_confirm_since_ns = 0, clock.monotonic_ns()
        with ExitStack() as unless_all_open:
            self._socket = unless_all_open.enter_context(
                open_socket(channel, can_ids, receive_bytes=RECEIVE_BUFFER_BYTES, masked=masked)
            )
            self._watch = unless_all_open.enter_context(
                open_socket(channel, own_ids, receive_bytes=RECEIVE_BUFFER_BYTES, errors=True)
            )
            self._traffic = TrafficMonitor(
                channel, bus=number, bitrate=bitrate, data_bitrate=data_bitrate, now_ns=clock.monotonic_ns()
            )
            self._sender = open_sender(self._socket.fileno())
            self._receiver = open_receiver(self._socket.fileno(), number)
            self._watcher = BatchReceiver(self._watch.fileno())
            unless_all_open.pop_all()
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        if receive_timeout_ns is not None:
            timeout = _TIMEVAL.pack(*divmod(receive_timeout_ns // 1000, 1_000_000))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeout)

    def fileno(self) -> int:
        """Return the descriptor of the receiving socket."""
        return self._socket.fileno()

    def wait(self, until_ns: int) -> bool:
        """Sleep until a frame is received, or until `until_ns` (see the class for how exactly)."""
        if self._inbox:
            return True
        remaining_ns = until_ns - clock.monotonic_ns()
        if self._waits_in_receive and remaining_ns > 0:
            self._take(wait=True)
            return bool(self._inbox)
        return bool(self._poll.poll(max(0, -(-remaining_ns // NS_PER_MS))))

    def drain(self) -> list[CanFrame]:
        """Return all queued frames, stamped with the kernel's receive time on the monotonic clock."""
        if not self._inbox:
            self._take(wait=False)
        frames, self._inbox = self._inbox, []
        return frames

    def has_room(self) -> bool:
        """Return whether the interface has taken all frames handed over; costs one system call."""
        try:
            if not count_unsent_bytes(self._socket):
                return True
        except OSError as error:
            raise self._gone(error) from error
        self._counters["send_no_room"] += 1
        return False

    def send(self, *frames: CanFrame) -> int:
        """Hand frames to the kernel's transmit queue in one call, without waiting; return how many it accepted."""
        try:
            sent = self._sender.send(frames)
        except OSError as error:
            raise self._gone(error) from error
        self._counters["sent"] += sent
        self._counters["send_no_room"] += sent < len(frames)
        return sent

    def events(self) -> list[ControllerEvent]:
        """Return what the controller hardware reported since the last call.

        Also counts our own frames: confirmed when seen on the bus, missed when not seen within
        `CONFIRMED_WITHIN_NS`.
        """
        events: list[ControllerEvent] = []
        packets = self._receive_watched()
        while packets:
            for can_id, data, _, _, _, is_local in packets:
                if can_id & ERR_FLAG:
                    self._counters["error_frames"] += 1
                    events += parse_error_frame(can_id & ERR_MASK, data)
                elif is_local:
                    self._counters["send_confirmed"] += 1
            packets = self._receive_watched() if len(packets) == BATCH else []
        self._count_missed(clock.monotonic_ns())
        return events

    def poll_traffic(self, now_ns: int) -> TrafficSample:
        """Return the traffic of all nodes since the last call."""
        try:
            return self._traffic.poll(now_ns)
        except OSError as error:
            raise self._gone(error) from error

    def counters(self) -> dict[str, int]:
        """Return the counts of frames (received, sent, no room, confirmed, missed, kernel drops) and clock steps."""
        return dict(self._counters)

    def close(self) -> None:
        """Close the sockets."""
        self._socket.close()
        self._watch.close()
        self._traffic.close()

    def _count_missed(self, now_ns: int) -> None:
        if now_ns - self._to_confirm_since_ns < CONFIRMED_WITHIN_NS:
            return
        missed = self._to_confirm - self._counters["send_confirmed"]
        self._counters["send_missed"] = max(missed, self._counters["send_missed"])
        self._to_confirm, self._to_confirm_since_ns = self._counters["sent"], now_ns

    def _take(self, *, wait: bool) -> None:
        """Receive into the inbox until the kernel has no more."""
        receiver = self._receiver
        try:
            count = receiver.receive(wait)
            while count:
                now_ns = clock.monotonic_ns()
                self._follow_wall_clock(now_ns - clock.wall_ns())
                self._counters["receive_overflow"] += receiver.take(self._inbox, self._offset_ns, now_ns)
                self._counters["received"] += count
                count = receiver.receive(False) if count == BATCH else 0
        except OSError as error:
            raise self._gone(error) from error

    def _receive_watched(self) -> list[Packet]:
        try:
            return self._watcher.receive(wait=False)
        except OSError as error:
            raise self._gone(error) from error

    def _gone(self, error: OSError) -> BusError:
        return add_bus_name(self._name, gone_error(self.channel, error))

    def _follow_wall_clock(self, offset_ns: int) -> None:
        """Kernel stamps are wall-clock time: map them by the offset that holds now."""
        if abs(offset_ns - self._offset_ns) > CLOCK_STEP_NS:
            self._counters["wall_clock_steps"] += 1
        self._offset_ns = offset_ns
