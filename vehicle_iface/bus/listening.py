"""A socket that receives every frame of a CAN interface and sends nothing, opened again when it is lost."""

import socket
from collections.abc import Callable
from typing import Generic, TypeVar

from vehicle_iface.bus.raw_socket import count_dropped_frames, open_socket
from vehicle_iface.bus.receive import BATCH
from vehicle_iface.errors import BusError

Receiver = TypeVar("Receiver")


class ListeningSocket(Generic[Receiver]):
    """One socket at a time on one interface, with a receiver of its frames."""

    def __init__(
        self, channel: str, make_receiver: Callable[[int], Receiver], *, receive_bytes: int, reopen_ns: int
    ) -> None:
        """`make_receiver` gets the descriptor of each socket; a lost one is opened again every `reopen_ns`."""
        self._channel = channel
        self._make_receiver = make_receiver
        self._receive_bytes, self._reopen_ns = receive_bytes, reopen_ns
        self._due_ns = 0
        self._socket: socket.socket | None = None
        self._lost_before = self._lost_now = 0
        self.problem = ""
        """Why nothing is received; empty when all is well."""

    @property
    def is_open(self) -> bool:
        """Whether frames can be received."""
        return self._socket is not None

    @property
    def lost(self) -> int:
        """Number of frames that the kernel dropped because its buffer was full."""
        return self._lost_before + self._lost_now

    def open(self) -> None:
        """Open the socket. Raises `BusError` when that is not possible."""
        self._socket = open_socket(self._channel, None, receive_bytes=self._receive_bytes, errors=True)
        self._receiver = self._make_receiver(self._socket.fileno())
        self.problem = ""

    def read(self, now_ns: int, receive: Callable[[Receiver], int], *, most_batches: int) -> None:
        """Call `receive`, which returns a number of frames, until there are no more, or `most_batches` times.

        An error of the socket closes it; the next calls open it again.
        """
        if self._socket is None and not self._reopen(now_ns):
            return
        assert self._socket is not None
        try:
            for _ in range(most_batches):
                if receive(self._receiver) < BATCH:
                    break
            self._lost_now = count_dropped_frames(self._socket)
        except OSError as error:
            self.problem = f"{self._channel}: {error.strerror}"
            self.close()
            self._due_ns = now_ns + self._reopen_ns

    def close(self) -> None:
        """Close the socket. May be called twice."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None
        self._lost_before, self._lost_now = self.lost, 0

    def _reopen(self, now_ns: int) -> bool:
        if now_ns < self._due_ns:
            return False
        self._due_ns = now_ns + self._reopen_ns
        try:
            self.open()
        except BusError as error:
            self.problem = str(error)
            return False
        return True
