"""Forms and conditions of a profile as Python expressions over a row of signal values.

In the source `s` is the row: the newest value of each bound signal in the field's unit, None where the sender has none.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from vehicle_iface.profile.forms import Condition, FieldSource


class Place(NamedTuple):
    """Where a signal's value stands."""

    column: int
    """In the row."""
    names: Mapping[int, str]


Find = Callable[[str], Place]
"""MESSAGE.SIGNAL → its place."""


def field_expression(source: FieldSource, find: Find) -> str:
    """The field's value; a part that is None makes it a TypeError, or None where it is a signal alone."""
    if isinstance(source, str):
        return f"s[{find(source).column}]"
    if source.value is not None:
        value = f"s[{find(source.value).column}]"
        return value if source.negative_if is None else _signed(value, condition_expression(source.negative_if, find))
    terms = " + ".join(f"s[{find(dotted).column}]" for dotted in source.mean or source.sum or ())
    return f"({terms}) / {len(source.mean)}" if source.mean else f"({terms})"


def condition_expression(condition: Condition, find: Find) -> str:
    """Whether the condition holds. A signal without a value fulfils no comparison."""
    if isinstance(condition, str):
        return f"(s[{find(condition).column}] not in (0, None))"
    if condition.all is not None:
        return _joined(" and ", condition.all, find) or "True"
    if condition.any is not None:
        return _joined(" or ", condition.any, find) or "False"
    if condition.negated is not None:
        return f"(not {condition_expression(condition.negated, find)})"
    assert condition.signal is not None
    place = find(condition.signal)
    slot = f"s[{place.column}]"
    value = f"abs({slot})" if condition.magnitude else slot
    if condition.among is not None:
        numbers = ", ".join(repr(_number(wanted, place)) for wanted in condition.among)
        comparison = f"{value} in ({numbers},)"
    elif condition.equals is not None:
        comparison = f"{value} == {_number(condition.equals, place)!r}"
    elif condition.above is not None:
        comparison = f"{value} > {condition.above!r}"
    else:
        comparison = f"{value} < {condition.below!r}"
    return f"({slot} is not None and {comparison})"


def unknown_names(condition: Condition, find: Find) -> list[tuple[str, str]]:
    """The names in a condition that its signal's table does not have: MESSAGE.SIGNAL and name."""
    if isinstance(condition, str):
        return []
    inner = (*(condition.all or ()), *(condition.any or ()), *((condition.negated,) if condition.negated else ()))
    found = [unknown for part in inner for unknown in unknown_names(part, find)]
    wanted = condition.among or (condition.equals,)
    if condition.signal is not None:
        names = find(condition.signal).names.values()
        found += [(condition.signal, one) for one in wanted if isinstance(one, str) and one not in names]
    return found


def _joined(word: str, parts: tuple[Condition, ...], find: Find) -> str:
    return f"({word.join(condition_expression(part, find) for part in parts)})" if parts else ""


def _number(wanted: float | str, place: Place) -> float:
    if not isinstance(wanted, str):
        return wanted
    return next(number for number, name in place.names.items() if name == wanted)


def _signed(value: str, condition: str) -> str:
    return f"(-{value} if {condition} else {value})"
