"""How the link is: a table of states and signs."""

from enum import Enum


class LinkState(Enum):
    """What can be had from the link now."""

    UP = "up"
    """Frames come and go."""
    DEGRADED = "degraded"
    """Frames come and go, and something was wrong a moment ago: errors, a full queue, frames lost here."""
    DOWN = "down"
    """There is an interface, and it carries nothing: down, bus off, or nobody takes our frames."""
    GONE = "gone"
    """There is no interface of that name."""
    RECOVERING = "recovering"
    """Open again; frames have not come for long enough to believe it."""


class LinkSign(Enum):
    """What changes the state."""

    TROUBLE = "trouble"
    CLEAN = "clean"
    """Frames have come for a while without any trouble."""
    LOST = "lost"
    """It carries nothing; tried again, it still is down."""
    GONE = "gone"
    """There is no such interface (any more)."""
    OPENED = "opened"


OPEN = (LinkState.UP, LinkState.DEGRADED, LinkState.RECOVERING)
"""There is a bus to hear and to send on."""

TABLE: dict[tuple[LinkState, LinkSign], LinkState] = {
    (LinkState.UP, LinkSign.TROUBLE): LinkState.DEGRADED,
    (LinkState.DEGRADED, LinkSign.CLEAN): LinkState.UP,
    (LinkState.RECOVERING, LinkSign.CLEAN): LinkState.UP,
    **{(state, LinkSign.LOST): LinkState.DOWN for state in (*OPEN, LinkState.GONE)},
    **{(state, LinkSign.GONE): LinkState.GONE for state in (*OPEN, LinkState.DOWN)},
    **{(state, LinkSign.OPENED): LinkState.RECOVERING for state in (LinkState.DOWN, LinkState.GONE)},
}
"""A missing pair means: stay."""
