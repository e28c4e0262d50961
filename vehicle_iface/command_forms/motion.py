"""The vehicle's motion from which a command is formed, and the ranges of the command signals."""

import math
from typing import NamedTuple

LONGEST_STEP_S = 0.1
"""Maximum time by which a target advances after a pause."""


class MeasuredMotion(NamedTuple):
    """The vehicle as it was measured when the command was permitted."""

    speed_mps: float
    """Along the body's x axis."""
    accel_mps2: float
    """Along the body's x axis."""
    reversing: bool
    """Whether the vehicle drives backwards or, at standstill, would."""
    engaging: bool = False
    """Whether the vehicle is engaging and does not follow commands yet."""


class WireRange(NamedTuple):
    """Range that all signals of a field can carry, in the field's unit."""

    low: float
    high: float
    step: float
    """Size of one count; 0 for a float."""

    def floor(self, limit: float) -> float:
        """Return the greatest value up to `limit` (not below 0) that can be sent exactly."""
        limit = min(limit, self.high)
        return math.floor(limit / self.step + 1e-6) * self.step if self.step else limit


UNLIMITED = WireRange(-math.inf, math.inf, 0.0)
