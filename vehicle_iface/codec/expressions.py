"""Translates forms and conditions of a profile to Python expressions over a row of signal values.

In the source, `s` is the row: the newest value of each bound signal in the field's unit; None if the sender has no
value.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from vehicle_iface.codec.signal_view import SignalView
from vehicle_iface.profile.forms import Condition, ConditionTable, FieldSource


class Place(NamedTuple):
    """Where a signal's value is in the row, and how numbers of a condition are converted to it."""

    column: int
    """The index in the row."""
    names: Mapping[int, str]
    from_wire: Mapping[int, int] | None = None
    """Maps the DBC's numbers to the row's, for an enumeration that the codec translates."""
    unit: float = 1.0
    """Factor from a condition's numbers to the row's unit."""
    step: float = 0.0
    """The step of one count in the row, for numbers that are not whole: two numbers are equal if they differ by less
    than half a step. 0 for whole numbers."""


def place_of(column: int, view: SignalView, from_wire: Mapping[int, int] | None = None) -> Place:
    """Return the place of a signal."""
    scale, offset = float(view.signal.scale), float(view.signal.offset)
    is_whole = not view.is_converted and scale.is_integer() and offset.is_integer()
    return Place(column, view.names, from_wire, view.unit_in_conditions, 0.0 if is_whole else view.resolution)


Find = Callable[[str], Place]
"""Returns the place of a MESSAGE.SIGNAL."""


def field_expression(source: FieldSource, find: Find) -> str:
    """Return the expression for a field's value.

    If a part of it is None, it raises `TypeError` when evaluated; an unconverted signal gives None.
    """
    if isinstance(source, str):
        return f"s[{find(source).column}]"
    if source.value is not None:
        value = f"s[{find(source.value).column}]"
        return value if source.negative_if is None else _signed(value, condition_expression(source.negative_if, find))
    terms = " + ".join(f"s[{find(dotted).column}]" for dotted in source.mean or source.sum or ())
    return f"({terms}) / {len(source.mean)}" if source.mean else f"({terms})"


def condition_expression(condition: Condition, find: Find) -> str:
    """Return the expression for a condition. A comparison with a missing value is false."""
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
    if condition.above is not None:
        comparison = f"{value} > {condition.above * place.unit!r}"
    elif condition.below is not None:
        comparison = f"{value} < {condition.below * place.unit!r}"
    elif place.step:
        near = [f"abs({value} - {number!r}) < {place.step / 2!r}" for number in wanted_numbers(condition, place)]
        comparison = f"({' or '.join(near) or 'False'})"
    else:
        comparison = f"{value} in {wanted_numbers(condition, place)!r}"
    return f"({slot} is not None and {comparison})"


def wanted_numbers(condition: ConditionTable, place: Place) -> tuple[float, ...]:
    """Return the numbers of `equals` or `in`, converted to the row's."""
    wanted = condition.among or ((condition.equals,) if condition.equals is not None else ())
    return tuple(_number(one, place) for one in wanted)


def unknown_names(condition: Condition, find: Find) -> list[tuple[str, str]]:
    """Return the names in a condition that its signal's table does not have, as MESSAGE.SIGNAL and name."""
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
    """Convert a number of the DBC, or a name of its table, to the row's number."""
    number = next(key for key, name in place.names.items() if name == wanted) if isinstance(wanted, str) else wanted
    return number * place.unit if place.from_wire is None else place.from_wire.get(int(number), number)


def _signed(value: str, condition: str) -> str:
    return f"(-{value} if {condition} else {value})"
