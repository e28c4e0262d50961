"""Forms and conditions of a profile as Python expressions over a row of signal values.

In the source `s` is the row: the newest value of each bound signal in the field's unit, None where the sender has none.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from vehicle_iface.codec.signal_view import SignalView
from vehicle_iface.profile.forms import Condition, ConditionTable, FieldSource


class Place(NamedTuple):
    """Where a signal's value stands."""

    column: int
    """In the row."""
    names: Mapping[int, str]
    from_wire: Mapping[int, int] | None = None
    """The DBC's number → the row's, of an enumeration that the codec translates."""
    unit: float = 1.0
    """Size of the unit of a condition's numbers in that of the row."""
    step: float = 0.0
    """Of one count in the row, where that is no whole number: numbers less than half of it apart are equal."""


def place_of(column: int, view: SignalView, from_wire: Mapping[int, int] | None = None) -> Place:
    """The place of a signal."""
    scale, offset = float(view.signal.scale), float(view.signal.offset)
    is_whole = not view.is_converted and scale.is_integer() and offset.is_integer()
    return Place(column, view.names, from_wire, view.unit_in_conditions, 0.0 if is_whole else view.resolution)


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
    """The numbers of `equals` or `in`, as they stand in the row."""
    wanted = condition.among or ((condition.equals,) if condition.equals is not None else ())
    return tuple(_number(one, place) for one in wanted)


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
    """A number of the DBC, or a name of its table, as it stands in the row."""
    number = next(key for key, name in place.names.items() if name == wanted) if isinstance(wanted, str) else wanted
    return number * place.unit if place.from_wire is None else place.from_wire.get(int(number), number)


def _signed(value: str, condition: str) -> str:
    return f"(-{value} if {condition} else {value})"
