"""The colours of the loop's states in banner and strip, and those of curves."""

from __future__ import annotations

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState

# White on each has a contrast of at least 4.5, also where it is a little transparent.
GREEN, AMBER, RED, BLUE, TEAL, GREY = "#237032", "#a04f00", "#b02525", "#1864ab", "#0a6475", "#495057"
VIOLET = "#862e9c"
"""The driver drives."""
# Of curves; each has a contrast of at least 3 on the dark page and on the light one.
REQUESTED, MEASURED, SENT, LIMITED = "#c97a00", "#228be6", "#2f9e44", "#e64980"
_STATES: dict[int, str] = {
    ControllerState.ENGAGED: GREEN,
    ControllerState.ENGAGING: TEAL,
    ControllerState.STOPPING: AMBER,
    ControllerState.FAULT: RED,
    ControllerState.SHADOW: BLUE,
    ControllerState.STARTING: TEAL,
    ControllerState.STANDBY: TEAL,
}


def state_color(state: int, reason: int) -> str:
    """Return the colour of a state with its reason; red where this version does not know it."""
    if reason == Reason.SHUTDOWN:
        return GREY
    if reason == Reason.DRIVER_OVERRIDE:
        return VIOLET
    return _STATES.get(state, RED)
