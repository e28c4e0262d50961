"""Stand-ins for values that are missing or faulty, so that the rest of a profile is checked in the same run.

A profile with a stand-in is only ever checked: it has faults, and is not loaded.
"""

import re
import typing
from collections.abc import Iterable, Iterator
from functools import cache

import msgspec

_CANDIDATES: tuple[object, ...] = (1.0, 0.0, -1.0, 1, "", [], [""], {}, [[0.0, 1.0]], [[0.0, 0.0], [1.0, 1.0]])
_MISSING = re.compile(r"(\w+) is missing\b")
_TELLING_KEYS = frozenset(("sample", "source", "longitudinal", "lateral"))
"""Keys of one plain word that other faults name; those of several words do not occur by chance."""
_NEAREST = re.compile(r"unknown key; did you mean '(\w+)'")


fields_of = cache(msgspec.structs.fields)
"""The fields of a table, which take a while to read from its annotations."""


def add_placeholders(sound: dict[str, object], kind: type[msgspec.Struct], document: dict[str, object]) -> None:
    """Fill in the keys that a table must have and that are not in its sound part."""
    for field in fields_of(kind):
        name = field.encode_name
        if field.required and name not in sound:
            sound.update((name, value) for value in _fitting(field.type, document.get(name)))


def _fitting(kind: object, value: object) -> Iterator[object]:
    """One value that the type allows, if one is known: of an enumeration the word that is most like `value`."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        table: dict[str, object] = {}
        add_placeholders(table, kind, {})
        yield table
        return
    words = typing.get_args(kind) if typing.get_origin(kind) is typing.Literal else ()
    for candidate in (*_nearest(value, words), *words, *_CANDIDATES):
        try:
            msgspec.convert(candidate, kind)
        except msgspec.ValidationError:
            continue
        yield candidate
        return


class FaultyPlaces:
    """The places of faults that were found first; what another check says about them follows from these."""

    def __init__(self, faults: Iterable[str]) -> None:
        self._places = {place for fault in faults for place in _places_of(fault)}

    def explain(self, fault: str) -> bool:
        """Whether a later fault is at one of the places, or below it, or names its key."""
        at = fault.partition(": ")[0]
        return any(
            at == place or at.startswith((f"{place}.", f"{place}[")) or _is_named(place, fault)
            for place in self._places
        )


def _is_named(place: str, fault: str) -> bool:
    key = re.sub(r"(\[\d*\])+$", "", place).rpartition(".")[2]
    return ("_" in key or key in _TELLING_KEYS) and re.search(rf"\b{re.escape(key)}\b", fault) is not None


def _places_of(fault: str) -> Iterator[str]:
    place, _, text = fault.partition(": ")
    if found := _MISSING.match(text) or _NEAREST.match(text):
        table = place if _MISSING.match(text) else place.rpartition(".")[0]
        yield f"{table}.{found[1]}"
    elif not text.startswith("unknown key"):
        yield place


def _nearest(value: object, words: tuple[object, ...]) -> list[str]:
    """The word that is most like `value`, if that is a text and there are words."""
    if not isinstance(value, str) or not words:
        return []
    import difflib  # only for an enumeration: it takes a while

    return difflib.get_close_matches(value, map(str, words), n=1, cutoff=0.0)
