"""Reason codes, sent with every command."""

from enum import IntEnum


class Reason(IntEnum):
    """The reason that decided a command; the numbers are those of the bus contract (signal REASON)."""

    NOMINAL = 0
    NO_TRAJECTORY = 1
    EMPTY_TRAJECTORY = 2
    PAST_END_SPACE = 3
    PAST_END_TIME = 4
    FRAME_MISMATCH = 5
    STATE_STALE = 6
    STATE_INVALID = 7
    CONTROLLER_ERROR = 8
    DEVIATION = 9
    DRIVER_OVERRIDE = 10
    VEHICLE_NOT_AUTONOMOUS = 11
    VEHICLE_FAULT = 12
    LINK_DOWN = 13
    DUPLICATE_COMMANDER = 14
    SHUTDOWN = 15
    DEADLINE_MISSED = 16
    NOT_ENGAGED = 17
