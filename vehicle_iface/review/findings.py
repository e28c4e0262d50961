"""Findings of a review, for people and programs."""

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How much a finding matters."""

    CONTRADICTION = "contradiction"
    """The drive contradicts the profile."""
    DOUBT = "doubt"
    """The profile may be wrong, or the drive does not determine it."""
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
    """Lines for the profile that correct it."""


class Judgement(Enum):
    """Result of the drive for one binding."""

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
    """Keys of the relations that it was measured by."""
