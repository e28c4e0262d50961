"""Fills the bits of a sent message that no field fills: the profile's constants, and the DBC's initial values."""

from collections.abc import Iterator, Mapping

from vehicle_iface.codec.binding import SENT_ROLES, Binding
from vehicle_iface.codec.cantools_classes import Message, Signal
from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.errors import ConfigError, SignalError


def constant_payload(binding: Binding, name: str) -> bytes:
    """Return a message's payload with all its constants, and 0 where a field, checksum or counter is written later."""
    message, payload = binding.messages[name], 0
    for signal, value in _constants(binding, message):
        codec = MessageCodec(message, only=[signal.name], base=b"")
        payload |= int.from_bytes(codec.encode([value]), "big")
    return payload.to_bytes(message.length, "big")


def constant_faults(binding: Binding) -> Iterator[ConfigError]:
    """Yield errors for constants that their signals cannot carry, and for bound signals that are not in the chosen
    multiplexer branch."""
    for name, role in binding.roles.items():
        if role not in SENT_ROLES:
            continue
        message = binding.messages[name]
        for signal, value in _constants(binding, message):
            yield from encode_faults(binding, f"{name}.{signal.name}", value)
        for used in binding.signals_used(name):
            yield from _branch_faults(binding, message, used)


def encode_faults(binding: Binding, dotted: str, value: float) -> Iterator[ConfigError]:
    """Yield the reasons why a signal of a sent message cannot carry `value`, which is in the DBC's unit."""
    name, _, signal = dotted.partition(".")
    rules = {signal: binding.view(dotted).rules}
    try:
        MessageCodec(binding.messages[name], only=[signal], rules=rules, base=b"").encode([value])
    except SignalError as error:
        yield binding.fault(binding.value_place(dotted), str(error).partition(" = ")[2])


def _branch_faults(binding: Binding, message: Message, used: str) -> Iterator[ConfigError]:
    by_name = {signal.name: signal for signal in message.signals}
    signal = by_name[used]
    while signal.multiplexer_signal is not None:
        dotted = f"{message.name}.{signal.multiplexer_signal}"
        value, place = binding.constants.get(dotted), binding.value_place(dotted)
        ids = signal.multiplexer_ids or []
        if value is None:
            missing = "must be a number" if dotted in binding.values else "missing"
            yield binding.fault(place, f"{missing}; {message.name}.{used} is sent only where it is {_list(ids)}")
        elif value not in ids:
            yield binding.fault(place, f"{value:g}: {used} is sent only where it is {_list(ids)}")
        signal = by_name[signal.multiplexer_signal]


def _list(ids: list[int]) -> str:
    return " or ".join(map(str, ids[:5])) + (", …" if len(ids) > 5 else "")


def _constants(binding: Binding, message: Message) -> Iterator[tuple[Signal, float]]:
    """Yield the constant signals of the message with their values. Bound signals, checksums, counters and signals of
    other multiplexer branches are left out."""
    stated = binding.constants
    for signal in message.signals:
        dotted = f"{message.name}.{signal.name}"
        if dotted in binding.fields or dotted in binding.protection_signals or not is_shown(message, signal, stated):
            continue
        if dotted in stated:
            yield signal, stated[dotted]
        elif dotted in binding.values:
            continue  # written with each frame
        elif signal.raw_initial:
            yield signal, signal.raw_initial * signal.scale + signal.offset


def is_shown(message: Message, signal: Signal, stated: Mapping[str, float]) -> bool:
    """Whether all multiplexers above the signal have values that show it."""
    if signal.multiplexer_signal is None:
        return True
    value = stated.get(f"{message.name}.{signal.multiplexer_signal}", 0)
    parent = next(one for one in message.signals if one.name == signal.multiplexer_signal)
    return value in (signal.multiplexer_ids or ()) and is_shown(message, parent, stated)
