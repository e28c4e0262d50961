"""Events that a CAN controller reports in error frames, by class (<linux/can/error.h>)."""

from enum import Enum


class ControllerEvent(Enum):
    """One event that a CAN controller reports."""

    WARNING = "error warning"
    """An error counter has passed 96."""
    PASSIVE = "error passive"
    """An error counter has passed 127: the controller receives but hardly sends."""
    ACTIVE = "error active"
    """The error counters are below their limits again."""
    BUS_OFF = "bus off"
    """The controller has taken itself off the bus."""
    RESTARTED = "restarted"
    ARBITRATION_LOST = "arbitration lost"
    OVERFLOW = "controller overflow"
    """The hardware's buffer was full: frames were lost that the kernel does not count."""
    TRANSMIT_TIMEOUT = "transmit timeout"
    PROTOCOL = "protocol error"
    NO_ACKNOWLEDGEMENT = "no acknowledgement"
    TRANSCEIVER = "transceiver"
    BUS_ERROR = "bus error"


_CONTROLLER = 0x4
_CLASSES = {
    0x1: ControllerEvent.TRANSMIT_TIMEOUT,
    0x2: ControllerEvent.ARBITRATION_LOST,
    0x8: ControllerEvent.PROTOCOL,
    0x10: ControllerEvent.TRANSCEIVER,
    0x20: ControllerEvent.NO_ACKNOWLEDGEMENT,
    0x40: ControllerEvent.BUS_OFF,
    0x80: ControllerEvent.BUS_ERROR,
    0x100: ControllerEvent.RESTARTED,
}
_CONTROLLER_BITS = (
    (0x03, ControllerEvent.OVERFLOW),
    (0x0C, ControllerEvent.WARNING),
    (0x30, ControllerEvent.PASSIVE),
    (0x40, ControllerEvent.ACTIVE),
)
"""Bits of data byte 1 in class `_CONTROLLER`; receive and transmit side together."""


def parse_error_frame(error_class: int, data: bytes) -> list[ControllerEvent]:
    """Return the events in an error frame: `error_class` is its identifier without flags, `data` its eight bytes."""
    events = [event for bit, event in _CLASSES.items() if error_class & bit]
    if error_class & _CONTROLLER and len(data) > 1:
        events += [event for bits, event in _CONTROLLER_BITS if data[1] & bits]
    return events
