"""The last look at a frame before it leaves: is it one of ours, and is it not one too many?"""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from vehicle_iface.frame import CanFrame
from vehicle_iface.units import NS_PER_MS

WINDOW_NS = 250 * NS_PER_MS
EXCESS = 1.2
"""A message may come so many times as often as its period says, and once more, in any window."""


class Outgoing(NamedTuple):
    """A message that may be sent."""

    can_id: int
    is_extended: bool
    is_fd: bool
    length: int
    """Bytes of payload."""
    period_ns: int


class Outlet:
    """An allow-list with a limit of rate for each entry. What is refused is counted by cause."""

    def __init__(self, messages: Iterable[Outgoing]) -> None:
        self._left_ns = {message[:4]: _nothing_left(message.period_ns) for message in messages}
        self.refused = {"not on the list": 0, "too often": 0}

    def lets_out(self, frame: CanFrame, now_ns: int) -> bool:
        """Whether this frame may leave now; what leaves is remembered."""
        left_ns = self._left_ns.get((frame.can_id, frame.is_extended, frame.is_fd, len(frame.data)))
        if left_ns is None or frame.is_remote or frame.is_error:
            self.refused["not on the list"] += 1
            return False
        if now_ns - left_ns[0] < WINDOW_NS:  # that many frames ago
            self.refused["too often"] += 1
            return False
        left_ns.append(now_ns)
        return True


def most_in_window(period_ns: int) -> int:
    """Frames of a message with this period that may leave in any window."""
    return int(EXCESS * WINDOW_NS / period_ns) + 1


def _nothing_left(period_ns: int) -> deque[int]:
    """Room for the times of as many frames as may leave in a window."""
    most = most_in_window(period_ns)
    return deque([-WINDOW_NS] * most, maxlen=most)
