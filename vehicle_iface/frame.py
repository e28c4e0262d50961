"""One CAN frame, received or to be sent."""

from functools import partial
from typing import NamedTuple, Self

from vehicle_iface.errors import InvalidValueError


class _Fields(NamedTuple):
    """A plain tuple, because the loop makes several for each sample."""

    can_id: int
    """Identifier, 11 bits, or 29 bits when `is_extended`."""
    data: bytes
    """Payload, up to 8 bytes, or up to 64 when `is_fd`."""
    stamp_ns: int = 0
    """Received: kernel receive time on the monotonic clock. To be sent: ignored."""
    is_extended: bool = False
    is_remote: bool = False
    is_fd: bool = False
    is_error: bool = False
    bus: int = 0
    """Which of the profile's buses it is on, in their order there."""


class FrameKey(NamedTuple):
    """Identity of a frame: identifier, format and bus."""

    can_id: int
    is_extended: bool = False
    bus: int = 0


class IdFilter(NamedTuple):
    """Extended identifiers of which only some bits matter."""

    can_id: int
    mask: int

    def matches(self, can_id: int) -> bool:
        """Whether the identifier is one of them."""
        return (can_id ^ self.can_id) & self.mask == 0


class CanFrame(_Fields):
    """A classical or FD data frame with the moment it was seen.

    Rejects what no bus can carry. `unchecked_frame` makes those that are known to be good.
    """

    __slots__ = ()

    def __new__(
        cls,
        can_id: int,
        data: bytes,
        stamp_ns: int = 0,
        is_extended: bool = False,
        is_remote: bool = False,
        is_fd: bool = False,
        is_error: bool = False,
        bus: int = 0,
    ) -> Self:
        """Raises `InvalidValueError` for an identifier or a payload that does not fit."""
        if not 0 <= can_id <= (0x1FFFFFFF if is_extended else 0x7FF):
            raise InvalidValueError(f"can_id = {can_id:#x}: must fit {29 if is_extended else 11} bits")
        if len(data) > (64 if is_fd else 8):
            raise InvalidValueError(f"data of {len(data)} bytes: at most {64 if is_fd else 8}")
        return super().__new__(cls, can_id, data, stamp_ns, is_extended, is_remote, is_fd, is_error, bus)


unchecked_frame = partial(tuple.__new__, CanFrame)
"""A frame from the tuple of all its fields, in order: for those that a bus has carried or the encoder has built."""
