"""Events of a run: each change of mode, each stop, each limit that began or ended to act, each refusal and request."""

from collections.abc import Iterable, Iterator
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


def limit_spans(events: Iterable[LoopEvent], begin_ns: int, end_ns: int) -> Iterator[tuple[int, int]]:
    """Yield when a limit acted, from and to, in ns: what the gate says, however rarely snapshots were taken.

    One that began before the events is taken to act from `begin_ns`, one that does not end to act until `end_ns`.
    """
    began_ns: dict[str, int] = {}
    for event in events:
        if event.kind is EventKind.LIMIT and event.phase is Phase.BEGAN:
            began_ns[event.name] = event.at_ns
        elif event.kind is EventKind.LIMIT:
            yield began_ns.pop(event.name, begin_ns), event.at_ns
    for at_ns in began_ns.values():
        yield at_ns, end_ns
