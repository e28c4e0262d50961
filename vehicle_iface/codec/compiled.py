"""One CAN message compiled to two straight-line functions, so that no dictionary is built on the loop's path.

The payload becomes one integer (two when both byte orders occur); a signal is a shift, a mask and a scaling of it.
`MessageCodec` writes that out as Python source once, when it is built, and compiles it. The rules of scaling and
rounding are those of cantools' conversions, so that both give the same bits.
"""

import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn

from cantools.database import Message, Signal
from cantools.database.conversion import (
    BaseConversion,
    IdentityConversion,
    LinearConversion,
    LinearIntegerConversion,
)

from vehicle_iface import checks
from vehicle_iface.errors import ConfigError, InvalidValueError, SignalError

Value = float | int | None
"""A signal's value: an int where scale and offset are whole, None in another multiplexer branch."""

_FOREIGN = (TypeError, ValueError, ArithmeticError, AttributeError, struct.error)
_RANGE_TOLERANCE = 1e-6
"""Of one step: what a limit written in decimal may be off the grid (the same as cantools')."""


class MessageCodec:
    """The codec of one message.

    `decode(data)` takes the payload and gives the values in the order of `names`: ints and floats in the DBC's
    units, enumerated signals as numbers, None for signals of another multiplexer branch. `encode(values)` takes the
    same order and gives the payload; unused bits are 0.

    With `checked` both refuse, as `SignalError`: a wrong length, a value outside the DBC's range or not finite, a
    number that the signal's VAL_ table does not name, an unknown multiplexer. A VAL_ table counts as an enumeration
    when the signal is unscaled and all of its entries lie in the signal's range; otherwise its entries outside the
    range are markers ("not available") and refused as the missing values that they are.
    Without `checked` the values are those of cantools with `decode_choices=False`, longer payloads are cut like
    there, and `SignalError` says what cannot be represented at all.

    Raises `ConfigError` when the message cannot be compiled: name and reason.
    """

    __slots__ = ("checked", "decode", "encode", "length", "message_name", "names", "source")

    def __init__(self, message: Message, checked: bool = True) -> None:
        layout = _Layout.of(message)
        self.message_name: str = message.name
        self.names: tuple[str, ...] = tuple(field.name for field in layout.fields)
        """Signal names, in the order of the values."""
        self.length: int = message.length
        """Payload, bytes."""
        self.checked: bool = checked
        self.source: str = _decode_source(layout, checked) + "\n\n" + _encode_source(layout, checked)
        """The generated functions, for reading."""
        names = _Failures(layout, checked).names() | _runtime_names(layout)
        exec(compile(self.source, f"<codec of {message.name}>", "exec"), names)
        self.decode: Callable[[bytes], tuple[Value, ...]] = names["decode"]  # type: ignore[assignment]
        self.encode: Callable[[Sequence[Value]], bytes] = names["encode"]  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"MessageCodec({self.message_name}, {self.length} bytes, checked={self.checked})"


