"""What is too much: of which kind, the value, and its limit."""

from enum import Enum
from typing import NamedTuple


class Excess(NamedTuple):
    """A value beyond its limit."""

    kind: Enum
    name: str
    """Of the value, with its unit."""
    value: float
    limit: float

    def __str__(self) -> str:
        return f"{self.kind.value}: {self.name} = {self.value:.4g}, limit {self.limit:.4g}"
