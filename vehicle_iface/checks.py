"""Checks that data types run when they are built. Each returns the value as a plain Python type or raises
`InvalidValueError` with the field's name, the value and what is allowed."""

import math
import operator

from vehicle_iface.errors import InvalidValueError

FRAME_ID_BYTES = 64
"""Of a frame of reference's name in UTF-8: what telemetry has room for."""


def finite(name: str, value: object) -> float:
    """`value` as a finite Python float; bools and text are not numbers here."""
    if type(value) is float and math.isfinite(value):  # nearly always: the values of every sample
        return value
    if isinstance(value, bool | str | bytes):
        raise InvalidValueError(f"{name} = {value!r}: must be a finite number")
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(f"{name} = {value!r}: must be a finite number") from None
    if not math.isfinite(number):
        raise InvalidValueError(f"{name} = {number}: must be a finite number")
    return number


def positive(name: str, value: object) -> float:
    """`value` as a finite Python float above zero."""
    number = finite(name, value)
    if number <= 0.0:
        raise InvalidValueError(f"{name} = {number}: must be above 0")
    return number


def non_negative(name: str, value: object) -> float:
    """`value` as a finite Python float of at least zero."""
    number = finite(name, value)
    if number < 0.0:
        raise InvalidValueError(f"{name} = {number}: must be at least 0")
    return number


def integer(name: str, value: object) -> int:
    """`value` as a Python int; floats are rejected even when whole, because stamps lose nanoseconds in them."""
    if isinstance(value, bool):
        raise InvalidValueError(f"{name} = {value!r}: must be an integer")
    try:
        return operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise InvalidValueError(f"{name} = {value!r}: must be an integer") from None


def frame_id(name: str, value: object) -> str:
    """`value` as the name of a frame of reference: text that can be printed, of 1 to `FRAME_ID_BYTES` bytes."""
    if not isinstance(value, str) or not value or not value.isprintable():
        raise InvalidValueError(f"{name} = {value!r}: must be the name of a frame of reference, like 'map'")
    if len(value.encode()) > FRAME_ID_BYTES:
        raise InvalidValueError(f"{name} = {value!r}: must be at most {FRAME_ID_BYTES} bytes in UTF-8")
    return value
