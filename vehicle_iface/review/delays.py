"""Find late messages: the fewest that explain all lags at once.

A lag between two fields is the difference of their delays, and no delay is below 0.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from vehicle_iface.review.kinematics import COMMANDED
from vehicle_iface.review.relations import Outcome, Relation

TOLERANCE_S = 0.035
"""Lag that is no delay: sensors filter, and messages wait for one another."""
STEERING_RESPONSE_S = 0.15
"""Lag of a vehicle's motion behind its wheels, by tyres and inertia."""
_SURE_S = 0.03
"""Maximum standard deviation of a lag that is used."""
_SIGMAS = 3.0
MAX_LATE = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Lag:
    """y comes later than x."""

    y: str
    x: str
    lag_s: float
    error_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """A message is late, or only one field of it."""

    message: str
    field: str
    """Name of the late field; empty where the whole message is late."""
    delay_s: float


def lags_of(relations: Sequence[Relation], angular: Sequence[Lag]) -> list[Lag]:
    """Return the lags that are known well enough; `angular` are further ones."""
    found = [
        Lag(y=one.y, x=one.x, lag_s=one.fit.lag_s, error_s=one.fit.lag_error_s)
        for one in relations
        if one.fit is not None and one.outcome is Outcome.MEASURED and not one.x.startswith(COMMANDED)
    ]
    return [one for one in (*found, *angular) if one.error_s <= _SURE_S]


def find_delays(lags: Sequence[Lag], messages: Mapping[str, str]) -> list[list[Delay]]:
    """Return the best explanations of the lags; `messages` are those of the fields. Empty where there is none.

    Where nothing is late it is one without delays.
    """
    fields = sorted({field for lag in lags for field in (lag.y, lag.x)})
    late = [(messages[field], "") for field in fields] + [(messages[field], field) for field in fields]
    candidates = list(dict.fromkeys(late))
    for count in range(MAX_LATE + 1):
        found = [delays for chosen in combinations(candidates, count) for delays in _explain(chosen, lags, messages)]
        whole = [delays for delays in found if not any(delay.field for delay in delays)]
        if found:
            return whole or found
    return []


def _explain(
    chosen: tuple[tuple[str, str], ...], lags: Sequence[Lag], messages: Mapping[str, str]
) -> Iterator[list[Delay]]:
    """Return the delays of these messages or fields, if they explain every lag."""
    delays_s: list[float] = []
    for one in chosen:
        others = [other for other in chosen if other is not one]
        implied = []
        for lag in lags:
            power = _power(one, lag, messages)
            if power and not any(_power(other, lag, messages) for other in others):
                implied.append((power * lag.lag_s, 1.0 / max(lag.error_s, 1e-3) ** 2))
        if not implied:
            return
        delays_s.append(sum(value * weight for value, weight in implied) / sum(weight for _, weight in implied))
    if any(delay_s <= TOLERANCE_S for delay_s in delays_s):
        return
    for lag in lags:
        expected_s = sum(_power(one, lag, messages) * delay_s for one, delay_s in zip(chosen, delays_s, strict=True))
        allowed_s = max(TOLERANCE_S, _SIGMAS * lag.error_s)
        response_s = STEERING_RESPONSE_S if lag.x == "front_wheel_angle_rad" else 0.0
        if not -allowed_s <= lag.lag_s - expected_s <= allowed_s + response_s:
            return
    yield [
        Delay(message=message, field=field, delay_s=delay_s)
        for (message, field), delay_s in zip(chosen, delays_s, strict=True)
    ]


def _power(one: tuple[str, str], lag: Lag, messages: Mapping[str, str]) -> int:
    """Return 1 where the delay makes the lag greater, −1 where smaller."""
    message, field = one

    def is_in(name: str) -> bool:
        return name == field if field else messages[name] == message

    return int(is_in(lag.y)) - int(is_in(lag.x))
