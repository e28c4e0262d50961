"""The functions of `dataclasses` take a value type as they take a dataclass."""

import dataclasses

import msgspec
import pytest

from vehicle_iface.value import Value


class Size(Value, frozen=True, kw_only=True):
    """A value with each kind of default."""

    width_m: float
    height_m: float = 1.5
    names: list[str] = msgspec.field(default_factory=list)


class NamedSize(Size, frozen=True, kw_only=True):
    """A value type below another."""

    name: str


def test_fields_have_names_types_and_defaults() -> None:
    width, height, names = dataclasses.fields(Size)
    assert (width.name, width.type, width.default) == ("width_m", float, dataclasses.MISSING)
    assert (height.name, height.default) == ("height_m", 1.5)
    assert names.default_factory is list
    assert [one.name for one in dataclasses.fields(NamedSize)] == ["width_m", "height_m", "names", "name"]


def test_replace_and_asdict_take_it() -> None:
    value = NamedSize(width_m=2.0, name="van")
    assert dataclasses.replace(value, width_m=3.0) == NamedSize(width_m=3.0, name="van") != value
    assert dataclasses.asdict(value) == {"width_m": 2.0, "height_m": 1.5, "names": [], "name": "van"}


def test_it_cannot_be_changed() -> None:
    value = Size(width_m=2.0)
    with pytest.raises(AttributeError):
        value.width_m = 3.0  # type: ignore[misc]


def test_a_subclass_with_the_decorator_of_dataclasses_is_refused_with_the_way_on() -> None:
    with pytest.raises(AttributeError, match="declare a subclass of it without @dataclass, as in class Mine"):
        dataclasses.make_dataclass("Wrong", [("depth_m", float)], bases=(Size,), frozen=True)
