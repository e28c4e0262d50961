"""The last check of a frame before it is sent: an allow-list, and a rate limit for each entry."""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from vehicle_iface.frame import CanFrame
from vehicle_iface.units import NS_PER_MS

WINDOW_NS = 250 * NS_PER_MS
EXCESS = 1.2
"""Each message may be sent at up to this many times its nominal rate, plus one, per window."""


class AllowedMessage(NamedTuple):
    """A message that may be sent."""

    can_id: int
    is_extended: bool
    is_fd: bool
    length: int
    """Bytes of payload."""
    period_ns: int
    bus: int = 0


class TransmitFilter:
    """An allow-list with a limit of rate for each entry. A frame that is rejected is counted by cause."""

    def __init__(self, messages: Iterable[AllowedMessage]) -> None:
        self._sent_ns = {(*message[:4], message.bus): _empty_window(message.period_ns) for message in messages}
        self.refused = {"not on the list": 0, "too often": 0}

    def has_room(self, can_id: int, is_extended: bool, is_fd: bool, length: int, now_ns: int, bus: int = 0) -> bool:
        """Whether a frame of this entry would be in time now; nothing is counted."""
        return now_ns - self._sent_ns[can_id, is_extended, is_fd, length, bus][0] >= WINDOW_NS

    def allows(self, frame: CanFrame, now_ns: int) -> bool:
        """Whether this frame may be sent now; one that may is counted as sent."""
        can_id, data, _, is_extended, is_remote, is_fd, is_error, bus = frame
        sent_ns = self._sent_ns.get((can_id, is_extended, is_fd, len(data), bus))
        if sent_ns is None or is_remote or is_error:
            self.refused["not on the list"] += 1
            return False
        if now_ns - sent_ns[0] < WINDOW_NS:  # that many frames ago
            self.refused["too often"] += 1
            return False
        sent_ns.append(now_ns)
        return True


def most_in_window(period_ns: int) -> int:
    """Frames of a message with this period that may leave in any window."""
    return int(EXCESS * WINDOW_NS / period_ns) + 1


def _empty_window(period_ns: int) -> deque[int]:
    """Room for the times of as many frames as may leave in a window."""
    most = most_in_window(period_ns)
    return deque([-WINDOW_NS] * most, maxlen=most)
