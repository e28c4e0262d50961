"""Immutable values that are cheap to build: the loop makes several for each sample.

A frozen dataclass assigns each field by a call of `object.__setattr__`; the constructor of a `Value` is written in C.
"""

from dataclasses import Field, field, make_dataclass
from typing import Any, ClassVar, TypeVar

import msgspec


class Value(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """A value type: built by keyword alone, immutable, compared and hashed by its fields.

    The garbage collector does not visit it, so no field holds a container. Decorate each subclass with `as_dataclass`.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


AnyValue = TypeVar("AnyValue", bound=Value)


def as_dataclass(kind: type[AnyValue]) -> type[AnyValue]:
    """Let `dataclasses.fields`, `replace`, `asdict` and `astuple` take a value type as they take a dataclass."""
    described = [
        (each.name, each.type, field() if each.default is msgspec.NODEFAULT else field(default=each.default))
        for each in msgspec.structs.fields(kind)
    ]
    kind.__dataclass_fields__ = make_dataclass(kind.__name__, described, kw_only=True).__dataclass_fields__  # type: ignore[attr-defined]
    return kind
