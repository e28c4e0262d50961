"""One CAN frame, received or to be sent."""

from dataclasses import dataclass

from vehicle_iface.errors import InvalidValueError


@dataclass(frozen=True, slots=True)
class CanFrame:
    """A classical or FD data frame with the moment it was seen.

    Not keyword-only and not converted: the loop builds several per sample. The bus checks what it receives,
    the encoder what it sends.
    """

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

    def __post_init__(self) -> None:
        if not 0 <= self.can_id <= (0x1FFFFFFF if self.is_extended else 0x7FF):
            raise InvalidValueError(f"can_id = {self.can_id:#x}: must fit {29 if self.is_extended else 11} bits")
        if len(self.data) > (64 if self.is_fd else 8):
            raise InvalidValueError(f"data of {len(self.data)} bytes: at most {64 if self.is_fd else 8}")
