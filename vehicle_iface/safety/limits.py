"""Limits as pure functions on wire integers.

Everything is checked on the raw value that will be on the wire: a limit that holds before rounding may not
hold after it. A value is raw · lsb; raw 0 is 0 in SI units.
"""

import math
from dataclasses import dataclass, field

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One quantity on its way out: its range, its rate, and what the wire can tell apart.

    Raises `InvalidValueError` when the range does not contain 0 (a stop needs it) or a number is not finite.
    """

    name: str
    lsb: float
    """SI units per wire count."""
    lowest: float
    highest: float
    rate_per_s: float
    """Greatest change per second; `math.inf` for a quantity that may jump, like the speed told along."""

    lowest_raw: int = field(init=False)
    """The least wire value whose meaning is not below `lowest`."""
    highest_raw: int = field(init=False)
    """The greatest wire value whose meaning is not above `highest`."""

    def __post_init__(self) -> None:
        checks.positive(f"{self.name}: lsb", self.lsb)
        if not self.rate_per_s >= 0.0:
            raise InvalidValueError(f"{self.name}: rate_per_s = {self.rate_per_s}: must be at least 0")
        lowest = checks.finite(f"{self.name}: lowest", self.lowest)
        highest = checks.finite(f"{self.name}: highest", self.highest)
        if not lowest <= 0.0 <= highest:
            raise InvalidValueError(f"{self.name}: the range [{lowest}, {highest}] must contain 0")
        object.__setattr__(self, "lowest_raw", _ceil(lowest / self.lsb))
        object.__setattr__(self, "highest_raw", _floor(highest / self.lsb))

    def step_raw(self, dt_s: float) -> int:
        """The greatest change of the wire value within `dt_s`."""
        whole_range = self.highest_raw - self.lowest_raw
        if self.rate_per_s == math.inf:
            return whole_range
        step = self.rate_per_s * dt_s / self.lsb if dt_s > 0.0 else 0.0
        return whole_range if step >= whole_range else _floor(step)


def limited_raw(channel: Channel, wanted: float, last_raw: int, dt_s: float) -> int:
    """The wire value nearest to `wanted` (SI) that is in range and within one step of `last_raw`.

    Finite first, then clamp: `wanted` that is not finite asks for 0. When `last_raw` is itself out of range
    (a measured start value) the range wins. The result is always in range, so range and rate never fight:
    a step towards an interval that contains the clamped last value cannot leave it.
    """
    low, high = channel.lowest_raw, channel.highest_raw
    target = wanted / channel.lsb if math.isfinite(wanted) else 0.0
    raw = high if target >= high else low if target <= low else round(target)
    last_raw = high if last_raw > high else low if last_raw < low else last_raw
    step = channel.step_raw(dt_s)
    return last_raw + step if raw > last_raw + step else last_raw - step if raw < last_raw - step else raw


def _floor(ratio: float) -> int:
    """Round down, but take 0.6 / 0.0001 = 5999.999… as the 6000 that is meant."""
    return math.floor(ratio + 1e-6)


def _ceil(ratio: float) -> int:
    return math.ceil(ratio - 1e-6)
