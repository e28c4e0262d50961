"""Frames of the simulated vehicle that are lost or damaged on their way."""

from collections import Counter

import msgspec

from vehicle_iface.frame import CanFrame


class FrameFaults(msgspec.Struct):
    """The faults in force, by message."""

    muted: set[str] = msgspec.field(default_factory=set)
    """Messages that are not sent; their counters step."""
    corrupt: Counter[str] = msgspec.field(default_factory=Counter)
    """Number of the next frames to corrupt, by message."""

    def apply(self, message: str, frame: CanFrame) -> CanFrame | None:
        """Apply the faults to the next frame of `message`; None when it is not sent."""
        if self.corrupt[message] > 0:
            self.corrupt[message] -= 1
            frame = _damage(frame)
        return None if message in self.muted else frame


def _damage(frame: CanFrame) -> CanFrame:
    """Invert bits of the frame's first byte: the checksum, or data that it covers."""
    return frame._replace(data=bytes((frame.data[0] ^ 0x5A, *frame.data[1:])))
