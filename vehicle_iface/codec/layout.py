"""Describes a CAN message for the code generator: bits, scaling and range of its signals, and the tree of its
multiplexers."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping

from vehicle_iface.codec.cantools_classes import (
    BaseConversion,
    IdentityConversion,
    LinearConversion,
    LinearIntegerConversion,
    Message,
    Signal,
)
from vehicle_iface.errors import ConfigError
from vehicle_iface.value import Value

_RANGE_TOLERANCE = 1e-6
"""Share of one step by which a decimal limit may be off the grid (the same as cantools')."""


class Field(Value, frozen=True, kw_only=True):
    """One signal, reduced to what the generated code needs."""

    index: int
    """The position among the message's values."""
    name: str
    shift: int
    """The place of the least significant bit in the payload, read as an integer of the signal's byte order."""
    width: int
    is_big: bool
    is_signed: bool
    is_float: bool
    kind: type[BaseConversion]
    scale: float
    offset: float
    minimum: float | None
    maximum: float | None
    has_unit: bool
    table: frozenset[int]
    """The numbers that VAL_ names; empty without a table."""
    is_enumerated: bool
    """Whether only named numbers are allowed, however many of them VAL_ names."""
    parent: str | None
    """The multiplexer that this signal depends on."""
    parent_ids: frozenset[int]
    missing: frozenset[int] = frozenset()
    """Raw numbers that mean that the sender has no value."""

    @property
    def end(self) -> int:
        """The bit after the most significant one, counted as `shift` is."""
        return self.shift + self.width

    @property
    def raw_minimum(self) -> int:
        return -(1 << self.width - 1) if self.is_signed else 0

    @property
    def raw_maximum(self) -> int:
        return (1 << self.width - self.is_signed) - 1

    @property
    def tolerance(self) -> float:
        return abs(self.scale) * _RANGE_TOLERANCE

    @property
    def lowest(self) -> float:
        return -math.inf if self.minimum is None else self.minimum - self.tolerance

    @property
    def highest(self) -> float:
        return math.inf if self.maximum is None else self.maximum + self.tolerance

    def scaled(self, raw: float) -> float:
        """Return the physical value, computed with the same operations as in the generated code."""
        return raw if self.kind is IdentityConversion else raw * self.scale + self.offset

    def allowed_raw(self) -> tuple[int, int, frozenset[int] | None]:
        """Return the smallest and largest allowed raw value, and the set of named values if these leave gaps.

        The smallest exceeds the largest if no value is in the range.
        """
        low, high = self._raw_bounds()
        enumeration = self.enumeration()
        named = sorted(raw for raw in enumeration if low <= raw <= high)
        if enumeration:
            low, high = (named[0], named[-1]) if named else (1, 0)
        gaps = bool(named) and len(named) != high - low + 1
        return low, high, frozenset(named) if gaps else None

    def enumeration(self) -> frozenset[int]:
        """Return all allowed numbers if the VAL_ table is an enumeration; empty otherwise.

        A table is an enumeration if it counts up from the bottom and lies in the range. A table that names only a few
        special numbers of a measured quantity ("error", "not available") does not restrict the others.
        """
        if self.kind is not IdentityConversion or self.is_float:
            return frozenset()
        lowest, highest = self.lowest, self.highest
        in_range = frozenset(raw for raw in self.table if lowest <= raw <= highest)
        if self.is_enumerated:
            return in_range
        bottoms = {0, 1, math.ceil(max(lowest, self.raw_minimum))}
        counts_up = any({bottom, bottom + 1} <= in_range for bottom in bottoms)
        return in_range if counts_up and in_range == self.table and not self.has_unit else frozenset()

    def _raw_bounds(self) -> tuple[int, int]:
        low, high = (self.lowest, self.highest) if self.scale > 0 else (-self.highest, -self.lowest)
        sign = 1 if self.scale > 0 else -1
        first = _bisect(self.raw_minimum, self.raw_maximum, lambda raw: sign * self.scaled(raw) >= low)
        last = _bisect(self.raw_minimum, self.raw_maximum, lambda raw: sign * self.scaled(raw) > high) - 1
        return first, last


def _bisect(low: int, high: int, holds: Callable[[int], bool]) -> int:
    """Return the first integer of low … high for which a monotone condition holds; high + 1 if it never does."""
    high += 1
    while low < high:
        middle = (low + high) // 2
        if holds(middle):
            high = middle
        else:
            low = middle + 1
    return low


class SignalRules(Value, frozen=True, kw_only=True):
    """A profile's statements about a signal; they take precedence over the DBC."""

    limits: tuple[float, float] | None = None
    """The smallest and largest value, in the DBC's unit."""
    names: Mapping[int, str] | None = None
    missing: frozenset[int] = frozenset()
    """Raw numbers that mean that the sender has no value."""
    has_unit: bool | None = None
    """Whether the signal measures a quantity; None: as the DBC states."""
    is_enumerated: bool = False
    """Whether only named numbers are allowed."""


class Branch(Value, frozen=True):
    """The signals that a multiplexer shows for some of its values."""

    ids: tuple[int, ...]
    fields: tuple[Field, ...]


class Layout(Value, frozen=True):
    """All signals of a message and the tree of its multiplexers."""

    message_name: str
    length: int
    fields: tuple[Field, ...]
    roots: tuple[Field, ...]
    branches: Mapping[str, tuple[Branch, ...]]
    is_partial: bool = False
    """Whether the message has further signals, so that a multiplexer may show others than these."""

    @classmethod
    def of(
        cls,
        message: Message,
        only: Collection[str] | None = None,
        rules: Mapping[str, SignalRules] | None = None,
        *,
        is_flat: bool = False,
    ) -> "Layout":
        """Build the layout of a message; raises `ConfigError` if the message cannot be compiled.

        With `only`, the layout contains these signals and the multiplexers that they depend on; the others are neither
        read nor checked. With `is_flat`, all signals are present at once, because the multiplexers have one value each.
        """
        if message.is_container:
            raise ConfigError(f"{message.name}: container messages cannot be compiled")
        names = {signal.name for signal in message.signals} if only is None else set(only)
        if not is_flat:
            names = _with_multiplexers(message, names)
        signals, rules = [signal for signal in message.signals if signal.name in names], rules or {}
        fields = tuple(
            _field(message, index, signal, rules.get(signal.name, SignalRules()), is_flat=is_flat)
            for index, signal in enumerate(signals)
        )
        branches = {
            signal.name: _branches(field, [child for child in fields if child.parent == signal.name])
            for signal, field in zip(signals, fields, strict=True)
            if signal.is_multiplexer and (only is None or any(child.parent == signal.name for child in fields))
        }
        roots = tuple(field for field in fields if field.parent is None)
        return cls(message.name, message.length, fields, roots, branches, is_partial=only is not None)

    def below(self, field: Field) -> Iterator[Field]:
        """Yield the field and all fields that depend on it."""
        yield field
        for child in self.fields:
            if child.parent == field.name:
                yield from self.below(child)


def _with_multiplexers(message: Message, names: Collection[str]) -> set[str]:
    """Return the signals and all multiplexers above them."""
    parents = {signal.name: signal.multiplexer_signal for signal in message.signals}
    found = set[str]()
    for name in names:
        above: str | None = name
        while above is not None and above not in found:
            found.add(above)
            above = parents.get(above)
    return found


def bits_of(signal: Signal) -> Iterator[int]:
    """Yield the signal's bits in little-endian numbering, in the order of the signal's byte order."""
    bit = signal.start
    for _ in range(signal.length):
        yield bit
        if signal.byte_order == "little_endian":
            bit += 1
        else:
            bit = bit - 1 if bit % 8 else bit + 15


def _field(message: Message, index: int, signal: Signal, rules: SignalRules, *, is_flat: bool) -> Field:
    where = f"{message.name}.{signal.name}"
    is_big = signal.byte_order == "big_endian"
    shift = signal.start
    if is_big:
        first = 8 * (signal.start // 8) + 7 - signal.start % 8
        shift = 8 * message.length - first - signal.length
    if shift < 0 or shift + signal.length > 8 * message.length:
        raise ConfigError(f"{where}: bits {signal.start}|{signal.length} are not in {message.length} bytes")
    linear = _linear(signal, where)
    if linear.is_float and signal.length not in (16, 32, 64):
        raise ConfigError(f"{where}: a float of {signal.length} bits; 16, 32 and 64 are possible")
    return Field(
        index=index,
        name=signal.name,
        shift=shift,
        width=signal.length,
        is_big=is_big,
        is_signed=bool(signal.is_signed) and not linear.is_float,
        is_float=linear.is_float,
        kind=type(linear),
        scale=linear.scale,
        offset=linear.offset,
        minimum=rules.limits[0] if rules.limits else signal.minimum,
        maximum=rules.limits[1] if rules.limits else signal.maximum,
        has_unit=bool(signal.unit) if rules.has_unit is None else rules.has_unit,
        is_enumerated=rules.is_enumerated,
        table=frozenset(int(number) for number in (signal.choices if rules.names is None else rules.names) or ()),
        parent=None if is_flat else signal.multiplexer_signal,
        parent_ids=frozenset(signal.multiplexer_ids or ()),
        missing=rules.missing,
    )


def _linear(signal: Signal, where: str) -> BaseConversion:
    """Return the signal's conversion without its names; raises `ConfigError` if its kind is unknown or it is not
    finite."""
    conversion = signal.conversion
    if conversion.choices is not None:
        conversion = BaseConversion.factory(conversion.scale, conversion.offset, None, conversion.is_float)
    if type(conversion) not in (IdentityConversion, LinearIntegerConversion, LinearConversion):
        raise ConfigError(f"{where}: {type(conversion).__name__} cannot be compiled")
    if not (math.isfinite(conversion.scale) and math.isfinite(conversion.offset)):
        raise ConfigError(f"{where}: factor {conversion.scale}, offset {conversion.offset}: must be finite")
    return conversion


def _branches(multiplexer: Field, children: list[Field]) -> tuple[Branch, ...]:
    """Group the values of a multiplexer that show the same signals. Named values that show no signal are known, too."""
    ids = set(multiplexer.table).union(*(child.parent_ids for child in children))
    shown: dict[tuple[int, ...], list[int]] = {}
    for number in sorted(ids):
        key = tuple(child.index for child in children if number in child.parent_ids)
        shown.setdefault(key, []).append(number)
    by_index = {child.index: child for child in children}
    return tuple(Branch(tuple(numbers), tuple(by_index[i] for i in key)) for key, numbers in shown.items())
