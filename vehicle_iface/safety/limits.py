"""Range and rate limits as pure functions on raw counts.

Everything is checked on the raw value that will be on the wire: a limit that holds before rounding may not
hold after it. A value is raw · lsb; raw 0 is 0 in SI units.
"""

from dataclasses import dataclass, field
from enum import Enum
from math import ceil, floor, inf, isfinite
from typing import NamedTuple

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError

_ROUNDING = 1e-6
"""In counts: 0.6 / 0.0001 = 5999.999… is the 6000 that is meant."""
UNBOUNDED = 10**15
"""More counts than any signal has; a float still resolves single counts here."""


class LimitViolation(NamedTuple):
    """A value beyond its limit."""

    kind: Enum
    name: str
    """Of the value, with its unit."""
    value: float
    limit: float

    def __str__(self) -> str:
        return f"{self.kind.value}: {self.name} = {self.value:.4g}, limit {self.limit:.4g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One commanded quantity: its range, its rate and its resolution on the wire.

    Raises `InvalidValueError` when the range does not contain 0 (a stop needs it) or a number is not finite.
    """

    name: str
    lsb: float
    """SI units per wire count."""
    lowest: float
    highest: float
    rate_per_s: float
    """Greatest change per second; `inf` for a quantity that may jump, like the reported speed."""
    lowest_raw: int = field(init=False)
    """The least raw value that is not below `lowest`."""
    highest_raw: int = field(init=False)
    """The greatest raw value that is not above `highest`."""

    def __post_init__(self) -> None:
        checks.positive(f"{self.name}: lsb", self.lsb)
        if not self.rate_per_s >= 0.0:
            raise InvalidValueError(f"{self.name}: rate_per_s = {self.rate_per_s}: must be at least 0")
        lowest = checks.finite(f"{self.name}: lowest", self.lowest)
        highest = checks.finite(f"{self.name}: highest", self.highest)
        if not lowest <= 0.0 <= highest:
            raise InvalidValueError(f"{self.name}: the range [{lowest}, {highest}] must contain 0")
        object.__setattr__(self, "lowest_raw", ceil(lowest / self.lsb - _ROUNDING))
        object.__setattr__(self, "highest_raw", floor(highest / self.lsb + _ROUNDING))

    def step_raw(self, dt_s: float, rate_per_s: float = inf) -> int:
        """The greatest change of the raw value within `dt_s`, at the lower of this rate and the channel's own."""
        whole_range = self.highest_raw - self.lowest_raw
        if rate_per_s > self.rate_per_s:
            rate_per_s = self.rate_per_s
        if rate_per_s == inf:
            return whole_range
        step = rate_per_s * dt_s / self.lsb if dt_s > 0.0 else 0.0
        return whole_range if step >= whole_range else floor(step + _ROUNDING)


def limit_raw(
    channel: Channel,
    wanted: float,
    last_raw: int,
    dt_s: float,
    rate_per_s: float = inf,
    within: tuple[int, int] = (-UNBOUNDED, UNBOUNDED),
) -> int:
    """The raw value nearest to `wanted` (SI units) that is in range and within one step of `last_raw`.

    A `wanted` that is not finite counts as 0. When `last_raw` is itself out of range (a measured start value), the
    range wins over the step.

    `within` (counts) is a further range; a value outside it moves there at the rate limit.

    No limit breaks another. Let t be `wanted`, clamped to the part of `within` in the range. The result is t clamped to
    [last − step, last + step]: it lies between last and t. So every interval that contains both last and t contains the
    result: the range always (last is clamped to it first), and `within` once last is in it.
    """
    lowest, highest = channel.lowest_raw, channel.highest_raw
    low, high = clamp_interval(within, (lowest, highest))
    target = wanted / channel.lsb if isfinite(wanted) else 0.0
    raw = high if target >= high else low if target <= low else round(target)
    last_raw = highest if last_raw > highest else lowest if last_raw < lowest else last_raw
    step = channel.step_raw(dt_s, rate_per_s)
    return last_raw + step if raw > last_raw + step else last_raw - step if raw < last_raw - step else raw


def nearest_raw(channel: Channel, value: float) -> int:
    """The raw value in range that is nearest to `value` (SI units, finite)."""
    counts = value / channel.lsb
    if counts >= channel.highest_raw:
        return channel.highest_raw
    return round(counts) if counts > channel.lowest_raw else channel.lowest_raw


def raw_range(channel: Channel, lowest: float, highest: float) -> tuple[int, int]:
    """First and last raw value from `lowest` to `highest` (SI units); if there is none, the nearest one, twice."""
    lsb = channel.lsb
    first, last = lowest / lsb, highest / lsb
    low = ceil((-UNBOUNDED if first < -UNBOUNDED else UNBOUNDED if first > UNBOUNDED else first) - _ROUNDING)
    high = floor((-UNBOUNDED if last < -UNBOUNDED else UNBOUNDED if last > UNBOUNDED else last) + _ROUNDING)
    if low > high:
        low = high = round((lowest + highest) / (2.0 * lsb))
    return low, high


def clamp_interval(inner: tuple[int, int], outer: tuple[int, int]) -> tuple[int, int]:
    """The overlap of two intervals; if they do not overlap, the end of the outer one nearer to the inner one, twice.

    So of contradicting limits the outer interval of the last call wins; the others hold as far as it allows.
    """
    (first, last), (low, high) = inner, outer
    return (
        low if first < low else high if first > high else first,
        low if last < low else high if last > high else last,
    )


def floor_raw(channel: Channel, value: float) -> int:
    """The greatest raw value in range that does not exceed `value` (SI units, at least 0). NaN counts as +inf."""
    counts = value / channel.lsb
    return floor(counts + _ROUNDING) if counts < channel.highest_raw else channel.highest_raw
