"""The newest events of a run, numbered, and published as they come."""

from collections import deque
from collections.abc import Callable

from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase

MAX_EVENTS = 1000


class EventLog:
    """Keeps the newest `MAX_EVENTS`."""

    def __init__(self, publish: Callable[[LoopEvent], None] | None = None) -> None:
        """`publish` gets each event, too."""
        self._publish = publish
        self._kept: deque[LoopEvent] = deque(maxlen=MAX_EVENTS)
        self.count = 0
        """Number of all events so far."""

    @property
    def kept(self) -> list[LoopEvent]:
        """The newest events, oldest first."""
        return list(self._kept)

    def add(self, at_ns: int, kind: EventKind, name: str, *, phase: Phase = Phase.ONCE, text: str = "") -> None:
        """Add one event."""
        self.count += 1
        event = LoopEvent(number=self.count, at_ns=at_ns, kind=kind, name=name, phase=phase, text=text)
        self._kept.append(event)
        if self._publish is not None:
            self._publish(event)
