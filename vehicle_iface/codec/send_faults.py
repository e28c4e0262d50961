"""Finds contradictions between profile and DBC in `[command.periods]`, `[command.values]` and `[[send]]`."""

import math
from collections.abc import Iterator

from vehicle_iface.codec.binding import SENT_ROLES, Binding, Role, StatedValue
from vehicle_iface.codec.cantools_classes import Message, Signal
from vehicle_iface.codec.constants import encode_faults, is_shown
from vehicle_iface.codec.enumerations import translate_from_wire
from vehicle_iface.codec.layout import Field, Layout
from vehicle_iface.codec.protection_rules import count_states, find_rule
from vehicle_iface.codec.quantities import find_unit
from vehicle_iface.codec.sent_values import initial_value
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile.sends import ValueTable

_MOST_TRIED = 256
"""If a signal has more numbers than this, only the smallest and the largest are tried."""


def send_faults(binding: Binding) -> Iterator[ConfigError]:
    """Yield errors in periods and values of command messages, and in `[[send]]`."""
    profile = binding.profile
    for name in profile.command.periods:
        yield from _command_faults(binding, name, f"$.command.periods.{name}")
    for index, sent in enumerate(profile.send):
        if sent.message not in binding.messages:
            yield binding.missing_message(sent.message, f"$.send[{index}].message")
    for dotted, stated in binding.values.items():
        if not stated.place.startswith("$.constants."):
            yield from _value_faults(binding, dotted, stated)


def _command_faults(binding: Binding, name: str, place: str) -> Iterator[ConfigError]:
    """The message carries a command."""
    commands = [one for one, role in binding.roles.items() if role is Role.COMMAND]
    if name not in binding.messages:
        yield binding.missing_message(name, place)
    elif name not in commands:
        yield binding.fault(place, f"must be of a command message: {' or '.join(commands)}; others are a [[send]]")


def _value_faults(binding: Binding, dotted: str, stated: StatedValue) -> Iterator[ConfigError]:
    """The signal exists, no field is bound to it, and it can carry the value."""
    place, name = stated.place, dotted.partition(".")[0]
    if place.startswith("$.command.values."):
        faults = list(_command_faults(binding, name, place))
        if faults:
            yield from faults
            return
    message, signal = binding.messages.get(name), binding.find_signal(dotted)
    if message is None:
        return  # reported for the message
    if signal is None:
        yield binding.missing_signal(dotted, place)
    elif dotted in binding.fields:
        yield binding.fault(place, f"{dotted} is bound to {binding.fields[dotted]}")
    elif dotted in binding.protection_signals:
        yield binding.fault(place, f"{dotted} is of the message's protection, which writes it")
    elif not is_shown(message, signal, binding.constants):
        if stated.source != 0.0:
            yield binding.fault(place, f"{dotted} is not in the branch that {signal.multiplexer_signal} chooses")
    elif signal.is_multiplexer and not isinstance(stated.source, float):
        yield binding.fault(place, f"{dotted} is a multiplexer: must be a number")
    elif not isinstance(stated.source, float):
        yield from _changing_faults(binding, dotted, stated, message, signal)


def _changing_faults(
    binding: Binding, dotted: str, stated: StatedValue, message: Message, signal: Signal
) -> Iterator[ConfigError]:
    """The signal can carry each value that will be sent."""
    source, place = stated.source, stated.place
    if not isinstance(source, ValueTable):
        states = 0 if signal.is_float else count_states(signal)
        if states < 2:
            yield binding.fault(place, f"{dotted}: must be a signal of whole numbers from 0 on to count with")
            return
        tried = range(states) if states <= _MOST_TRIED else (0, states - 1)
        yield from _first_fault(binding, dotted, [raw * signal.scale + signal.offset for raw in tried])
    elif source.value is not None:
        yield from encode_faults(binding, dotted, source.value)
        for fault in encode_faults(binding, dotted, initial_value(signal)):
            yield ConfigError(f"{fault}; it is sent while when does not hold")
    elif source.echo is not None:
        yield from _echo_faults(binding, dotted, place, source.echo, signal)
    elif source.complement is not None:
        yield from _complement_faults(binding, place, message, signal, source.complement)


def _first_fault(binding: Binding, dotted: str, values: list[float]) -> Iterator[ConfigError]:
    faults = (fault for value in values for fault in encode_faults(binding, dotted, value))
    yield from [fault for fault, _ in zip(faults, range(1), strict=False)]


def _echo_faults(binding: Binding, dotted: str, place: str, echo: str, signal: Signal) -> Iterator[ConfigError]:
    """The echoed signal is received, and the sent signal can carry each of its values."""
    name, _, echo_name = echo.partition(".")
    source = binding.find_signal(echo)
    if source is None:
        yield binding.missing_signal(echo, place)
    elif binding.roles.get(name) in SENT_ROLES:
        yield binding.fault(place, f"{echo} is sent by the program; only a received signal can be sent back")
    else:
        units = [binding.notes_of(one).unit or raw.unit or "" for one, raw in ((echo, source), (dotted, signal))]
        if find_unit(units[0]) != find_unit(units[1]):
            texts = [f"is in {unit!r}" if unit else "has no unit" for unit in units]
            yield binding.fault(place, f"{echo} {texts[0]}, and {dotted} {texts[1]}: must be the same")
        numbers = (translate_from_wire(binding, echo) or {}).values()
        if len(set(numbers)) < len(numbers):
            yield binding.fault(place, f"{echo} has several numbers of one meaning; it cannot be sent back")
        rules = {echo_name: binding.view(echo).rules}
        fields = Layout.of(binding.messages[name], [echo_name], rules).fields
        field = next(one for one in fields if one.name == echo_name)
        yield from _first_fault(binding, dotted, list(_possible_values(field)))


def _possible_values(field: Field) -> Iterator[float]:
    """Yield all values of a received signal, or the ends of its range."""
    if field.is_float:
        yield -math.inf if field.minimum is None else field.minimum
        yield math.inf if field.maximum is None else field.maximum
        return
    low, high, named = field.allowed_raw()
    numbers = named or (range(low, high + 1) if high - low < _MOST_TRIED else (low, high))
    yield from (field.scaled(raw) for raw in sorted(numbers))


def _complement_faults(
    binding: Binding, place: str, message: Message, signal: Signal, name: str
) -> Iterator[ConfigError]:
    """The inverted bits are written before the checksum is computed."""
    other = next((one for one in message.signals if one.name == name), None)
    rule = find_rule(binding.profile, message.name)
    stated = binding.values.get(f"{message.name}.{name}")
    if other is None:
        yield binding.missing_signal(f"{message.name}.{name}", place)
    elif signal.is_float or other.length != signal.length:
        text = f"{signal.name} has {signal.length} bits and {name} {other.length}: must be as many, and no float"
        yield binding.fault(place, text)
    elif rule is not None and rule.checksum is not None and rule.checksum.signal == name:
        yield binding.fault(place, f"{name} is the checksum, which is computed last")
    elif stated is not None and isinstance(stated.source, ValueTable) and stated.source.complement is not None:
        yield binding.fault(place, f"{name} is a complement itself")
