"""Immutable values that are cheap to define and to build: the loop makes several for each sample.

A frozen dataclass takes half a millisecond to define, and assigns each field by a call of `object.__setattr__`; a
`Value` takes 20 µs, and its constructor is written in C. State that the loop writes for each sample is a dataclass,
whose fields are quicker to assign.
"""

from dataclasses import Field, field, fields, make_dataclass
from functools import cache
from typing import Any, ClassVar, NoReturn

import msgspec


class Value(msgspec.Struct, frozen=True):
    """A value type: immutable, compared and hashed by its fields.

    `dataclasses.fields`, `replace`, `asdict` and `astuple` take it as they take a dataclass. Its `__post_init__` sets
    fields with `msgspec.structs.force_setattr`.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


class _NoDataclassParams:
    """What `@dataclass` asks each base for: a subclass needs no decorator, and has no place for one."""

    def __get__(self, _: object, kind: type[Value]) -> NoReturn:
        raise AttributeError(
            f"{kind.__name__} is no dataclass: declare a subclass of it without @dataclass, "
            "as in class Mine(BehaviorConfig, frozen=True, kw_only=True)"
        )


class _DataclassFields:
    """The `__dataclass_fields__` of each value type, made when they are first asked for."""

    def __get__(self, _: object, kind: type[Value]) -> dict[str, Field[Any]]:
        return _describe(kind)


@cache
def _describe(kind: type[Value]) -> dict[str, Field[Any]]:
    described = [(each.name, each.type, _default(each)) for each in msgspec.structs.fields(kind)]
    twin = make_dataclass(kind.__name__, described, kw_only=True, init=False, repr=False, eq=False)
    return {one.name: one for one in fields(twin)}


def _default(one: msgspec.structs.FieldInfo) -> Any:
    if one.default_factory is not msgspec.NODEFAULT:
        return field(default_factory=one.default_factory)
    return field() if one.default is msgspec.NODEFAULT else field(default=one.default)


Value.__dataclass_fields__ = _DataclassFields()  # type: ignore[assignment]
Value.__dataclass_params__ = _NoDataclassParams()  # type: ignore[attr-defined]
