"""Several frames in one system call: sendmmsg, which Python does not have."""

import ctypes
import errno
import os
from collections.abc import Sequence

from vehicle_iface.bus.base import MOST_AT_ONCE
from vehicle_iface.bus.receive import CANFD_MTU, IOVEC, MMSGHDR, MSG_DONTWAIT, address_of

_REFUSED = (errno.ENOBUFS, errno.EAGAIN, errno.EINTR)


class BatchSender:
    """Sends on one CAN socket from buffers that are allocated once."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._places = bytearray(CANFD_MTU * MOST_AT_ONCE)
        self._vectors = bytearray(IOVEC.size * MOST_AT_ONCE)
        self._headers = bytearray(MMSGHDR.size * MOST_AT_ONCE)
        self._place = address_of(self._places)
        self._lengths = [0] * MOST_AT_ONCE
        vectors = address_of(self._vectors)
        for i in range(MOST_AT_ONCE):
            fields = (0, 0, vectors + i * IOVEC.size, 1, 0, 0, 0, 0)
            MMSGHDR.pack_into(self._headers, i * MMSGHDR.size, *fields)
        self._address = address_of(self._headers)
        self._sendmmsg = ctypes.CDLL(None, use_errno=True).sendmmsg
        self._sendmmsg.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int)

    def send(self, frames: Sequence[bytes]) -> int:
        """Send packets (struct can_frame or canfd_frame) without waiting; return how many the kernel accepted.

        Sending ends at the first packet that finds the queue full. Raises `OSError` for any other error of the socket.
        """
        places, lengths, at = self._places, self._lengths, 0
        for i, frame in enumerate(frames):
            length = len(frame)
            places[at : at + length] = frame
            if length != lengths[i]:
                IOVEC.pack_into(self._vectors, i * IOVEC.size, self._place + at, length)
                lengths[i] = length
            at += CANFD_MTU
        count: int = self._sendmmsg(self._descriptor, self._address, len(frames), MSG_DONTWAIT)
        if count < 0:
            error = ctypes.get_errno()
            if error not in _REFUSED:
                raise OSError(error, os.strerror(error))
        return max(count, 0)
