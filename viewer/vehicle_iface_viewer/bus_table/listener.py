"""Sockets that receive every frame of the vehicle's buses, and send nothing."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from vehicle_iface import clock
from vehicle_iface.bus.frame_io import FrameReceiver, open_receiver
from vehicle_iface.bus.listening import ListeningSocket
from vehicle_iface.frame import CanFrame
from vehicle_iface.units import NS_PER_S

RECEIVE_BUFFER_BYTES = 4 << 20
_MAX_BATCHES = 16
"""At most this many for each bus in one `read`: what a flood has beyond it is lost here, and counted."""
_REOPEN_NS = NS_PER_S


class Listener:
    """Receives from all buses. One that is absent, down or lost is opened again once a second."""

    def __init__(self, channels: Mapping[str, str]) -> None:
        self._sockets = [
            ListeningSocket(
                channel,
                partial(open_receiver, bus=number),
                receive_bytes=RECEIVE_BUFFER_BYTES,
                reopen_ns=_REOPEN_NS,
            )
            for number, channel in enumerate(channels.values())
        ]

    @property
    def lost(self) -> int:
        """Number of frames that the kernel dropped because a buffer was full."""
        return sum(each.lost for each in self._sockets)

    @property
    def problem(self) -> str:
        """Why a bus is not received; empty when all are."""
        return "; ".join(each.problem for each in self._sockets if each.problem)

    def read(self, now_ns: int) -> list[CanFrame]:
        """Return the frames since the last call, those of each bus in order, stamped on the monotonic clock."""
        frames: list[CanFrame] = []

        def receive(receiver: FrameReceiver) -> int:
            count = receiver.receive(False)
            if count:
                received_ns = clock.monotonic_ns()
                receiver.take(frames, received_ns - clock.wall_ns(), received_ns)
            return count

        for each in self._sockets:
            each.read(now_ns, receive, most_batches=_MAX_BATCHES)
        return frames
