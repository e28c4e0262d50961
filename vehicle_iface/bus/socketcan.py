"""A SocketCAN interface through raw sockets of our own.

Own sockets and not python-can's reader: they give the kernel's receive stamp and the count of frames that the kernel
had to drop, tell an error from silence, and cost one system call for a frame.
"""

import errno
import fcntl
import select
import socket
import struct
from collections.abc import Iterable

from vehicle_iface import clock
from vehicle_iface.bus.error_frames import LinkEvent, events_of
from vehicle_iface.bus.receive import BATCH, CANFD_MTU, MSG_DONTWAIT, SO_RXQ_OVFL, SO_TIMESTAMPNS, BatchReceiver, Packet
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.units import NS_PER_MS

# From <linux/can.h>, <linux/can/raw.h> and <linux/sockios.h>.
EFF_FLAG, RTR_FLAG, ERR_FLAG = 0x80000000, 0x40000000, 0x20000000
EFF_MASK, SFF_MASK, ERR_MASK = 0x1FFFFFFF, 0x7FF, 0x1FFFFFFF
CAN_RAW_ERR_FILTER = 2
CANFD_BRS = 0x01
SIOCGIFFLAGS, IFF_UP = 0x8913, 0x1

RECEIVE_BUFFER_BYTES = 1 << 20
"""Room for some 3,600 queued frames where the kernel allows it; the default holds 278."""
SEND_BUFFER_BYTES = 1
"""The kernel's least (some 7 frames): what a dead bus has not taken by then is refused here and never sent late."""
CLOCK_STEP_NS = 5 * NS_PER_MS
"""A wall clock that moves this far against the monotonic one between two readings was stepped."""

_HEADER = struct.Struct("=IBB2x")
_TIMEVAL = struct.Struct("@ll")
_REFUSED = (errno.ENOBUFS, errno.EAGAIN, errno.EINTR)


