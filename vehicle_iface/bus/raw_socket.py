"""The kernel's raw CAN sockets: opening one on an interface that is up, and the form of a frame on it."""

import errno
import fcntl
import socket
import struct
from collections.abc import Iterable

from vehicle_iface.bus.receive import SO_RXQ_OVFL, SO_TIMESTAMPNS, Packet
from vehicle_iface.errors import BusError, BusGoneError
from vehicle_iface.frame import CanFrame, IdFilter, unchecked_frame

# From <linux/can.h>, <linux/can/raw.h>, <linux/sockios.h>, <linux/sock_diag.h> and <asm-generic/socket.h>.
EFF_FLAG, RTR_FLAG, ERR_FLAG = 0x80000000, 0x40000000, 0x20000000
EFF_MASK, SFF_MASK, ERR_MASK = 0x1FFFFFFF, 0x7FF, 0x1FFFFFFF
CAN_RAW_ERR_FILTER = 2
CANFD_BRS = 0x01
SIOCGIFFLAGS, IFF_UP = 0x8913, 0x1
SO_MEMINFO = 55
"""Numbers of 32 bits: received, its limit, sent, its limit, …, drops."""

SEND_BUFFER_BYTES = 1
"""The kernel's minimum (about 7 frames): on a dead bus further frames are rejected, so that none is sent late."""

_FRAME, _FD_FRAME = struct.Struct("=IBB2x8s"), struct.Struct("=IBB2x64s")
_UINT32 = struct.Struct("=I")
_MEMORY = struct.Struct("@9I")
_UNSENT = struct.Struct("@8xI")
_GONE = (errno.ENODEV, errno.ENXIO)


def find_socketcan_error() -> str:
    """Return why this system has no SocketCAN; empty if it has."""
    if not hasattr(socket, "AF_CAN"):
        return "not on this system"
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return error.strerror or str(error)
    return ""


def pack_frame(frame: CanFrame) -> bytes:
    """Pack `frame` into the kernel's struct can_frame or canfd_frame."""
    can_id, data, _, is_extended, is_remote, is_fd, _, _ = frame
    if is_extended or is_remote:
        can_id |= (EFF_FLAG if is_extended else 0) | (RTR_FLAG if is_remote else 0)
    if is_fd:
        return _FD_FRAME.pack(can_id, len(data), CANFD_BRS, data)
    return _FRAME.pack(can_id, len(data), 0, data)


def unpack_frame(packet: Packet, stamp_ns: int, bus: int = 0) -> CanFrame:
    """Convert a received packet to a frame of bus number `bus` in the profile."""
    word, data, is_fd, _, _, _ = packet
    if word <= SFF_MASK:  # the usual case: a standard data frame
        return unchecked_frame((word, data, stamp_ns, False, False, is_fd, False, bus))
    is_extended = bool(word & EFF_FLAG)
    can_id = word & (EFF_MASK if is_extended else SFF_MASK)
    is_remote, is_error = bool(word & RTR_FLAG), bool(word & ERR_FLAG)
    return unchecked_frame((can_id, data, stamp_ns, is_extended, is_remote, is_fd, is_error, bus))


def open_socket(
    channel: str,
    can_ids: Iterable[int] | None,
    *,
    receive_bytes: int,
    errors: bool = False,
    masked: Iterable[IdFilter] = (),
) -> socket.socket:
    """Open a raw socket on an interface that is up; receive only `can_ids` (None: all, of both formats) and `masked`.

    Raises `BusError` with the command that fixes it; `BusGoneError` when the interface does not exist.
    """
    if not hasattr(socket, "AF_CAN"):
        raise BusError("this system has no SocketCAN; use --interface with a python-can adapter, or the demo")
    try:
        raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        raise BusError(
            f"this kernel has no SocketCAN ({error.strerror}); `sudo modprobe can_raw`, or tools/vcan"
        ) from error
    try:
        # Exact identifiers over all 29 bits; the flags are left open (see SocketCanBus).
        pairs = [(0, 0)] if can_ids is None else [(can_id, EFF_MASK) for can_id in sorted(set(can_ids))]
        pairs += [(one.can_id | EFF_FLAG, one.mask | EFF_FLAG) for one in masked]
        filters = b"".join(struct.pack("=II", *pair) for pair in pairs)
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
        raw.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, _UINT32.pack(ERR_MASK if errors else 0))
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        raw.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        raw.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
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
        raise BusGoneError(f"{channel}: no such CAN interface ({error.strerror}); {how}") from error
    if not flags & IFF_UP:
        setup = "" if channel.startswith("vcan") else " type can bitrate 500000"
        raise BusError(f"{channel}: the interface is down; `sudo ip link set {channel} up{setup}`")


def gone_error(channel: str, error: OSError) -> BusError:
    """Return the `BusError` for an error of a socket in use."""
    if error.errno == errno.EINVAL:
        return BusError(f"{channel}: takes no CAN FD frames; `sudo ip link set {channel} mtu 72`")
    kind = BusGoneError if error.errno in _GONE else BusError
    return kind(f"{channel}: {error.strerror}; check `ip -details link show {channel}`")


def count_unsent_bytes(raw: socket.socket) -> int:
    """Return the kernel memory, in bytes, of frames handed to the socket and not sent yet; 0: all are sent."""
    unsent: int
    (unsent,) = _UNSENT.unpack(raw.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, _UNSENT.size))
    return unsent


def count_dropped_frames(raw: socket.socket) -> int:
    """Return the number of received frames dropped for want of buffer space since the socket was opened."""
    return int(_MEMORY.unpack(raw.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, _MEMORY.size))[8])
