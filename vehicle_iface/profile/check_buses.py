"""Check the tables of the buses, and the names that begin with the name of a bus."""

import re
from collections.abc import Iterator, Mapping

from vehicle_iface.profile.bus_names import rename_messages
from vehicle_iface.profile.schema import Profile

_NAME = re.compile(r"\w+")
_SHORT_FORM = ("dbc", "bus")
"""Keys that a profile with one bus may have instead of `[buses]`."""


def needed_keys(document: Mapping[str, object]) -> dict[str, str]:
    """Return the keys of the buses that a document needs, each with the end of its error."""
    return {} if "buses" in document else dict.fromkeys(_SHORT_FORM, "")


def check_bus_tables(document: Mapping[str, object]) -> Iterator[str]:
    """Check that there is either the short form or `[buses]`, each with a usable name."""
    buses = document.get("buses")
    if not isinstance(buses, dict):
        return
    for key in _SHORT_FORM:
        if key in document:
            yield f"$.{key}: is of the short form for one bus, and [buses] names the buses; keep one of them"
    if not buses:
        yield "$.buses: must have at least one table [buses.NAME]"
    for name in buses:
        if not _NAME.fullmatch(name):
            yield f"$.buses.{name}: {name!r}: must be a name of letters, digits and underscores"


def check_bus_names(profile: Profile) -> Iterator[str]:
    """Check that a message name with a bus prefix has the name of one of the profile's buses."""
    faults: list[str] = []

    def check(place: str, message: str) -> str:
        bus, colon, name = message.rpartition(":")
        if colon and not profile.buses:
            faults.append(f"{place}: {message}: the only bus has no name; write {name}, or name it with [buses.{bus}]")
        elif colon and bus not in profile.buses:
            faults.append(f"{place}: {message}: no bus {bus!r}; must be one of: {', '.join(profile.buses)}")
        return message

    rename_messages(profile, check)
    yield from faults