# --- what a message looks like ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Field:
    """One signal, reduced to what its two lines of code need."""

    index: int
    """Position among the message's values."""
    name: str
    shift: int
    """Of its least significant bit, in the integer of its byte order."""
    width: int
    is_big: bool
    is_signed: bool
    is_float: bool
    kind: type[BaseConversion]
    scale: float
    offset: float
    minimum: float | None
    maximum: float | None
    table: frozenset[int]
    """Numbers that VAL_ names; empty without a table."""
    parent: str | None
    """The multiplexer that this signal depends on."""
    parent_ids: frozenset[int]

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
        """The physical value, by the same operations as the generated code."""
        return raw if self.kind is IdentityConversion else raw * self.scale + self.offset

    def allowed_raw(self) -> tuple[int, int, frozenset[int] | None]:
        """Smallest and greatest raw value in range, and the set of those named when they leave gaps.

        Raises `ConfigError` when there is none."""
        low, high = self._raw_bounds()
        named = sorted(raw for raw in self._enumeration() if low <= raw <= high)
        if self._enumeration():
            low, high = (named[0], named[-1]) if named else (1, 0)
        if low > high:
            raise ConfigError(f"{self.name}: no value lies in its range [{self.minimum}, {self.maximum}]")
        gaps = bool(named) and len(named) != high - low + 1
        return low, high, frozenset(named) if gaps else None

    def _enumeration(self) -> frozenset[int]:
        if self.kind is not IdentityConversion or self.is_float:
            return frozenset()
        if any(not self.lowest <= raw <= self.highest for raw in self.table):
            return frozenset()
        return self.table

    def _raw_bounds(self) -> tuple[int, int]:
        low, high = (self.lowest, self.highest) if self.scale > 0 else (-self.highest, -self.lowest)
        sign = 1 if self.scale > 0 else -1
        first = _bisect(self.raw_minimum, self.raw_maximum, lambda raw: sign * self.scaled(raw) >= low)
        last = _bisect(self.raw_minimum, self.raw_maximum, lambda raw: sign * self.scaled(raw) > high) - 1
        return first, last


def _bisect(low: int, high: int, holds: Callable[[int], bool]) -> int:
    """The first integer of low … high for which a monotone condition holds; high + 1 when it never does."""
    high += 1
    while low < high:
        middle = (low + high) // 2
        if holds(middle):
            high = middle
        else:
            low = middle + 1
    return low


@dataclass(frozen=True, slots=True)
class _Branch:
    """The signals that a multiplexer shows for some of its ids."""

    ids: tuple[int, ...]
    fields: tuple[_Field, ...]


@dataclass(frozen=True, slots=True)
class _Layout:
    """All signals of a message and the tree of its multiplexers."""

    message_name: str
    length: int
    fields: tuple[_Field, ...]
    roots: tuple[_Field, ...]
    branches: Mapping[str, tuple[_Branch, ...]]

    @classmethod
    def of(cls, message: Message) -> "_Layout":
        if message.is_container:
            raise ConfigError(f"{message.name}: container messages cannot be compiled")
        fields = tuple(_field(message, index, signal) for index, signal in enumerate(message.signals))
        branches = {
            signal.name: _branches(field, [child for child in fields if child.parent == signal.name])
            for signal, field in zip(message.signals, fields, strict=True)
            if signal.is_multiplexer
        }
        roots = tuple(field for field in fields if field.parent is None)
        return cls(message.name, message.length, fields, roots, branches)

    def below(self, field: _Field) -> Iterator[_Field]:
        """The field and everything that depends on it."""
        yield field
        for child in self.fields:
            if child.parent == field.name:
                yield from self.below(child)


def _field(message: Message, index: int, signal: Signal) -> _Field:
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
    return _Field(
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
        minimum=signal.minimum,
        maximum=signal.maximum,
        table=frozenset(int(number) for number in signal.choices or ()),
        parent=signal.multiplexer_signal,
        parent_ids=frozenset(signal.multiplexer_ids or ()),
    )


def _linear(signal: Signal, where: str) -> BaseConversion:
    """The signal's conversion without its names; ConfigError when it is of an unknown kind or not finite."""
    conversion = signal.conversion
    if conversion.choices is not None:
        conversion = BaseConversion.factory(conversion.scale, conversion.offset, None, conversion.is_float)
    if type(conversion) not in (IdentityConversion, LinearIntegerConversion, LinearConversion):
        raise ConfigError(f"{where}: {type(conversion).__name__} cannot be compiled")
    if not (math.isfinite(conversion.scale) and math.isfinite(conversion.offset)):
        raise ConfigError(f"{where}: factor {conversion.scale}, offset {conversion.offset}: must be finite")
    return conversion


