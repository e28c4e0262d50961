"""Many frames in one system call: recvmmsg, which Python does not have.

CPython's own recvmsg asks for the interface's name (an ioctl) for each frame of a CAN socket, and needs one more
call to learn that there are no more frames. This one takes all that are queued in one call, which may wait for the
first of them.
"""

import ctypes
import errno
import os
import struct

from vehicle_iface.units import NS_PER_S

CANFD_MTU = 72
BATCH = 64
"""Maximum number of frames in one call."""
# From <asm-generic/socket.h> and <linux/socket.h>: Python does not export all of them.
SOL_SOCKET, SO_TIMESTAMPNS, SO_RXQ_OVFL = 1, 35, 40
MSG_DONTROUTE, MSG_DONTWAIT, MSG_WAITFORONE = 0x4, 0x40, 0x10000

# struct iovec, struct mmsghdr (a msghdr and a length) and struct cmsghdr of a 64-bit or 32-bit Linux.
IOVEC = struct.Struct("@PN")
MMSGHDR = struct.Struct("@PIPNPNi0PI0P")
_CMSGHDR = struct.Struct("@Nii")
_TIMESPEC = struct.Struct("@ll")
_UINT32 = struct.Struct("@I")
_STAMP_BYTES = _CMSGHDR.size + _TIMESPEC.size
_CONTROL_BYTES = 64
"""Room for the stamp and the drop counter, each with its header and padding."""
_STRIDE = CANFD_MTU + _CONTROL_BYTES
_FIELDS = f"@IB3x64sNii{_TIMESPEC.format[1:]}"
_PLACE = struct.Struct(f"{_FIELDS}{_STRIDE - struct.calcsize(_FIELDS)}x")
"""Identifier, length and data of a frame, and the control message that is usually the only one: the stamp."""
_FLAGS_AT = 5


Packet = tuple[int, bytes, bool, int, int, bool]
"""One frame as the kernel handed it over: identifier with the flags in its upper bits, data, whether it is FD, kernel
receive time (nanoseconds of the wall clock; 0 when there is none), frames that this socket has lost so far (0 when
the kernel did not say), and whether a program on this machine has sent it."""


class BatchReceiver:
    """Receives from one CAN socket into buffers that are allocated once."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._places = bytearray(_STRIDE * BATCH)
        self._vectors = bytearray(IOVEC.size * BATCH)
        self._headers = bytearray(MMSGHDR.size * BATCH)
        places, vectors = address_of(self._places), address_of(self._vectors)
        for i in range(BATCH):
            place, vector = places + i * _STRIDE, vectors + i * IOVEC.size
            IOVEC.pack_into(self._vectors, i * IOVEC.size, place, CANFD_MTU)
            fields = (0, 0, vector, 1, place + CANFD_MTU, _CONTROL_BYTES, 0, 0)
            MMSGHDR.pack_into(self._headers, i * MMSGHDR.size, *fields)
        self._blank = bytes(self._headers)
        self._address = address_of(self._headers)
        self._headers_view, self._places_view = memoryview(self._headers), memoryview(self._places)
        self._recvmmsg = ctypes.CDLL(None, use_errno=True).recvmmsg
        self._recvmmsg.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)

    def receive(self, *, wait: bool) -> list[Packet]:
        """Return the queued frames, up to `BATCH`; with `wait`, sleep until the first, or the socket's time-out.

        Raises `OSError` for an error that the socket reports (interface down, gone, …).
        """
        flags = MSG_WAITFORONE if wait else MSG_DONTWAIT
        count = self._recvmmsg(self._descriptor, self._address, BATCH, flags, None)
        if count < 0:
            error = ctypes.get_errno()
            if error in _NOTHING:
                return []
            raise OSError(error, os.strerror(error))
        packets: list[Packet] = []
        used = count * MMSGHDR.size
        places = _PLACE.iter_unpack(self._places_view[: count * _STRIDE])
        for _, _, _, _, _, control, flags, length in MMSGHDR.iter_unpack(self._headers_view[:used]):
            can_id, size, room, told, level, kind, seconds, nanoseconds = next(places)
            if control == told == _STAMP_BYTES and level == SOL_SOCKET and kind == SO_TIMESTAMPNS:  # all there is
                wall_ns, dropped = seconds * NS_PER_S + nanoseconds, 0
            else:
                wall_ns, dropped = self._ancillary(len(packets) * _STRIDE + CANFD_MTU, control)
            is_local = flags & MSG_DONTROUTE != 0
            packets.append((can_id, room[:size], length == CANFD_MTU, wall_ns, dropped, is_local))
        self._headers[:used] = self._blank[:used]  # the kernel has written lengths into them
        return packets

    def flags(self, place: int) -> int:
        """Return the flags byte (<linux/can.h>: BRS 1, ESI 2) of frame number `place`, from 0, of the last call."""
        return self._places[place * _STRIDE + _FLAGS_AT]

    def _ancillary(self, start: int, length: int) -> tuple[int, int]:
        """Return stamp and drop counter from the control messages; 0 for one that is missing or cut off."""
        wall_ns, dropped, place, end = 0, 0, start, start + min(length, _CONTROL_BYTES)
        while place + _CMSGHDR.size <= end:
            size, level, kind = _CMSGHDR.unpack_from(self._places, place)
            if not _CMSGHDR.size <= size <= end - place:
                break
            if level == SOL_SOCKET and kind == SO_TIMESTAMPNS and size >= _STAMP_BYTES:
                seconds, nanoseconds = _TIMESPEC.unpack_from(self._places, place + _CMSGHDR.size)
                wall_ns = seconds * NS_PER_S + nanoseconds
            elif level == SOL_SOCKET and kind == SO_RXQ_OVFL and size >= _CMSGHDR.size + _UINT32.size:
                dropped = _UINT32.unpack_from(self._places, place + _CMSGHDR.size)[0]
            place += (size + _ALIGN - 1) & -_ALIGN
        return wall_ns, dropped


_ALIGN = struct.calcsize("@N")
_NOTHING = (errno.EAGAIN, errno.EINTR)


def address_of(buffer: bytearray) -> int:
    """Return the address of a buffer; its length must not change."""
    return ctypes.addressof((ctypes.c_char * len(buffer)).from_buffer(buffer))