class SocketCanBus:
    """One SocketCAN interface, classical and FD, filtered by the kernel to the identifiers asked for.

    A frame of the right identifier but the wrong kind (remote, extended, FD) does come through, so that it is
    refused by the decoder, where it is counted. A second socket watches the link: error frames, and our own frames
    as they come by once they were sent.
    """

    def __init__(
        self, channel: str, can_ids: Iterable[int], *, own_ids: Iterable[int] = (), patience_ns: int | None = None
    ) -> None:
        """Hear `can_ids`; take note of `own_ids` when they were sent.

        With `patience_ns`, `wait` is one call that sleeps and receives, for at most so long (in the kernel's ticks,
        up to 10 ms more), whatever it was told: one system call a frame, for a reader that lives on arrivals.
        Without it, `wait` ends within 1 ms after the instant that it was told.
        """
        self.channel = channel
        self.description = f"SocketCAN {channel}"
        self._counters = {
            "received": 0,
            "sent": 0,
            "send_no_room": 0,
            "send_confirmed": 0,
            "receive_overflow": 0,
            "wall_clock_steps": 0,
            "error_frames": 0,
        }
        self._offset_ns = clock.monotonic_ns() - clock.wall_ns()
        self._kernel_drops = 0
        self._inbox: list[CanFrame] = []
        self._waits_in_receive = patience_ns is not None
        self._socket = _opened(channel, sorted(set(can_ids)))
        try:
            self._watch = _opened(channel, sorted(set(own_ids)), errors=True)
        except BaseException:
            self._socket.close()
            raise
        self._receiver, self._watcher = BatchReceiver(self._socket.fileno()), BatchReceiver(self._watch.fileno())
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        if patience_ns is not None:
            timeout = _TIMEVAL.pack(*divmod(patience_ns // 1000, 1_000_000))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeout)

    def wait(self, until_ns: int) -> bool:
        """Sleep until a frame has come, or until `until_ns` (see the class for how exactly)."""
        if self._inbox:
            return True
        remaining_ns = until_ns - clock.monotonic_ns()
        if self._waits_in_receive and remaining_ns > 0:
            self._take(wait=True)
            return bool(self._inbox)
        return bool(self._poll.poll(max(0, -(-remaining_ns // NS_PER_MS))))

    def drain(self) -> list[CanFrame]:
        """All queued frames, stamped with the kernel's receive time on the monotonic clock."""
        if not self._inbox:
            self._take(wait=False)
        frames, self._inbox = self._inbox, []
        return frames

    def send(self, frame: CanFrame) -> bool:
        """Hand one frame to the kernel's transmit queue, without waiting; false when that is full."""
        try:
            self._socket.send(packed(frame), MSG_DONTWAIT)
        except OSError as error:
            if error.errno not in _REFUSED:
                raise self._gone(error) from error
            self._counters["send_no_room"] += 1
            return False
        self._counters["sent"] += 1
        return True

    def events(self) -> list[LinkEvent]:
        """What the controller hardware reported since the last call; counts our own frames as confirmed, too."""
        events: list[LinkEvent] = []
        for packet in self._received(self._watcher, wait=False):
            frame = unpacked(packet.data, 0)
            if frame.is_error:
                self._counters["error_frames"] += 1
                events += events_of(_HEADER.unpack_from(packet.data)[0] & ERR_MASK, frame.data)
            elif packet.is_local:
                self._counters["send_confirmed"] += 1
        return events

    def counters(self) -> dict[str, int]:
        """Frames received, sent, refused by a full queue, seen on the bus, dropped by the kernel; clock steps."""
        return dict(self._counters)

    def close(self) -> None:
        """Close the sockets."""
        self._socket.close()
        self._watch.close()

    def _take(self, *, wait: bool) -> None:
        """Receive into the inbox until the kernel has no more."""
        packets = self._received(self._receiver, wait=wait)
        while packets:
            self._follow_wall_clock()
            now_ns = clock.monotonic_ns()
            self._inbox += [self._frame(packet, now_ns) for packet in packets]
            self._counters["received"] += len(packets)
            packets = self._received(self._receiver, wait=False) if len(packets) == BATCH else []

    def _received(self, receiver: BatchReceiver, *, wait: bool) -> list[Packet]:
        try:
            return receiver.receive(wait=wait)
        except OSError as error:
            raise self._gone(error) from error

    def _frame(self, packet: Packet, now_ns: int) -> CanFrame:
        # Never later than now: a wall clock set forwards between the stamp and our reading of it would make an old
        # frame look fresh.
        stamp_ns = min(now_ns, packet.wall_ns + self._offset_ns) if packet.wall_ns else now_ns
        if packet.dropped is not None:
            self._counters["receive_overflow"] += (packet.dropped - self._kernel_drops) & 0xFFFFFFFF
            self._kernel_drops = packet.dropped
        return unpacked(packet.data, stamp_ns)

    def _follow_wall_clock(self) -> None:
        """Kernel stamps are wall-clock time: map them by the offset that holds now."""
        offset_ns = clock.monotonic_ns() - clock.wall_ns()
        if abs(offset_ns - self._offset_ns) > CLOCK_STEP_NS:
            self._counters["wall_clock_steps"] += 1
        self._offset_ns = offset_ns

    def _gone(self, error: OSError) -> BusError:
        if error.errno == errno.EINVAL:
            return BusError(f"{self.channel}: takes no CAN FD frames; `sudo ip link set {self.channel} mtu 72`")
        return BusError(f"{self.channel}: {error.strerror}; check `ip -details link show {self.channel}`")


def packed(frame: CanFrame) -> bytes:
    """`frame` as the kernel's struct can_frame or canfd_frame."""
    can_id = frame.can_id | (EFF_FLAG if frame.is_extended else 0) | (RTR_FLAG if frame.is_remote else 0)
    if frame.is_fd:
        return _HEADER.pack(can_id, len(frame.data), CANFD_BRS) + frame.data.ljust(64, b"\0")
    return _HEADER.pack(can_id, len(frame.data), 0) + frame.data.ljust(8, b"\0")


def unpacked(data: bytes, stamp_ns: int) -> CanFrame:
    """The kernel's struct can_frame or canfd_frame as a frame."""
    word, length, _ = _HEADER.unpack_from(data)
    is_extended = bool(word & EFF_FLAG)
    return CanFrame(
        word & (EFF_MASK if is_extended else SFF_MASK),
        data[_HEADER.size : _HEADER.size + length],
        stamp_ns,
        is_extended,
        bool(word & RTR_FLAG),
        len(data) == CANFD_MTU,
        bool(word & ERR_FLAG),
    )


def _opened(channel: str, can_ids: list[int], *, errors: bool = False) -> socket.socket:
    """A raw socket on an interface that is up; `BusError` with the mending command."""
    if not hasattr(socket, "AF_CAN"):
        raise BusError("this system has no SocketCAN; use --interface with a python-can adapter, or the demo")
    try:
        raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        raise BusError(
            f"this kernel has no SocketCAN ({error.strerror}); `sudo modprobe can_raw`, or tools/vcan"
        ) from error
    try:
        # Exact identifiers over all 29 bits; the flags are left open (see the class).
        filters = b"".join(struct.pack("=II", can_id, EFF_MASK) for can_id in can_ids)
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
        raw.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, _UINT32.pack(ERR_MASK if errors else 0))
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        raw.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        raw.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        _bind_up(raw, channel)
    except BaseException:
        raw.close()
        raise
    return raw


_UINT32 = struct.Struct("=I")


def _bind_up(raw: socket.socket, channel: str) -> None:
    """Bind to an interface that exists, carries CAN and is up."""
    try:
        raw.bind((channel,))
        request = struct.pack("16sH22x", channel.encode(), 0)
        flags = struct.unpack_from("16xH", fcntl.ioctl(raw, SIOCGIFFLAGS, request))[0]
    except OSError as error:
        how = f"`sudo ip link add dev {channel} type vcan`" if channel.startswith("vcan") else "`ip link` lists them"
        raise BusError(f"{channel}: no such CAN interface ({error.strerror}); {how}") from error
    if not flags & IFF_UP:
        setup = "" if channel.startswith("vcan") else " type can bitrate 500000"
        raise BusError(f"{channel}: the interface is down; `sudo ip link set {channel} up{setup}`")