def _branches(multiplexer: _Field, children: list[_Field]) -> tuple[_Branch, ...]:
    """Ids that show the same signals, together; named ids show none but are known."""
    ids = set(multiplexer.table).union(*(child.parent_ids for child in children))
    shown: dict[tuple[int, ...], list[int]] = {}
    for number in sorted(ids):
        key = tuple(child.index for child in children if number in child.parent_ids)
        shown.setdefault(key, []).append(number)
    by_index = {child.index: child for child in children}
    return tuple(_Branch(tuple(numbers), tuple(by_index[i] for i in key)) for key, numbers in shown.items())


# --- the source ---------------------------------------------------------------------------------------------------

_INDENT = "    "


def _decode_source(layout: _Layout, checked: bool) -> str:
    lines = [f"if len(data) != {layout.length}:", _INDENT + "data = cut(data)"]
    orders = {field.is_big for field in layout.fields}
    lines += ["n = from_bytes(data, 'little')"] if False in orders else []
    lines += ["b = from_bytes(data, 'big')"] if True in orders else []
    dependent = [field for field in layout.fields if field.parent is not None]
    lines += [f"v{field.index} = None" for field in dependent]
    lines += _decode_level(layout, layout.roots, checked)
    lines.append(f"return ({''.join(_result(field) + ', ' for field in layout.fields)})")
    return _function("decode", "data", lines)


def _decode_level(layout: _Layout, fields: Sequence[_Field], checked: bool) -> list[str]:
    lines = []
    for field in fields:
        lines += _decode_field(field, checked)
    for field in fields:
        if layout.branches.get(field.name):
            number = _result(field) if field.kind is IdentityConversion else f"int({_result(field)})"
            if field.is_float:
                number = f"int({_result(field)})"
            lines += _chain(
                layout, field, number, lambda branch: _decode_level(layout, branch.fields, checked)
            )
    return lines


def _decode_field(field: _Field, checked: bool) -> list[str]:
    raw, value = f"r{field.index}", f"v{field.index}"
    lines = [f"{raw} = {_extract(field)}"]
    if checked and not field.is_float:
        lines += _raw_check(field, fail_with=_scaling(field, raw))
    if field.parent is not None or field.is_float:
        lines.append(f"{value} = {_scaling(field, raw)}")
    if checked and field.is_float:
        lines += _float_check(field, value)
    return lines


def _extract(field: _Field) -> str:
    whole = "b" if field.is_big else "n"
    shifted = f"{whole} >> {field.shift}" if field.shift else whole
    bits = f"{shifted} & {hex((1 << field.width) - 1)}"
    if field.is_float:
        return f"float{field.width}({bits})"
    if field.is_signed:
        half = hex(1 << field.width - 1)
        return f"({bits} ^ {half}) - {half}"
    return bits


def _result(field: _Field) -> str:
    if field.parent is not None or field.is_float:
        return f"v{field.index}"
    return _scaling(field, f"r{field.index}")


def _scaling(field: _Field, raw: str) -> str:
    if field.kind is IdentityConversion:
        return raw
    if field.offset == 0 and field.scale > 0 and not field.is_float:
        return f"{raw} * {field.scale!r}"
    return f"{raw} * {field.scale!r} + {field.offset!r}"


def _raw_check(field: _Field, fail_with: str) -> list[str]:
    raw = f"r{field.index}"
    low, high, named = field.allowed_raw()
    if named is not None:
        condition = f"{raw} not in {{{', '.join(map(str, sorted(named)))}}}"
    elif (low, high) == (field.raw_minimum, field.raw_maximum):
        return []
    elif low == 0 and not field.is_signed:
        condition = f"{raw} > {high}"
    else:
        condition = f"not {low} <= {raw} <= {high}"
    return [f"if {condition}:", f"{_INDENT}refuse({field.index}, {fail_with})"]


def _float_check(field: _Field, value: str) -> list[str]:
    low, high = field.lowest, field.highest
    condition = f"not isfinite({value})"
    if math.isfinite(low) or math.isfinite(high):
        condition += f" or not {_number(low)} <= {value} <= {_number(high)}"
    return [f"if {condition}:", f"{_INDENT}refuse({field.index}, {value})"]


