"""Root, places, drawing range and update of the scene's nodes."""

from __future__ import annotations

from typing import NamedTuple

import viser

ROOT = "/world"
"""A frame of each browser: its camera moves it."""
LIVE, PAST = f"{ROOT}/now", f"{ROOT}/past"
"""The present, and the time that a browser looks back to: one of them is shown."""
FAR_M = 1e5
"""Nothing farther from the local origin is drawn."""


class Place(NamedTuple):
    """Where the vehicle is, relative to the local origin of the scene."""

    x_m: float
    y_m: float
    heading_rad: float


def is_near(x_m: float, y_m: float, limit_m: float = FAR_M) -> bool:
    """Return whether both coordinates are numbers within the range."""
    return abs(x_m) < limit_m and abs(y_m) < limit_m  # false for NaN as well


def assign_changed(node: viser.SceneNodeHandle, **values: object) -> None:
    """Assign the values that differ: viser sends a message for each assignment of some properties, changed or not."""
    for name, value in values.items():
        if getattr(node, name) != value:
            setattr(node, name, value)
