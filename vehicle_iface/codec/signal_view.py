"""One signal of the DBC as the profile uses it: range, names, and conversion between the bus and its field."""

import math
from collections.abc import Iterator, Mapping

from vehicle_iface.codec.cantools_classes import Signal
from vehicle_iface.codec.layout import SignalRules
from vehicle_iface.codec.quantities import find_unit, unit_of_field
from vehicle_iface.profile.notes import SignalNotes, is_whole_number
from vehicle_iface.value import Value

ENUMERATED_FIELDS = {"mode", "gear", "gear_request", "reason", "state", "headlights", "turn_indicator", "pose_frame"}
"""Fields in which each number needs a name."""
_GRID = 1e-6
"""Share of one step by which a decimal limit may be off the grid."""


class SignalView(Value, frozen=True, kw_only=True):
    """A signal converted to its field: field = scale · (value in the DBC's unit) + offset."""

    signal: Signal
    low: float
    """The smallest value that bits and range allow, in the DBC's unit."""
    high: float
    names: Mapping[int, str]
    scale: float
    offset: float
    unit: str
    """The unit's spelling in the profile or else the DBC; "" for none."""
    is_noted: bool
    """Whether the profile's notes convert the signal, in addition to its unit."""
    rules: SignalRules

    @classmethod
    def of(cls, signal: Signal, notes: SignalNotes, field: str, *, in_own_unit: bool = False) -> "SignalView":
        """Build the view of a signal for a field; `field` is "" for a signal without one.

        With `in_own_unit`, the field has the signal's own unit.
        """
        names = {int(number): str(name) for number, name in (signal.choices or {}).items()}
        if notes.names is not None:
            names = {int(number): name for number, name in notes.names.items() if is_whole_number(number)}
        low, high = _value_range(signal, notes.range)
        return cls(
            signal=signal,
            low=low,
            high=high,
            names=names,
            scale=(1.0 if in_own_unit else _unit_factor(signal, notes, field))
            * (1.0 if notes.scale is None else notes.scale),
            offset=notes.offset,
            unit=(notes.unit if notes.unit is not None else signal.unit) or "",
            is_noted=notes.scale is not None or notes.offset != 0.0,
            rules=SignalRules(
                limits=notes.range,
                names=names if notes.names is not None else None,
                has_unit=bool(notes.unit if notes.unit is not None else signal.unit),
                is_enumerated=field in ENUMERATED_FIELDS,
                missing=frozenset(_as_signed(raw, signal) for raw in notes.not_available),
            ),
        )

    @property
    def is_converted(self) -> bool:
        """Whether the field's number differs from the signal's value."""
        return self.scale != 1.0 or self.offset != 0.0

    @property
    def unit_in_conditions(self) -> float:
        """Factor from a condition's numbers to the field's unit. A condition's numbers are in the DBC's unit, or
        converted by the notes."""
        return 1.0 if self.is_noted else self.scale

    @property
    def range_in_conditions(self) -> tuple[float, float]:
        """The smallest and largest value in the unit of a condition's numbers."""
        return self.field_range if self.is_noted else (self.low, self.high)

    @property
    def field_range(self) -> tuple[float, float]:
        """The smallest and largest value of the field that the signal can carry."""
        low, high = sorted((self.to_field(self.low), self.to_field(self.high)))
        return low, high

    @property
    def resolution(self) -> float:
        """The step of one count, in the field's unit; 0 for a float."""
        return 0.0 if self.signal.is_float else abs(float(self.signal.scale) * self.scale)

    @property
    def enumeration(self) -> frozenset[int]:
        """The only numbers that the signal may carry: those of its table, if it is unscaled and all are in range. Empty
        if other numbers are allowed."""
        signal = self.signal
        is_plain = not signal.is_float and signal.scale == 1 and signal.offset == 0
        is_named = bool(self.names) and all(self.low <= number <= self.high for number in self.names)
        return frozenset(self.names) if is_plain and is_named else frozenset()

    def find_nearest(self, field: float) -> float | None:
        """Return the field's value nearest to `field` that the signal can carry; None if that number means a missing
        value."""
        value, signal = self.to_wire(field), self.signal
        if signal.is_float:
            return self.to_field(min(self.high, max(self.low, value)))
        if self.names and self.enumeration:
            value = min(self.enumeration, key=lambda number: abs(number - value))
        first, last = sorted((end - signal.offset) / signal.scale for end in (self.low, self.high))
        raw = min(
            math.floor(last + _GRID), max(math.ceil(first - _GRID), round((value - signal.offset) / signal.scale))
        )
        return None if raw in self.rules.missing else self.to_field(raw * signal.scale + signal.offset)

    def to_field(self, value: float) -> float:
        """Convert a value in the DBC's unit to the field's."""
        return value * self.scale + self.offset if self.is_converted else value

    def to_wire(self, field: float) -> float:
        """Convert a field's value to the DBC's unit."""
        return (field - self.offset) / self.scale if self.is_converted else field


