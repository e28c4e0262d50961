"""Frames of the simulated vehicle that are lost or damaged on their way."""

from collections import Counter
from dataclasses import dataclass, field

from vehicle_iface.frame import CanFrame


@dataclass(slots=True)
class FrameFaults:
    """The faults in force, by message."""

    muted: set[str] = field(default_factory=set)
    """Messages that are lost: their counters step, nothing leaves."""
    corrupt: Counter[str] = field(default_factory=Counter)
    """How many of the next frames are damaged."""

    def apply(self, message: str, frame: CanFrame) -> CanFrame | None:
        """What becomes of the next frame of `message`; None where it is lost."""
        if self.corrupt[message] > 0:
            self.corrupt[message] -= 1
            frame = _damage(frame)
        return None if message in self.muted else frame


def _damage(frame: CanFrame) -> CanFrame:
    """The frame with bits of its first byte inverted: where the checksum is, or under it."""
    return frame._replace(data=bytes((frame.data[0] ^ 0x5A, *frame.data[1:])))
