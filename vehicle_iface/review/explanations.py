"""The fewest causes that explain all slopes at once.

A cause gives one field a gain (measured over true value): a reversed sign, another unit, mirrored axes, another
wheelbase, or any other scale. A wrong speed shows in three relations; one wrong gain of the speed explains all of them,
and costs less than three others.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import combinations, product

from vehicle_iface.codec.quantities import find_unit
from vehicle_iface.review.kinematics import HANDEDNESS, WHEELBASE
from vehicle_iface.review.relations import Outcome, Relation
from vehicle_iface.review.series import POSITION

UNITS: Mapping[str, tuple[str, ...]] = {
    "length": ("m", "cm", "mm", "km", "ft"),
    "angle": ("rad", "deg"),
    "angular rate": ("rad/s", "deg/s"),
    "speed": ("m/s", "km/h", "mph", "kn", "cm/s"),
    "acceleration": ("m/s^2", "g"),
}
"""Units that are tried, by quantity."""
RATIOS = (8.0, 25.0)
"""Plausible ratios of steering wheel to road wheel angle."""
WHEELBASE_FACTORS = (0.4, 2.5)
"""Plausible factors of a stated wheelbase; beyond them the angle is wrong."""
MAX_CAUSES = 3
_SIGMAS = 3.0
_NEAR, _FAR_TOLERANCE = 1.5, 2.0
"""Slopes further from 1 than the first are known the less: tan is not linear. They are measured again, corrected."""
SAME_COST = 0.15
"""Explanations whose costs differ by less are equally good."""


class Kind(Enum):
    """Kinds of causes."""

    SIGN = "sign"
    UNIT = "unit"
    SCALE = "scale"
    RATIO = "ratio"
    WHEELBASE = "wheelbase"
    MIRRORED = "mirrored"


_COSTS = {
    Kind.SIGN: 1.0,
    Kind.UNIT: 1.0,
    Kind.MIRRORED: 1.0,
    Kind.RATIO: 1.1,
    Kind.WHEELBASE: 1.4,
    Kind.SCALE: 1.7,
}

_FITTED = (Kind.RATIO, Kind.WHEELBASE, Kind.SCALE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """A fault of one field; the field's gain is the product of its causes' gains."""

    field: str
    kind: Kind
    gain: float
    unit: str = ""
    """Unit of the signal, for kind `UNIT`."""
    error: float = 0.0
    """Relative standard deviation of the gain; 0 where it is exact."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """Causes that together explain every slope."""

    causes: tuple[Cause, ...]
    cost: float
    misfit: float

    @property
    def gains(self) -> dict[str, float]:
        """Return measured over true value of each field that is wrong."""
        return {cause.field: self.gain(cause.field) for cause in self.causes}

    def gain(self, field: str) -> float:
        """Return measured over true value of a field."""
        return math.prod(cause.gain for cause in self.causes if cause.field == field)


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenUnit:
    """Unit that a profile states for the signal of a field."""

    quantity: str
    factor: float
    """Size of the unit in SI."""
    is_scaled: bool
    """Whether a scale in the profile turns it into the field."""


def explain(relations: Sequence[Relation], units: Mapping[str, GivenUnit]) -> list[Explanation]:
    """Return the best explanations, the first one best, the others as good; empty where none has at most `MAX_CAUSES`.

    Where nothing is wrong it is one without causes.
    """
    measured = [relation for relation in relations if relation.outcome is Outcome.MEASURED]
    found: list[Explanation] = []
    fields = sorted({field for relation in measured for field in relation.fields})
    for count in range(MAX_CAUSES + 1):
        if found and min(one.cost for one in found) <= count - 1 + SAME_COST:
            break
        for chosen in combinations(fields, count):
            found += _explain_by(chosen, measured, units)
    found.sort(key=lambda one: (round(one.cost, 3), one.misfit))
    best = [one for one in found if one.cost <= found[0].cost + SAME_COST]
    return [one for index, one in enumerate(best) if one.causes not in [other.causes for other in best[:index]]]


def combine(first: Explanation, second: Explanation) -> Explanation:
    """Combine the causes of both; inexact gains are multiplied."""
    causes = list(first.causes)
    for cause in second.causes:
        same = next((one for one in causes if (one.field, one.kind) == (cause.field, cause.kind)), None)
        if same is None:
            causes.append(cause)
        else:
            causes[causes.index(same)] = replace(cause, gain=same.gain * cause.gain)
    cost = sum(_COSTS[cause.kind] for cause in causes)
    return Explanation(causes=tuple(causes), cost=cost, misfit=second.misfit)


def refine(explanation: Explanation, corrected: Sequence[Relation]) -> Explanation:
    """Refine a fitted gain by another fit to the drive without it."""
    fitted = next((cause for cause in explanation.causes if cause.kind in _FITTED), None)
    about = [one for one in corrected if fitted and fitted.field in one.powers and one.outcome is Outcome.MEASURED]
    if fitted is None or not about:
        return explanation
    causes = [cause for cause in explanation.causes if cause is not fitted]
    gain = fitted.gain * _mean_gain(fitted.field, (), about)
    return replace(explanation, causes=(*causes, replace(fitted, gain=gain)))


def _mean_gain(field: str, fixed: Sequence[Cause], about: Sequence[Relation]) -> float:
    """Return the weighted mean magnitude of the gain that the relations of a field require."""
    logs = [one.powers[field] * math.log(abs(_slope(one) / _predict(one, fixed))) for one in about]
    weights = [1.0 / (one.tolerance**2 + _error(one) ** 2) for one in about]
    return math.exp(sum(weight * log for weight, log in zip(weights, logs, strict=True)) / sum(weights))


def _explain_by(
    fields: tuple[str, ...], measured: Sequence[Relation], units: Mapping[str, GivenUnit]
) -> Iterator[Explanation]:
    """List explanations in which only these fields are wrong; at most one by a gain that is not in a list."""
    exact = [tuple(_listed_gains(field, units)) for field in fields]
    for causes in product(*exact):
        yield from _confirm(tuple(cause for of_field in causes for cause in of_field), measured)
    for free in fields:
        others = [gains for field, gains in zip(fields, exact, strict=True) if field != free]
        for causes in product(*others):
            fixed = tuple(cause for of_field in causes for cause in of_field)
            for fitted in _fit_gain(free, fixed, measured, units):
                yield from _confirm((*fixed, *fitted), measured)


def _listed_gains(field: str, units: Mapping[str, GivenUnit]) -> Iterator[tuple[Cause, ...]]:
    if field == HANDEDNESS:
        yield (Cause(field=field, kind=Kind.MIRRORED, gain=-1.0),)
        return
    if field == WHEELBASE:
        return
    sign = Cause(field=field, kind=Kind.SIGN, gain=-1.0)
    if field != POSITION:
        yield (sign,)
    given = units.get(field)
    for name in UNITS.get(given.quantity, ()) if given is not None else ():
        unit = find_unit(name)
        if given is None or unit is None or math.isclose(unit.factor, given.factor, rel_tol=1e-6):
            continue
        other = Cause(field=field, kind=Kind.UNIT, gain=given.factor / unit.factor, unit=name)
        yield (other,)
        if field != POSITION:
            yield (sign, other)


def _fit_gain(
    field: str, fixed: tuple[Cause, ...], measured: Sequence[Relation], units: Mapping[str, GivenUnit]
) -> Iterator[tuple[Cause, ...]]:
    """Fit an arbitrary gain of a field to its relations."""
    if field == HANDEDNESS or any(cause.field == field for cause in fixed):
        return
    about = [relation for relation in measured if field in relation.powers]
    signs = [_slope(one) / _predict(one, fixed) > 0.0 for one in about if one.is_signed]
    gain = _mean_gain(field, fixed, about)
    error = min(_error(relation) for relation in about)
    if field == WHEELBASE:
        if all(signs) and WHEELBASE_FACTORS[0] <= 1.0 / gain <= WHEELBASE_FACTORS[1]:
            yield (Cause(field=field, kind=Kind.WHEELBASE, gain=gain, error=error),)
        return
    if signs and any(signs) is not all(signs):
        return
    sign = () if all(signs) else (Cause(field=field, kind=Kind.SIGN, gain=-1.0),)
    if field != "front_wheel_angle_rad":
        yield (*sign, Cause(field=field, kind=Kind.SCALE, gain=gain, error=error))
        return
    given = units.get(field)
    is_ratio = RATIOS[0] <= gain <= RATIOS[1] or (given is not None and given.is_scaled)
    yield (*sign, Cause(field=field, kind=Kind.RATIO if is_ratio else Kind.SCALE, gain=gain, error=error))
    degrees = find_unit("deg")
    if degrees is not None and given is not None and given.quantity == "angle":
        unit_gain = given.factor / degrees.factor
        if not math.isclose(unit_gain, 1.0) and RATIOS[0] <= gain / unit_gain <= RATIOS[1]:
            unit = Cause(field=field, kind=Kind.UNIT, gain=unit_gain, unit="deg")
            yield (*sign, unit, Cause(field=field, kind=Kind.RATIO, gain=gain / unit_gain, error=error))


def _confirm(causes: tuple[Cause, ...], measured: Sequence[Relation]) -> Iterator[Explanation]:
    """Return the causes as an explanation, if all slopes agree with them."""
    misfit = 0.0
    for relation in measured:
        ratio = _slope(relation) / _predict(relation, causes)
        is_far_off = not 1.0 / _NEAR < abs(_slope(relation)) < _NEAR
        allowed = (_FAR_TOLERANCE if is_far_off else 1.0) * relation.tolerance + _SIGMAS * _error(relation)
        if ratio <= 0.0 or abs(math.log(ratio)) > math.log1p(allowed):
            return
        misfit += (math.log(ratio) / allowed) ** 2
    yield Explanation(causes=causes, cost=sum(_COSTS[cause.kind] for cause in causes), misfit=misfit)


def _predict(relation: Relation, causes: Sequence[Cause]) -> float:
    """Predict the slope of a relation under the causes."""
    slope = math.prod(cause.gain ** relation.powers.get(cause.field, 0) for cause in causes)
    return slope if relation.is_signed else abs(slope)


def is_as_expected(relation: Relation) -> bool:
    """Return whether the slope is 1 within its uncertainty."""
    return any(True for _ in _confirm((), [relation]))


def _slope(relation: Relation) -> float:
    assert relation.fit is not None
    return relation.fit.slope


def _error(relation: Relation) -> float:
    assert relation.fit is not None
    return relation.fit.slope_error