def _number(value: float) -> str:
    return repr(value) if math.isfinite(value) else f"({'-' if value < 0 else ''}inf)"


def _chain(
    layout: _Layout, multiplexer: _Field, number: str, level: Callable[[_Branch], list[str]]
) -> list[str]:
    """if … elif … over the branches of a multiplexer."""
    index = multiplexer.index
    lines = [f"m{index} = {number}"]
    word = "if"
    for branch in layout.branches[multiplexer.name]:
        ids = branch.ids
        condition = f"== {ids[0]}" if len(ids) == 1 else f"in {{{', '.join(map(str, ids))}}}"
        lines.append(f"{word} m{index} {condition}:")
        lines += [_INDENT + line for line in level(branch) or ["pass"]]
        word = "elif"
    return [*lines, "else:", f"{_INDENT}unknown({index}, m{index})"]


def _encode_source(layout: _Layout, checked: bool) -> str:
    count = len(layout.fields)
    lines = [f"if len(values) != {count}:", _INDENT + "miscounted(values)"]
    lines += [f"{''.join(f'v{i}, ' for i in range(count))}= values"] if count else []
    lines += [f"w{field.index} = 0" for field in layout.fields if field.parent is not None]
    lines += _encode_level(layout, layout.roots, checked)
    lines.append(f"return {_assembly(layout)}")
    return _function("encode", "values", lines)


def _encode_level(layout: _Layout, fields: Sequence[_Field], checked: bool) -> list[str]:
    lines = []
    for field in fields:
        lines += _encode_field(field, checked)
    for field in fields:
        if layout.branches.get(field.name):

            def level(branch: _Branch, parent: _Field = field) -> list[str]:
                inner = _encode_level(layout, branch.fields, checked)
                return inner + (_absent(layout, parent, branch) if checked else [])

            lines += _chain(layout, field, f"int(v{field.index})", level)
    return lines


def _absent(layout: _Layout, multiplexer: _Field, branch: _Branch) -> list[str]:
    """Refuse values of signals that this branch does not carry."""
    hidden = [child for child in layout.fields if child.parent == multiplexer.name]
    hidden = [child for child in hidden if child not in branch.fields]
    lines = []
    for field in [deeper for child in hidden for deeper in layout.below(child)]:
        lines += [f"if v{field.index} is not None:", f"{_INDENT}absent({field.index}, v{field.index})"]
    return lines


def _encode_field(field: _Field, checked: bool) -> list[str]:
    index = field.index
    raw, value = f"r{index}", f"v{index}"
    lines = _value_check(field, value) if checked else []
    if field.is_float:
        lines += [f"{raw} = {_unscaling(field, value)}"]
        if checked:
            lines += [f"if not isfinite({raw}):", f"{_INDENT}refuse({index}, {value})"]
        return [*lines, f"w{index} = bits{field.width}({raw})"]
    if field.kind is LinearIntegerConversion:
        difference = f"{value} - {int(field.offset)}" if field.offset else value
        lines += [f"d = {difference}", f"q, m = divmod(d, {int(field.scale)})"]
        lines += [f"{raw} = round(d / {int(field.scale)}) if m else round(q)"]
    else:
        lines += [f"{raw} = round({_unscaling(field, value)})"]
    lines += _fit_check(field, checked)
    if field.parent is not None:
        lines.append(f"w{index} = {_placed_bits(field)}")
    return lines


def _unscaling(field: _Field, value: str) -> str:
    if field.kind is IdentityConversion:
        return value
    return f"({value} - {field.offset!r}) / {field.scale!r}" if field.offset else f"{value} / {field.scale!r}"


