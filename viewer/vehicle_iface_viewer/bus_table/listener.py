"""Sockets that receive every frame of the vehicle's buses, and send nothing."""

from __future__ import annotations

import socket
from collections.abc import Mapping

from vehicle_iface import clock
from vehicle_iface.bus.raw_socket import count_dropped_frames, open_socket, unpack_frame
from vehicle_iface.bus.receive import BATCH, BatchReceiver
from vehicle_iface.errors import BusError
from vehicle_iface.frame import CanFrame
from vehicle_iface.units import NS_PER_S

RECEIVE_BUFFER_BYTES = 4 << 20
_MAX_BATCHES = 16
"""At most this many for each bus in one `read`: what a flood has beyond it is lost here, and counted."""
_REOPEN_NS = NS_PER_S


class Listener:
    """Receives from all buses. One that is absent, down or lost is opened again once a second."""

    def __init__(self, channels: Mapping[str, str]) -> None:
        self._sockets = [_Socket(channel, number) for number, channel in enumerate(channels.values())]

    @property
    def lost(self) -> int:
        """Number of frames that the kernel dropped because a buffer was full."""
        return sum(each.lost for each in self._sockets)

    @property
    def problem(self) -> str:
        """Why a bus is not received; empty when all are."""
        return "; ".join(each.problem for each in self._sockets if each.problem)

    def read(self, now_ns: int) -> list[CanFrame]:
        """Return the frames since the last call, those of each bus in order."""
        return [frame for each in self._sockets for frame in each.read(now_ns)]


class _Socket:
    def __init__(self, channel: str, number: int) -> None:
        self._channel, self._number = channel, number
        self._socket: socket.socket | None = None
        self._due_ns = 0
        self._lost_before = self._lost_now = 0
        self.problem = ""

    @property
    def lost(self) -> int:
        return self._lost_before + self._lost_now

    def read(self, now_ns: int) -> list[CanFrame]:
        if self._socket is None and not self._open(now_ns):
            return []
        assert self._socket is not None
        frames: list[CanFrame] = []
        # Kernel stamps are wall-clock time.
        offset_ns = clock.monotonic_ns() - clock.wall_ns()
        try:
            for _ in range(_MAX_BATCHES):
                packets = self._receiver.receive(wait=False)
                frames += [unpack_frame(packet, packet[3] + offset_ns, self._number) for packet in packets]
                if len(packets) < BATCH:
                    break
            self._lost_now = count_dropped_frames(self._socket)
        except OSError as error:
            self.problem = f"{self._channel}: {error.strerror}"
            self._socket.close()
            self._socket = None
            self._lost_before, self._lost_now = self.lost, 0
        return frames

    def _open(self, now_ns: int) -> bool:
        if now_ns < self._due_ns:
            return False
        self._due_ns = now_ns + _REOPEN_NS
        try:
            self._socket = open_socket(self._channel, None, receive_bytes=RECEIVE_BUFFER_BYTES, errors=True)
        except BusError as error:
            self.problem = str(error)
            return False
        self._receiver = BatchReceiver(self._socket.fileno())
        self.problem = ""
        return True
