"""What a draft binds, and how much of it a person who knows the vehicle would bind as well."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from vehicle_iface.drafting import Draft, draft_profile, write_draft

SECTIONS = ("state", "status", "command", "body", "report")
Bindings = dict[str, object]
"""`section.field` → the signal, signals or form, as in the file."""


@dataclass(frozen=True, slots=True)
class Score:
    """A draft against the truth."""

    right: int
    wrong: tuple[str, ...]
    """Bound to another signal, or although the truth does not bind it."""
    missing: tuple[str, ...]


def bindings_of(profile: Path) -> Bindings:
    """All bindings in a profile."""
    return _collect(tomllib.loads(profile.read_text(encoding="utf-8")))


def bindings_of_draft(draft: Draft) -> Bindings:
    """The same of a draft, with those that are only comments in this version."""
    lines = write_draft(draft).splitlines()
    commented = {f'# {name} = "' for section, name in draft.fields if section == "command" and _is_bound(draft, name)}
    text = "\n".join(line.removeprefix("# ") if line.startswith(tuple(commented)) else line for line in lines)
    return _collect(tomllib.loads(text))


def _is_bound(draft: Draft, name: str) -> bool:
    return draft.fields["command", name].value is not None


def _collect(document: dict[str, object]) -> Bindings:
    found: Bindings = {}
    for section in SECTIONS:
        table = document.get(section)
        if isinstance(table, dict):
            found |= {f"{section}.{field}": value for field, value in table.get("signals", {}).items()}
            found |= {f"{section}.when.{mode}": value for mode, value in table.get("when", {}).items()}
    return found


def compare(profile: Path) -> Score:
    """The draft for a profile's DBC against the profile."""
    truth = bindings_of(profile)
    document = tomllib.loads(profile.read_text(encoding="utf-8"))
    drafted = bindings_of_draft(draft_profile(profile.parent / str(document["dbc"])))
    return Score(
        right=sum(drafted.get(place) == value for place, value in truth.items()),
        wrong=tuple(place for place, value in drafted.items() if truth.get(place) != value),
        missing=tuple(place for place in truth if place not in drafted),
    )