def unit_faults(signal: Signal, notes: SignalNotes, field: str) -> Iterator[str]:
    """Yield the reasons why the signal's unit does not fit the field.

    A scale in the profile converts one quantity to another; without it both must be the same.
    """
    wanted = unit_of_field(field)
    spelling = notes.unit if notes.unit is not None else signal.unit
    if wanted is None:
        return
    if not spelling:
        yield f"has no unit, and {field} is in {wanted.name!r}; give its unit in the profile, below [signals.…]"
        return
    unit = find_unit(spelling)
    if unit is None:
        yield f"unit {spelling!r} is not known; give one that is in the profile, below [signals.…]"
    elif unit.quantity != wanted.unit.quantity and notes.scale is None:
        yield (
            f"unit {spelling!r} is of {unit.quantity}: {field} must be in {wanted.name!r} or another unit of "
            f"{wanted.unit.quantity}, unless the profile gives a scale below [signals.…]"
        )


def note_faults(signal: Signal, notes: SignalNotes) -> Iterator[str]:
    """Yield the numbers in the notes that the signal's bits cannot express, each as `.key: text`."""
    half, most = 1 << signal.length - 1, (1 << signal.length) - 1
    for number in notes.not_available:
        least = -half if signal.is_signed else 0
        if not least <= number <= most:
            yield f".not_available: {number}: must be a raw value of {signal.length} bits, in [{least}, {most}]"
    for text in filter(is_whole_number, notes.names or ()):
        low, high = (-half, half - 1) if signal.is_signed else (0, most)
        if not low <= int(text) <= high:
            yield f".names: {text}: must be a number of {signal.length} bits, in [{low}, {high}]"


def _unit_factor(signal: Signal, notes: SignalNotes, field: str) -> float:
    """Return the factor from the signal's unit to the field's; 1 if it is unknown."""
    unit = find_unit((notes.unit if notes.unit is not None else signal.unit) or "")
    wanted = unit_of_field(field)
    if unit is None:
        return 1.0
    if wanted is None or wanted.unit.quantity != unit.quantity:
        return unit.factor
    return 1.0 if unit == wanted.unit else unit.factor / wanted.unit.factor


def _value_range(signal: Signal, stated: tuple[float, float] | None) -> tuple[float, float]:
    """Return the smallest and largest value that bits and range allow."""
    if signal.is_float:
        low, high = -math.inf, math.inf
    else:
        raw_low = -(1 << signal.length - 1) if signal.is_signed else 0
        raw_high = (1 << signal.length - bool(signal.is_signed)) - 1
        low, high = sorted(raw * signal.scale + signal.offset for raw in (raw_low, raw_high))
    least, most = stated if stated is not None else (signal.minimum, signal.maximum)
    return low if least is None else max(low, least), high if most is None else min(high, most)


def _as_signed(raw: int, signal: Signal) -> int:
    """Return the number that the bits of `raw` mean: 0xFFFF is −1 in a signed signal of 16 bits."""
    bits = raw & (1 << signal.length) - 1
    return bits - (1 << signal.length) if signal.is_signed and bits >> signal.length - 1 else bits
