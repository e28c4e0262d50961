"""Find signal values that make conditions true or false, for the reports of the simulated vehicle.

A condition on one signal leaves some of that signal's candidate values; only `any`, and the opposite of `all`, leave a
choice, and those are tried in turn.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from vehicle_iface.codec.expressions import Place, wanted_numbers
from vehicle_iface.codec.signal_view import SignalView
from vehicle_iface.profile.forms import Condition

Domains = Mapping[str, tuple[float, ...]]
"""MESSAGE.SIGNAL → its possible values, as in the row, the default first."""
FindPlace = Callable[[str], Place]


class Goal(NamedTuple):
    """A condition, and its required result."""

    condition: Condition
    wanted: bool


def signal_of(condition: Condition) -> str | None:
    """Return the signal of a condition without parts."""
    return condition if isinstance(condition, str) else condition.signal


def parts_of(condition: Condition) -> tuple[Condition, ...]:
    """Return the direct parts of a condition."""
    if isinstance(condition, str):
        return ()
    return (*(condition.all or ()), *(condition.any or ()), *((condition.negated,) if condition.negated else ()))


def leaves_of(condition: Condition) -> Iterator[Condition]:
    """Return all single-signal conditions in a condition."""
    if signal_of(condition) is not None:
        yield condition
    for part in parts_of(condition):
        yield from leaves_of(part)


def holds(condition: Condition, values: Mapping[str, float], find: FindPlace) -> bool:
    """Return whether a condition holds when the signals have these values."""
    if isinstance(condition, str):
        return values[condition] != 0
    if condition.signal is None:
        found = [holds(part, values, find) for part in parts_of(condition)]
        return not found[0] if condition.negated is not None else (all if condition.all is not None else any)(found)
    value = abs(values[condition.signal]) if condition.magnitude else values[condition.signal]
    place = find(condition.signal)
    if condition.above is not None:
        return value > condition.above * place.unit
    if condition.below is not None:
        return value < condition.below * place.unit
    return any(abs(value - number) <= place.step / 2 for number in wanted_numbers(condition, place))


def candidates(view: SignalView, conditions: Iterable[Condition], find: FindPlace) -> tuple[float, ...]:
    """Return values that the signal can carry on either side of all conditions on it; the nearest to 0 first."""
    step = view.resolution or 1e-3
    wished = {0.0, step, 1.0, -1.0, *(view.to_field(number) for number in view.enumeration)}
    for condition in conditions:
        if isinstance(condition, str):
            continue
        place = find(condition.signal or "")
        numbers = {one * place.unit for one in (condition.above, condition.below) if one is not None}
        numbers |= set(wanted_numbers(condition, place))
        numbers |= {-number for number in numbers} if condition.magnitude else set()
        wished |= {number + way * step for number in numbers for way in (-1.0, 0.0, 1.0)}
        wished |= {(number + end) / 2 for number in numbers for end in view.field_range if abs(end) < 1e12}
    found = {view.find_nearest(field) for field in wished}
    return tuple(sorted((one for one in found if one is not None), key=lambda one: (abs(one), -one)))


def zero_and_more(view: SignalView) -> tuple[float, float]:
    """Return 0, or the number next to it, and the smallest number that is not 0, in the DBC's unit."""
    found = candidates(view, (), _find_nothing)
    return view.to_wire(found[0]), view.to_wire(next((one for one in found if one), found[0]))


def _find_nothing(dotted: str) -> Place:
    raise KeyError(dotted)


def solve(goals: Sequence[Goal], domains: Domains, find: FindPlace) -> Domains | None:
    """Return the values that each signal may have when all goals are met; None where there are none."""
    return next(_narrow(list(goals), [], dict(domains), find), None)


def _narrow(goals: list[Goal], choices: list[Goal], domains: Domains, find: FindPlace) -> Iterator[Domains]:
    """Apply all goals without a choice, then try the parts of one choice after the other."""
    while goals:
        goal = goals.pop()
        condition, wanted = goal
        signal = signal_of(condition)
        if signal is not None:
            left = tuple(one for one in domains[signal] if holds(condition, {signal: one}, find) is wanted)
            if not left:
                return
            domains = {**domains, signal: left}
        elif not isinstance(condition, str) and condition.negated is not None:
            goals.append(Goal(condition.negated, not wanted))
        elif not isinstance(condition, str) and (condition.all is not None) is wanted:
            goals += (Goal(part, wanted) for part in parts_of(condition))
        else:
            choices = [*choices, goal]
    if not choices:
        yield domains
        return
    (condition, wanted), rest = choices[0], choices[1:]
    for part in parts_of(condition):
        yield from _narrow([Goal(part, wanted)], rest, domains, find)
