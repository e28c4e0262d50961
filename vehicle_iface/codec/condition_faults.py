"""Checks the conditions of a profile: names that a signal's table does not have, and numbers that it never reaches."""

from collections.abc import Iterator

from vehicle_iface.codec.binding import Binding, suggest
from vehicle_iface.codec.expressions import Place, unknown_names
from vehicle_iface.codec.signal_view import ENUMERATED_FIELDS, SignalView
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile.forms import Condition, ConditionTable, FieldForm


def condition_faults(binding: Binding) -> Iterator[ConfigError]:
    """Yield an error for each unknown name, and for each comparison that can never be true."""

    def find(dotted: str) -> Place:
        return Place(0, binding.view(dotted).names if binding.find_signal(dotted) else {})

    for place, condition in _conditions(binding).items():
        for dotted, name in unknown_names(condition, find):
            names = find(dotted).names.values()
            if names:
                yield binding.fault(place, f"{dotted} has no value {name!r}{suggest(name, names)}")
            elif binding.find_signal(dotted):
                yield binding.fault(place, f"{dotted} has no names; give its number instead of {name!r}")
        for table in _comparisons(condition):
            if table.signal is not None and binding.find_signal(table.signal) is not None:
                for text in _reach_faults(table, binding.view(table.signal), binding.fields.get(table.signal, "")):
                    yield binding.fault(place, text)


def _conditions(binding: Binding) -> dict[str, Condition]:
    """Map each place in the profile to its condition."""
    state, status = binding.profile.state, binding.profile.status
    found = {
        f"$.status.{key}.{field}": getattr(table, field)
        for key, table in (("when", status.when), ("driver", status.driver))
        for field in (table.__struct_fields__ if table is not None else ())
    }
    found["$.state.pose.valid"] = state.pose.valid
    for field in state.signals.__struct_fields__:
        form = getattr(state.signals, field)
        if isinstance(form, FieldForm):
            found[f"$.state.signals.{field}.negative_if"] = form.negative_if
    return {place: condition for place, condition in found.items() if condition is not None}


def _comparisons(condition: Condition) -> Iterator[ConditionTable]:
    """Yield the tables inside a condition that compare a signal."""
    if isinstance(condition, str):
        return
    if condition.signal is not None:
        yield condition
    for part in (*(condition.all or ()), *(condition.any or ()), *((condition.negated,) if condition.negated else ())):
        yield from _comparisons(part)


def _reach_faults(table: ConditionTable, view: SignalView, field: str) -> Iterator[str]:
    """Describe comparisons that no value of the signal fulfils."""
    low, high = view.range_in_conditions
    if table.magnitude:
        low, high = max(low, -high, 0.0), max(-low, high)
    where = f"{'the magnitude of ' if table.magnitude else ''}{table.signal} is in [{low:.10g}, {high:.10g}]"
    where += "" if view.is_noted or not view.unit else f" {view.unit}"
    if table.above is not None and not table.above < high:
        yield f"above = {table.above:g} never holds: {where}"
    if table.below is not None and not table.below > low:
        yield f"below = {table.below:g} never holds: {where}"
    if table.among == ():
        yield "in = [] never holds"
    is_closed = bool(view.names) and (view.rules.names is not None or field in ENUMERATED_FIELDS)
    for number in (*(table.among or ()), *((table.equals,) if table.equals is not None else ())):
        if isinstance(number, str):
            continue
        if not low <= number <= high:
            yield f"{number:g} never holds: {where}"
        elif is_closed and number not in view.names:
            table_text = ", ".join(f"{known} {name}" for known, name in view.names.items())
            yield f"{number:g} never holds: {table.signal} is one of {table_text}"
