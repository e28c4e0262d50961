"""The state of the link: a table of states and events."""

from enum import Enum


class LinkState(Enum):
    """The state of the link."""

    UP = "up"
    """Frames come and go."""
    DEGRADED = "degraded"
    """Frames come and go, and something was wrong a moment ago: errors, a full queue, frames lost here."""
    DOWN = "down"
    """The interface exists and carries nothing: it is down, bus off, or sends none of our frames."""
    GONE = "gone"
    """There is no interface of that name."""
    RECOVERING = "recovering"
    """Open again; frames have not been received for long enough yet."""


class LinkEvent(Enum):
    """An event that changes the state."""

    TROUBLE = "trouble"
    CLEAN = "clean"
    """Frames have come for a while without any trouble."""
    LOST = "lost"
    """It carries nothing; tried again, it still is down."""
    GONE = "gone"
    """There is no such interface (any more)."""
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
"""A missing pair means: stay."""
