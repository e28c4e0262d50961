"""A SocketCAN interface through one raw socket of our own.

Own socket and not python-can's reader: it gives the kernel's receive stamp and the count of frames that the
kernel had to drop, and it tells an error from silence.
"""

import errno
import fcntl
import select
import socket
import struct
from collections.abc import Iterable

from vehicle_iface import clock
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.units import NS_PER_MS, NS_PER_S

# From <asm-generic/socket.h>, <linux/can.h> and <linux/sockios.h>: Python does not export all of them.
SO_TIMESTAMPNS = 35
SO_RXQ_OVFL = 40
SIOCGIFFLAGS = 0x8913
IFF_UP = 0x1
EFF_FLAG, RTR_FLAG, ERR_FLAG = 0x80000000, 0x40000000, 0x20000000
EFF_MASK, SFF_MASK = 0x1FFFFFFF, 0x7FF
CAN_MTU, CANFD_MTU = 16, 72
CANFD_BRS = 0x01

RECEIVE_BUFFER_BYTES = 1 << 20
"""Room for some 3,600 queued frames where the kernel allows it; the default holds 278."""
CLOCK_STEP_NS = 5 * NS_PER_MS
"""A wall clock that moves this far against the monotonic one between two readings was stepped."""

_HEADER = struct.Struct("=IBB2x")
_TIMESPEC = struct.Struct("@qq")
_UINT32 = struct.Struct("=I")
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_UINT32.size)
_GONE = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF)


class SocketCanBus:
    """One SocketCAN interface, classical and FD, filtered by the kernel to the identifiers asked for.

    A frame of the right identifier but the wrong kind (remote, extended, FD) does come through, so that it is
    refused by the decoder, where it is counted.
    """

    def __init__(self, channel: str, can_ids: Iterable[int]) -> None:
        self.channel = channel
        self.description = f"SocketCAN {channel}"
        self._counters = {
            "received": 0,
            "sent": 0,
            "send_no_room": 0,
            "receive_overflow": 0,
            "wall_clock_steps": 0,
        }
        self._offset_ns = clock.monotonic_ns() - clock.wall_ns()
        self._kernel_drops = 0
        self._socket = _opened(channel, sorted(set(can_ids)))
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def wait(self, until_ns: int) -> bool:
        """Sleep until a frame has come or `until_ns`, at the kernel's resolution of 1 ms, never early."""
        remaining_ns = until_ns - clock.monotonic_ns()
        return bool(self._poll.poll(max(0, -(-remaining_ns // NS_PER_MS))))

    def drain(self) -> list[CanFrame]:
        """All queued frames, stamped with the kernel's receive time on the monotonic clock."""
        frames: list[CanFrame] = []
        while True:
            try:
                data, ancillary, _, _ = self._socket.recvmsg(CANFD_MTU, _ANCILLARY_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                raise self._gone(error) from error
            if not frames:
                self._follow_wall_clock()
            frames.append(self._frame(data, ancillary))
        self._counters["received"] += len(frames)
        return frames

    def send(self, frame: CanFrame) -> bool:
        """Hand one frame to the kernel's transmit queue; false when that is full."""
        try:
            self._socket.send(packed(frame))
        except (BlockingIOError, InterruptedError):
            self._counters["send_no_room"] += 1
            return False
        except OSError as error:
            if error.errno == errno.ENOBUFS:
                self._counters["send_no_room"] += 1
                return False
            raise self._gone(error) from error
        self._counters["sent"] += 1
        return True

    def counters(self) -> dict[str, int]:
        """Frames received and sent, refused by a full queue, dropped by the kernel, and clock steps seen."""
        return dict(self._counters)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _frame(self, data: bytes, ancillary: list[tuple[int, int, bytes]]) -> CanFrame:
        stamp_ns = clock.monotonic_ns()
        for level, kind, content in ancillary:
            if level != socket.SOL_SOCKET:
                continue
            if kind == SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack(content)
                # Never later than now: a wall clock set forwards between the stamp and our reading of it
                # would make an old frame look fresh.
                stamp_ns = min(stamp_ns, seconds * NS_PER_S + nanoseconds + self._offset_ns)
            elif kind == SO_RXQ_OVFL:
                self._count_kernel_drops(_UINT32.unpack(content)[0])
        return unpacked(data, stamp_ns)

    def _follow_wall_clock(self) -> None:
        """Kernel stamps are wall-clock time: map them by the offset that holds now."""
        offset_ns = clock.monotonic_ns() - clock.wall_ns()
        if abs(offset_ns - self._offset_ns) > CLOCK_STEP_NS:
            self._counters["wall_clock_steps"] += 1
        self._offset_ns = offset_ns

    def _count_kernel_drops(self, total: int) -> None:
        self._counters["receive_overflow"] += (total - self._kernel_drops) & 0xFFFFFFFF
        self._kernel_drops = total

    def _gone(self, error: OSError) -> BusError:
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


def _opened(channel: str, can_ids: list[int]) -> socket.socket:
    if not hasattr(socket, "AF_CAN"):
        raise BusError("this system has no SocketCAN; use --interface with a python-can adapter, or the demo")
    try:
        raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
    except OSError as error:
        raise BusError(
            f"this kernel has no SocketCAN ({error.strerror}); `sudo modprobe can_raw`, or tools/vcan"
        ) from error
    try:
        # Exact identifiers over all 29 bits; the flags are left open (see the class).
        raw.setsockopt(
            socket.SOL_CAN_RAW,
            socket.CAN_RAW_FILTER,
            b"".join(struct.pack("=II", can_id, EFF_MASK) for can_id in can_ids),
        )
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        raw.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        raw.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        _bind_up(raw, channel)
    except BaseException:
        raw.close()
        raise
    return raw


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
