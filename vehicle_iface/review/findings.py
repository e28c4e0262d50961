"""What a review finds, for people and programs."""

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How much a finding matters."""

    CONTRADICTION = "contradiction"
    """The drive contradicts the profile."""
    DOUBT = "doubt"
    """It may be wrong, or the drive does not tell."""
    NOTE = "note"
    """Worth knowing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One sentence about one thing."""

    level: Level
    about: str
    """MESSAGE.SIGNAL, a message, or a key of the profile."""
    text: str
    fix: str = ""
    """Lines for the profile."""


class Judgement(Enum):
    """What the drive says about one binding."""

    AGREES = "agrees"
    CONTRADICTED = "contradicted"
    UNKNOWN = "cannot tell"


@dataclass(frozen=True, slots=True, kw_only=True)
class BindingVerdict:
    """One field of the profile and its signal."""

    field: str
    signal: str
    judgement: Judgement
    text: str
    relations: tuple[str, ...]
    """Keys of those that it was measured by."""
