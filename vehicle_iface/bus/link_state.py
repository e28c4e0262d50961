"""The state of the link: a table of states and events."""

from enum import Enum


class LinkState(Enum):
    """The state of the link."""

    UP = "up"
    """Frames are received and sent."""
    DEGRADED = "degraded"
    """Frames are received and sent, with recent trouble: errors, a full queue, or frames lost here."""
    DOWN = "down"
    """The interface exists but carries no frames: it is down, bus off, or sends none of our frames."""
    GONE = "gone"
    """No interface has that name."""
    RECOVERING = "recovering"
    """Open again; frames have not been received for long enough yet."""


class LinkEvent(Enum):
    """An event that changes the state."""

    TROUBLE = "trouble"
    CLEAN = "clean"
    """Frames were received for a while without errors."""
    LOST = "lost"
    """The interface carries no frames, or is still down after an attempt to reopen it."""
    GONE = "gone"
    """The interface does not exist (any more)."""
    OPENED = "opened"


OPEN = (LinkState.UP, LinkState.DEGRADED, LinkState.RECOVERING)
"""States in which frames are received and sent."""

TABLE: dict[tuple[LinkState, LinkEvent], LinkState] = {
    (LinkState.UP, LinkEvent.TROUBLE): LinkState.DEGRADED,
    (LinkState.DEGRADED, LinkEvent.CLEAN): LinkState.UP,
    (LinkState.RECOVERING, LinkEvent.CLEAN): LinkState.UP,
    **{(state, LinkEvent.LOST): LinkState.DOWN for state in (*OPEN, LinkState.GONE)},
    **{(state, LinkEvent.GONE): LinkState.GONE for state in (*OPEN, LinkState.DOWN)},
    **{(state, LinkEvent.OPENED): LinkState.RECOVERING for state in (LinkState.DOWN, LinkState.GONE)},
}
"""Next state; a missing pair leaves the state unchanged."""