def _value_check(field: _Field, value: str) -> list[str]:
    """Refuse what is outside the DBC's range; NaN fails every comparison and is refused by them."""
    low, high = field.lowest, field.highest
    if field.is_float:
        return _float_check(field, value)
    if not (math.isfinite(low) or math.isfinite(high)):
        return []
    if field.kind is IdentityConversion and field.minimum is not None and field.maximum is not None:
        low, high = field.minimum, field.maximum
    condition = f"not {_number(low)} <= {value} <= {_number(high)}"
    return [f"if {condition}:", f"{_INDENT}refuse({field.index}, {value})"]


def _fit_check(field: _Field, checked: bool) -> list[str]:
    """Refuse raw values that the bits cannot hold or the VAL_ table does not name."""
    index = field.index
    low, high, named = field.raw_minimum, field.raw_maximum, None
    if checked and field._enumeration():
        low, high, named = field.allowed_raw()
    if named is not None:
        condition = f"r{index} not in {{{', '.join(map(str, sorted(named)))}}}"
    elif checked and _range_implies(field, low, high):
        return []
    else:
        condition = f"not {low} <= r{index} <= {high}"
    return [f"if {condition}:", f"{_INDENT}refuse({index}, v{index})"]


def _range_implies(field: _Field, low: int, high: int) -> bool:
    """Whether every value that passed the range check rounds into low … high."""
    if field.scale == 0 or not (math.isfinite(field.lowest) and math.isfinite(field.highest)):
        return False
    ends = [(end - field.offset) / field.scale for end in (field.lowest, field.highest)]
    return all(low - 0.4 < end < high + 0.4 for end in ends)


def _placed_bits(field: _Field) -> str:
    return f"r{field.index} & {hex((1 << field.width) - 1)}" if field.is_signed else f"r{field.index}"


def _assembly(layout: _Layout) -> str:
    little = _union(field for field in layout.fields if not field.is_big)
    big = _union(field for field in layout.fields if field.is_big)
    size = layout.length
    if not big:
        return f"({little or 0}).to_bytes({size}, 'little')"
    if not little:
        return f"({big}).to_bytes({size}, 'big')"
    return f"({big} | from_bytes(({little}).to_bytes({size}, 'little'), 'big')).to_bytes({size}, 'big')"


def _union(fields: Iterator[_Field]) -> str:
    terms = []
    for field in fields:
        plain = field.parent is None and not field.is_float
        bits = f"({_placed_bits(field)})" if plain and field.is_signed else f"r{field.index}"
        bits = bits if plain else f"w{field.index}"
        terms.append(f"{bits} << {field.shift}" if field.shift else bits)
    return " | ".join(terms)


def _function(name: str, argument: str, lines: list[str]) -> str:
    body = "\n".join(2 * _INDENT + line for line in lines)
    return (
        f"def {name}({argument}):\n{_INDENT}try:\n{body}\n"
        f"{_INDENT}except SignalError:\n{2 * _INDENT}raise\n"
        f"{_INDENT}except FOREIGN as error:\n{2 * _INDENT}explain_{name}({argument}, error)"
    )


# --- what the source calls ----------------------------------------------------------------------------------------


def _runtime_names(layout: _Layout) -> dict[str, object]:
    names: dict[str, object] = {
        "from_bytes": int.from_bytes,
        "isfinite": math.isfinite,
        "inf": math.inf,
        "SignalError": SignalError,
        "FOREIGN": _FOREIGN,
    }
    for width in {field.width for field in layout.fields if field.is_float}:
        names[f"float{width}"], names[f"bits{width}"] = _float_functions(width)
    return names


def _float_functions(width: int) -> tuple[Callable[[int], float], Callable[[float], int]]:
    """IEEE 754 bits to number and back, of 16, 32 or 64 bits."""
    number = struct.Struct({16: "<e", 32: "<f", 64: "<d"}[width])
    size = width // 8

    def from_bits(bits: int) -> float:
        value: float = number.unpack(bits.to_bytes(size, "little"))[0]
        return value

    def to_bits(value: float) -> int:
        try:
            return int.from_bytes(number.pack(value), "little")
        except OverflowError:
            if width != 32:
                raise
            return int.from_bytes(number.pack(math.copysign(math.inf, value)), "little")

    return from_bits, to_bits


