"""What a type checker must not remember."""

from typing import TypeVar

T = TypeVar("T")


def at_present(value: T) -> T:
    """The same; mypy takes an attribute that was asserted to be something for that ever after, whatever is called."""
    return value
