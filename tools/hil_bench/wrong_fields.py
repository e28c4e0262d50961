"""What can be wrong with a field of the state: frozen, scaled, or swapped with another."""

from collections.abc import Callable
from dataclasses import dataclass

from hil_bench.contradictions import Told

Change = Callable[[Told, Told], dict[str, float]]
"""The fields that are told otherwise, by what is true now and what was true when the fault began."""


@dataclass(frozen=True, kw_only=True)
class WrongFields:
    """One fault of one or two fields."""

    name: str
    fields: tuple[str, ...]
    change: Change

    def tell(self, true: Told, first: Told) -> dict[str, float]:
        """All fields as they are told."""
        return {**true, **self.change(true, first)}


def frozen(field: str) -> WrongFields:
    """It keeps the value that it had."""
    return WrongFields(name=f"{field} frozen", fields=(field,), change=lambda _, first: {field: first[field]})


def scaled(field: str, by: float) -> WrongFields:
    """It is multiplied."""
    return WrongFields(name=f"{field} times {by:g}", fields=(field,), change=lambda true, _: {field: by * true[field]})


def swapped(one: str, other: str) -> WrongFields:
    """Each of two has the value of the other."""
    return WrongFields(
        name=f"{one} and {other} swapped",
        fields=(one, other),
        change=lambda true, _: {one: true[other], other: true[one]},
    )