class _Failures:
    """The ends of the straight line: each raises a `SignalError` with message, signal, value and what is allowed."""

    def __init__(self, layout: _Layout, checked: bool) -> None:
        self._layout = layout
        self._checked = checked

    def names(self) -> dict[str, object]:
        """What the generated source calls them."""
        return {
            "cut": self.cut,
            "refuse": self.refuse,
            "unknown": self.unknown,
            "absent": self.absent,
            "miscounted": self.miscounted,
            "explain_decode": self.explain_decode,
            "explain_encode": self.explain_encode,
        }

    def cut(self, data: bytes) -> bytes:
        """A payload that is too long, cut to length where that is allowed."""
        length = self._layout.length
        if self._checked or len(data) < length:
            raise SignalError(f"{self._layout.message_name}: {len(data)} bytes: must be {length}")
        return data[:length]

    def refuse(self, index: int, value: object) -> NoReturn:
        field = self._layout.fields[index]
        raise SignalError(f"{self._place(index)} = {value!r}: must be {_allowed(field, self._checked)}")

    def unknown(self, index: int, number: int) -> NoReturn:
        branches = self._layout.branches[self._layout.fields[index].name]
        known = sorted(number for branch in branches for number in branch.ids)
        raise SignalError(f"{self._place(index)} = {number}: must be a multiplexer id of {_listed(known)}")

    def absent(self, index: int, value: object) -> NoReturn:
        multiplexer = self._layout.fields[index].parent
        raise SignalError(f"{self._place(index)} = {value!r}: must be None, {multiplexer} hides this signal")

    def miscounted(self, values: Sequence[Value]) -> NoReturn:
        count = len(self._layout.fields)
        raise SignalError(f"{self._layout.message_name}: {len(values)} values: must be {count}")

    def explain_decode(self, data: object, error: Exception) -> NoReturn:
        raise SignalError(f"{self._layout.message_name}: {data!r} cannot be decoded: {error}") from error

    def explain_encode(self, values: object, error: Exception) -> NoReturn:
        """Find the value that the arithmetic stumbled over."""
        name = self._layout.message_name
        if not isinstance(values, Sequence):
            raise SignalError(f"{name} = {values!r}: must be a sequence of values") from error
        for field, value in zip(self._layout.fields, values, strict=False):
            if value is None and field.parent is not None:
                continue
            try:
                checks.finite(self._place(field.index), int(value) if isinstance(value, bool) else value)
            except InvalidValueError as refused:
                raise SignalError(str(refused)) from error
        raise SignalError(f"{name}: a value is missing or cannot be represented: {error}") from error

    def _place(self, index: int) -> str:
        return f"{self._layout.message_name}.{self._layout.fields[index].name}"


def _allowed(field: _Field, checked: bool) -> str:
    if field.is_float and not (checked and (field.minimum is not None or field.maximum is not None)):
        return f"a finite number of {field.width} bits"
    if checked and field._enumeration():
        return f"one of {_listed(sorted(field._enumeration()))}"
    if checked and (field.minimum is not None or field.maximum is not None):
        low = "-inf" if field.minimum is None else field.minimum
        high = "inf" if field.maximum is None else field.maximum
        return f"in [{low}, {high}]"
    ends = sorted(field.scaled(raw) for raw in (field.raw_minimum, field.raw_maximum))
    return f"in [{ends[0]}, {ends[1]}], what {field.width} bits can hold"


def _listed(numbers: Sequence[int]) -> str:
    shown = ", ".join(map(str, numbers[:20]))
    return f"{{{shown}, …}}" if len(numbers) > 20 else f"{{{shown}}}"
