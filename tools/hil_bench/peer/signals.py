"""The signals that a profile names: where the DBC has them, and what they mean in SI."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cantools.database.can import Message, Signal

from hil_bench.messages import Messages
from hil_bench.peer.conditions import signals_of
from hil_bench.peer.units import size_of
from hil_bench.profile import ProfileError

DEGREES = ("latitude_deg", "longitude_deg")
"""Fields that are no SI."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerSignal:
    """One signal: field = scale · (value · size of its unit) + offset."""

    dotted: str
    message: str
    signal: Signal
    factor: float
    offset: float
    low: float
    high: float
    """Range, in the DBC's unit."""
    bits_range: tuple[float, float]
    """What the bits can carry, in the DBC's unit."""
    number_size: float
    """Size of the numbers of conditions in the field's unit: they are in the DBC's unit, or as the notes convert it."""
    names: Mapping[str, int]
    missing: tuple[int, ...]
    """Raw values by which the sender says that it has none."""

    def to_field(self, value: float) -> float:
        """From the DBC's unit."""
        return self.factor * value + self.offset

    def to_dbc(self, field: float) -> float:
        """To the DBC's unit, as near as the bits can carry it."""
        low, high = self.bits_range
        value = min(high, max(low, (field - self.offset) / self.factor))
        step, zero = float(self.signal.scale), float(self.signal.offset)
        return value if self.signal.is_float else round((value - zero) / step) * step + zero

    def can_carry(self, field: float) -> bool:
        """True for a value within the range, to half a count."""
        value = self.to_dbc(field)
        slack = abs(float(self.signal.scale)) / 2.0
        return abs(self.to_field(value) - field) <= self.count / 2.0 and self.low - slack <= value <= self.high + slack

    def from_raw(self, raw: float) -> float:
        """The field of a raw value."""
        return self.to_field(float(raw) * float(self.signal.scale) + float(self.signal.offset))

    def word_of(self, number: float) -> str:
        """The name of a number; empty without one."""
        return next((word for word, one in self.names.items() if one == number), "")

    @property
    def count(self) -> float:
        """One count, in the field's unit."""
        return abs(self.factor * float(self.signal.scale))


def read_signal(messages: Messages, profile: Mapping[str, Any], dotted: str, *, own_unit: bool = False) -> PeerSignal:
    """Raises `KeyError` for a signal that the DBC does not have. `own_unit`: its values are not converted."""
    message, _, name = dotted.partition(".")
    signal = messages.find(message).get_signal_by_name(name)
    notes = profile.get("signals", {}).get(dotted, {})
    names = {str(word): int(number) for number, word in (signal.choices or {}).items()}
    names = {str(word): int(number) for number, word in notes.get("names", {}).items()} or names
    unit = notes.get("unit", signal.unit)
    size = 1.0 if own_unit or names else size_of(unit)
    if size is None and dotted in _bound_signals(profile):
        raise ProfileError(
            f"{dotted}: the bench does not know the unit {unit!r}; [signals] of the profile may name another"
        )
    size = size or 1.0  # a condition may compare in a unit of its own
    if any(dotted in sources_of(profile["state"]["signals"].get(key)) for key in DEGREES):
        size /= math.radians(1.0)
    low, high = _bits_range(signal)
    stated = notes.get("range", (signal.minimum, signal.maximum))
    if None not in stated and stated[0] != stated[1]:
        low, high = max(low, float(stated[0])), min(high, float(stated[1]))
    return PeerSignal(
        dotted=dotted,
        message=message,
        signal=signal,
        factor=float(notes.get("scale", 1.0)) * size,
        offset=float(notes.get("offset", 0.0)),
        low=low,
        high=high,
        bits_range=_bits_range(signal),
        number_size=1.0 if "scale" in notes or "offset" in notes else size,
        names=names,
        missing=tuple(notes.get("not_available", ())),
    )


def initial_of(signal: Signal) -> float:
    """What is sent where nothing else is said, in the DBC's unit."""
    raw = signal.raw_initial
    return float(raw if isinstance(raw, int | float) else 0) * float(signal.scale) + float(signal.offset)


def _bound_signals(profile: Mapping[str, Any]) -> set[str]:
    """The signals of fields that have a unit."""
    state = (name for form in profile["state"]["signals"].values() for name in sources_of(form))
    return {*state, *(name for names in field_signals(profile).values() for name in names)}


def sources_of(form: object) -> tuple[str, ...]:
    """The signals that carry a field's value."""
    if isinstance(form, str):
        return (form,)
    if isinstance(form, Mapping):
        return tuple(form.get("mean") or form.get("sum") or ((form["value"],) if "value" in form else ()))
    return tuple(form) if isinstance(form, Sequence) else ()


def received_signals(profile: Mapping[str, Any]) -> Iterator[str]:
    """All signals that the vehicle must send: of fields, conditions and echoes."""
    for form in profile["state"]["signals"].values():
        yield from sources_of(form)
        if isinstance(form, Mapping):
            yield from signals_of(form.get("negative_if"))
    yield from signals_of(profile["state"].get("pose", {}).get("valid"))
    status = profile.get("status", {})
    yield from status.get("signals", {}).values()
    for table in ("when", "driver"):
        for condition in status.get(table, {}).values():
            yield from signals_of(condition)
    yield from echoed_signals(profile)


def echoed_signals(profile: Mapping[str, Any]) -> list[str]:
    """The signals of the vehicle that the device sends back."""
    values = sent_values(profile).values()
    return [str(value["echo"]) for value in values if isinstance(value, Mapping) and "echo" in value]


def sent_values(profile: Mapping[str, Any]) -> dict[str, object]:
    """The signals that no field fills, by their full name, as `[command.values]` and `[[send]]` have them."""
    found: dict[str, object] = dict(profile.get("command", {}).get("values", {}))
    for send in profile.get("send", ()):
        found |= {f"{send['message']}.{name}": value for name, value in send.get("values", {}).items()}
    return found


def field_signals(profile: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Command field → the signals that carry it."""
    return {field: sources_of(form) for field, form in profile.get("command", {}).get("signals", {}).items()}


def cycle_s(profile: Mapping[str, Any], message: Message, default_s: float) -> float:
    """A message's period: of the profile's notes, else of the DBC, else the default."""
    noted = profile.get("messages", {}).get(message.name, {}).get("cycle_ms")
    cycle_ms = float(noted if noted is not None else message.cycle_time or 0.0)
    return cycle_ms / 1e3 if cycle_ms > 0.0 else default_s


def _bits_range(signal: Signal) -> tuple[float, float]:
    if signal.is_float:
        return -3.0e38, 3.0e38
    raw = (
        (-(1 << signal.length - 1), (1 << signal.length - 1) - 1) if signal.is_signed else (0, (1 << signal.length) - 1)
    )
    ends = [float(number * signal.scale + signal.offset) for number in raw]
    return min(ends), max(ends)
