"""Translates the values of sent messages that no field fills and that change between frames to Python expressions.

In the source, `n` is the number of earlier frames of the message, and `x` the `SendContext`.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from vehicle_iface.codec.binding import Binding
from vehicle_iface.codec.cantools_classes import Message, Signal
from vehicle_iface.codec.checksums import BitPlace
from vehicle_iface.codec.enumerations import translate_to_wire
from vehicle_iface.codec.protection_rules import count_states, find_places, find_rule
from vehicle_iface.command import Phases
from vehicle_iface.profile.sends import ValueTable
from vehicle_iface.row import Row
from vehicle_iface.value import Value

FindColumn = Callable[[str], int]
"""Returns the index in the row of a received MESSAGE.SIGNAL."""


class SendContext(NamedTuple):
    """Further inputs for the values of a frame: the phases, and received values."""

    phases: Phases = Phases()
    row: Row | tuple[()] = ()
    """The newest received values; empty before there are any."""


class Complement(NamedTuple):
    """Bits that are the inverse of other bits of the same payload."""

    place: BitPlace
    of: BitPlace | None
    """The bits that are inverted; None for the counter of the protection."""


class SentValues(Value, frozen=True, kw_only=True):
    """The changing values of one message."""

    expressions: Mapping[str, str]
    """Maps each signal to the expression for its value in the DBC's unit."""
    echoes: tuple[int, ...]
    """Indices in the row; while one of these values is missing, the message is not sent."""
    complements: tuple[Complement, ...]


NO_VALUES = SentValues(expressions={}, echoes=(), complements=())


def build_sent_values(binding: Binding, name: str, find_column: FindColumn) -> SentValues:
    """Build the values of a message in which `send_faults` finds no fault."""
    message = binding.messages[name]
    dynamic = dict(_dynamic_values(binding, message))
    echoes = {one.echo for one in dynamic.values() if isinstance(one, ValueTable) and one.echo is not None}
    return SentValues(
        expressions={
            signal.name: _expression(binding, signal, dynamic[signal.name], find_column)
            for signal in message.signals
            if signal.name in binding.signals_used(name) and signal.name in dynamic
        },
        echoes=tuple(find_column(dotted) for dotted in sorted(echoes)),
        complements=tuple(_complements(binding, message, dynamic)),
    )


def initial_value(signal: Signal) -> float:
    """Return the value, in the DBC's unit, of a signal for which the profile states none."""
    return float(signal.raw_initial or 0) * signal.scale + signal.offset


def _dynamic_values(binding: Binding, message: Message) -> Iterator[tuple[str, str | ValueTable]]:
    for signal in message.signals:
        stated = binding.values.get(f"{message.name}.{signal.name}")
        if stated is not None and isinstance(stated.source, (str, ValueTable)):
            yield signal.name, stated.source


def _expression(binding: Binding, signal: Signal, source: str | ValueTable, find_column: FindColumn) -> str:
    if isinstance(source, str):
        return f"(n % {count_states(signal)}) * {signal.scale!r} + {signal.offset!r}"
    if source.echo is not None:
        return _echo_expression(binding, source.echo, f"x.row[{find_column(source.echo)}]")
    return f"({source.value!r} if x.phases.{source.when} else {initial_value(signal)!r})"


def _echo_expression(binding: Binding, dotted: str, value: str) -> str:
    """Return the expression that converts a field's value in the row to the DBC's unit."""
    table = translate_to_wire(binding, dotted)
    if table is not None:
        return f"{dict(table)!r}[{value}]"
    view = binding.view(dotted)
    return f"({value} - {view.offset!r}) / {view.scale!r}" if view.is_converted else value


def _complements(binding: Binding, message: Message, dynamic: Mapping[str, str | ValueTable]) -> Iterator[Complement]:
    places, rule = find_places(message), find_rule(binding.profile, message.name)
    counter = rule.counter.signal if rule is not None and rule.counter is not None else None
    for name, source in dynamic.items():
        if isinstance(source, ValueTable) and source.complement is not None:
            yield Complement(places[name], None if source.complement == counter else places[source.complement])
