"""A decoded message: complete, intact and in range."""

from typing import NamedTuple


class DecodedMessage(NamedTuple):
    """The values of one message, all of them checked; there is no partly good message."""

    name: str
    """The message's name in the DBC."""
    stamp_ns: int
    """Kernel receive time, nanoseconds of the monotonic clock."""
    counter: int
    """Its end-to-end counter; −1 where the message has none."""
    values: tuple[float | int | None, ...]
    """In the order of the message's `MessageCodec.names`, SI units as in the DBC."""
