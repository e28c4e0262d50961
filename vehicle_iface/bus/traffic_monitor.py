"""The traffic of all nodes: every frame is counted, and a few are sampled for identifier and length.

The kernel counts: a socket for all identifiers with room for only a few frames drops the rest and reports how many.
So a flooded bus costs no more than an idle one.
"""

from collections import Counter
from typing import NamedTuple

from vehicle_iface.bus.frame_bits import wire_bits
from vehicle_iface.bus.raw_socket import count_dropped_frames, open_socket, unpack_frame
from vehicle_iface.bus.receive import BatchReceiver
from vehicle_iface.frame import FrameKey
from vehicle_iface.units import NS_PER_S

SAMPLED_BYTES = 12288
"""Size of the receive buffer: about 32 frames (the kernel doubles it, and a frame takes 768 bytes)."""


class TrafficSample(NamedTuple):
    """The traffic between two polls."""

    span_ns: int
    frames: int
    """Number of frames, our own included; exact."""
    busy_ns: int
    """Time that they occupied the bus: the length of the sampled frames, scaled to all."""
    frames_by_key: dict[FrameKey, float]
    """Frames by identifier, scaled in the same way."""


class TrafficMonitor:
    """Samples the traffic of one SocketCAN interface."""

    def __init__(self, channel: str, *, bus: int = 0, bitrate: int, data_bitrate: int, now_ns: int) -> None:
        """`bus` is the number of the bus in the profile.

        Bit rates in bits per second, of the arbitration phase and of an FD frame's data phase.
        """
        self._bus = bus
        self._socket = open_socket(channel, None, receive_bytes=SAMPLED_BYTES)
        self._receiver = BatchReceiver(self._socket.fileno())
        self._ns_per_bit, self._ns_per_fast_bit = NS_PER_S / bitrate, NS_PER_S / data_bitrate
        self._received = 0
        self._seen = 0
        self._polled_ns = now_ns

    def poll(self, now_ns: int) -> TrafficSample:
        """Return the traffic since the last poll; `OSError` when the interface is gone."""
        counts: Counter[FrameKey] = Counter()
        busy_ns = 0.0
        for packet in self._receiver.receive(wait=False):
            frame = unpack_frame(packet, 0)
            counts[FrameKey(frame.can_id, frame.is_extended, self._bus)] += 1
            bits = wire_bits(frame)
            busy_ns += bits.nominal * self._ns_per_bit + bits.fast * self._ns_per_fast_bit
        sampled = counts.total()
        self._received += sampled
        seen = self._received + count_dropped_frames(self._socket)
        frames, self._seen = seen - self._seen, seen
        span_ns, self._polled_ns = now_ns - self._polled_ns, now_ns
        scale = frames / sampled if sampled else 0.0
        by_key = {key: count * scale for key, count in counts.items()}
        return TrafficSample(span_ns, frames, round(busy_ns * scale), by_key)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
