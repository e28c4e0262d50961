"""Compiles a CAN message to two straight-line functions, so that the loop builds no dictionaries.

One `struct.unpack` splits the payload into words, one set for each byte order and multiplexer branch. A signal is a
word, or a shift and a mask of a word, followed by scaling. Encoding combines the raw numbers into one integer.
`MessageCodec` generates this as Python source once, when it is built, and compiles it. Scaling and rounding follow
cantools' conversions, so that both produce the same bits.
"""

import math
import struct
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NoReturn

from vehicle_iface import checks
from vehicle_iface.codec.cantools_classes import Message
from vehicle_iface.codec.codegen import generate_decode_source, generate_encode_source
from vehicle_iface.codec.layout import Field, Layout, SignalRules
from vehicle_iface.errors import InvalidValueError, SignalError

Value = float | int | None
"""A signal's value: an int if scale and offset are whole, None for a signal of another multiplexer branch."""

_FOREIGN = (TypeError, ValueError, ArithmeticError, AttributeError, struct.error)


class MessageCodec:
    """The codec of one message.

    `decode(data)` takes a payload and returns the values in the order of `names`: ints and floats in the DBC's units,
    enumerated signals as numbers, None for signals of another multiplexer branch. `encode(values)` takes values in the
    same order and returns the payload; unused bits are 0.

    With `checked`, both raise `SignalError` for a wrong length, a value that is not finite or outside the DBC's range,
    a number that the signal's VAL_ table does not name, and an unknown multiplexer value. A VAL_ table counts as an
    enumeration if the signal is among `enumerated`, or if the signal is unscaled and without unit, and the table counts
    up from the bottom of the range and stays in it. In any other table, entries outside the range mark missing values
    ("not available") and are rejected as such.

    Without `checked`, the values are those of cantools with `decode_choices=False`, and longer payloads are cut as
    cantools does. `SignalError` is then raised only for values that cannot be represented at all.

    Raises `ConfigError` with name and reason if the message cannot be compiled.
    """

    __slots__ = ("base", "checked", "decode", "encode", "layout", "length", "message_name", "names", "source")

    def __init__(
        self,
        message: Message,
        checked: bool = True,
        *,
        only: Collection[str] | None = None,
        rules: Mapping[str, SignalRules] | None = None,
        base: bytes | None = None,
    ) -> None:
        """With `only`, the codec contains these signals and the multiplexers above them.

        `rules` take precedence over the DBC. `base` is a payload with the bits of all other signals, multiplexers
        included.
        """
        layout = Layout.of(message, only, rules, is_flat=base is not None)
        self.layout: Layout = layout
        self.base: bytes = base or bytes(message.length)
        """The bits of all signals that are not in the layout."""
        self.message_name: str = message.name
        self.names: tuple[str, ...] = tuple(field.name for field in layout.fields)
        """Signal names, in the order of the values."""
        self.length: int = message.length
        """Payload, bytes."""
        self.checked: bool = checked
        self.source: str = (
            generate_decode_source(layout, checked) + "\n\n" + generate_encode_source(layout, checked, base or b"")
        )
        """The generated functions, for reading."""
        names = _Failures(layout, checked).names() | _runtime_names(layout)
        exec(compile(self.source, f"<codec of {message.name}>", "exec"), names)
        self.decode: Callable[[bytes], tuple[Value, ...]] = names["decode"]  # type: ignore[assignment]
        self.encode: Callable[[Sequence[Value]], bytes] = names["encode"]  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"MessageCodec({self.message_name}, {self.length} bytes, checked={self.checked})"


def _runtime_names(layout: Layout) -> dict[str, object]:
    names: dict[str, object] = {
        "Struct": struct.Struct,
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
    """Return the functions from IEEE 754 bits to a number and back, for a width of 16, 32 or 64 bits."""
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
    """The error functions that the generated source calls. Each raises a `SignalError` with message, signal, value and
    what is allowed."""

    def __init__(self, layout: Layout, checked: bool) -> None:
        self._layout = layout
        self._checked = checked

    def names(self) -> dict[str, object]:
        """Return the names under which the generated source finds these functions."""
        return {
            "refuse": self.refuse,
            "unknown": self.unknown,
            "absent": self.absent,
            "wrong_count": self.wrong_count,
            "explain_decode": self.explain_decode,
            "explain_encode": self.explain_encode,
        }

    def refuse(self, index: int, value: object) -> NoReturn:
        field = self._layout.fields[index]
        raise SignalError(f"{self._place(index)} = {value!r}: must be {_describe_allowed(field, self._checked)}")

    def unknown(self, index: int, number: int) -> NoReturn:
        branches = self._layout.branches[self._layout.fields[index].name]
        known = sorted(number for branch in branches for number in branch.ids)
        raise SignalError(f"{self._place(index)} = {number}: must be a multiplexer id of {_list_numbers(known)}")

    def absent(self, index: int, value: object) -> NoReturn:
        multiplexer = self._layout.fields[index].parent
        raise SignalError(f"{self._place(index)} = {value!r}: must be None, {multiplexer} hides this signal")

    def wrong_count(self, values: Sequence[Value]) -> NoReturn:
        count = len(self._layout.fields)
        raise SignalError(f"{self._layout.message_name}: {len(values)} values: must be {count}")

    def explain_decode(self, data: object, error: Exception) -> NoReturn:
        name, length = self._layout.message_name, self._layout.length
        if isinstance(data, bytes) and len(data) != length:
            raise SignalError(f"{name}: {len(data)} bytes: must be {length}") from error
        raise SignalError(f"{name}: {data!r} cannot be decoded: {error}") from error

    def explain_encode(self, values: object, error: Exception) -> NoReturn:
        """Raise a `SignalError` for the value that made the arithmetic fail."""
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


def _describe_allowed(field: Field, checked: bool) -> str:
    if field.is_float and not (checked and (field.minimum is not None or field.maximum is not None)):
        return f"a finite number of {field.width} bits"
    if checked and field.enumeration():
        return f"one of {_list_numbers(sorted(field.enumeration()))}"
    if checked and (field.minimum is not None or field.maximum is not None):
        low = "-inf" if field.minimum is None else field.minimum
        high = "inf" if field.maximum is None else field.maximum
        return f"in [{low}, {high}]"
    ends = sorted(field.scaled(raw) for raw in (field.raw_minimum, field.raw_maximum))
    return f"in [{ends[0]}, {ends[1]}], what {field.width} bits can hold"


def _list_numbers(numbers: Sequence[int]) -> str:
    shown = ", ".join(map(str, numbers[:20]))
    return f"{{{shown}, …}}" if len(numbers) > 20 else f"{{{shown}}}"
