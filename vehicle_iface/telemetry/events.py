"""Events of a run: each change of mode, each stop, each limit that began or ended to act, each refusal and request."""

from enum import StrEnum

import msgspec


class EventKind(StrEnum):
    """What an event is about; its `name` says which one."""

    MODE = "mode"
    """A new mode; the text is its reason."""
    REASON = "reason"
    """Another reason of the commands, where it is no stop."""
    STOP = "stop"
    """A stop by its reason; the text is the reaction: stopped, released, silent."""
    LIMIT = "limit"
    """A limit of the gate changes commands."""
    LINK = "link"
    """A new state of the link; the text says why."""
    DEADLINE = "deadline"
    """Samples without a command in time."""
    TRAJECTORY = "trajectory"
    """A trajectory was accepted or rejected; the text says why."""
    REQUEST = "request"
    """A request of the operator; the text is the answer."""
    FAULT = "fault"
    """Frames, samples or commands that were dropped or rejected, by cause."""


class Phase(StrEnum):
    """Whether an event lasts."""

    ONCE = ""
    BEGAN = "began"
    ENDED = "ended"


class LoopEvent(msgspec.Struct, kw_only=True, frozen=True, omit_defaults=True):
    """One event, as it is published, recorded and shown."""

    number: int
    """From 1, without gaps."""
    at_ns: int
    """Time of the event on the monotonic clock."""
    kind: EventKind
    name: str
    phase: Phase = Phase.ONCE
    text: str = ""
