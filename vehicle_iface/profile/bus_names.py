"""Rename messages and signals in a profile, for names that depend on the buses: `ins:STATUS.MODE`."""

from collections.abc import Callable
from typing import NamedTuple

import msgspec

from vehicle_iface.profile.schema import Profile

Rename = Callable[[str, str], str]
"""Place and name of a message → its name."""
_KEYS = (
    ("signals",),
    ("messages",),
    ("constants",),
    ("state", "max_age_s"),
    ("command", "periods"),
    ("command", "values"),
    ("e2e", "data_ids"),
    ("protection", "messages"),
)
"""Tables whose keys are names."""
_VALUES = (
    ("ignored",),
    ("state", "sample"),
    ("state", "trigger"),
    ("state", "signals"),
    ("state", "pose", "valid"),
    ("status", "signals"),
    ("status", "when"),
    ("status", "driver"),
    ("command", "signals"),
    ("body", "signals"),
    ("report", "signals"),
)
"""Tables whose values are names, or forms and conditions of names."""
_NO_NAMES = ("equals", "in")
"""Keys of conditions whose texts are names of values."""


class RenamedMessages(NamedTuple):
    """A profile with other names of messages."""

    profile: Profile
    faults: list[str]
    """Keys that have become equal, each as `place: text`."""


def rename_messages(profile: Profile, rename: Rename) -> RenamedMessages:
    """Return the profile with each name of a message as `rename` gives it, alone or in front of a signal's."""
    document: dict[str, object] = msgspec.to_builtins(profile)
    faults: list[str] = []

    def rename_name(place: str, name: str) -> str:
        message, dot, signal = name.partition(".")
        return rename(place, message) + dot + signal

    def rename_values(place: str, value: object) -> object:
        if isinstance(value, str):
            return rename_name(place, value)
        if isinstance(value, list | tuple):
            return [rename_values(f"{place}[{index}]", one) for index, one in enumerate(value)]
        if isinstance(value, dict):
            return {
                key: one if key in _NO_NAMES else rename_values(f"{place}.{key}", one) for key, one in value.items()
            }
        return value

    def rename_keys(place: str, table: object) -> object:
        if not isinstance(table, dict):
            return table
        names: dict[str, str] = {}
        for key in table:
            name = rename_name(f"{place}.{key}", key)
            if name in names:
                faults.append(f"{place}.{key}: is there as {names[name]} as well; remove one of them")
            names[name] = key
        return {name: table[key] for name, key in names.items()}

    for table in _KEYS:
        _replace(document, table, rename_keys)
    for place in _VALUES:
        _replace(document, place, rename_values)

    def rename_echoes(place: str, values: object) -> object:
        for signal, source in values.items() if isinstance(values, dict) else ():
            if isinstance(source, dict) and source.get("echo") is not None:
                source["echo"] = rename_name(f"{place}.{signal}.echo", source["echo"])
        return values

    _replace(document, ("command", "values"), rename_echoes)
    sends = document["send"]
    assert isinstance(sends, list | tuple)
    for index, sent in enumerate(sends):
        sent["message"] = rename_name(f"$.send[{index}].message", sent["message"])
        rename_echoes(f"$.send[{index}].values", sent["values"])
    return RenamedMessages(msgspec.convert(document, Profile), faults)


def _replace(document: dict[str, object], path: tuple[str, ...], change: Callable[[str, object], object]) -> None:
    """Replace the value at a path of tables, if there is one."""
    table: object = document
    for key in path[:-1]:
        table = table.get(key) if isinstance(table, dict) else None
    if isinstance(table, dict) and table.get(path[-1]) is not None:
        table[path[-1]] = change(f"$.{'.'.join(path)}", table[path[-1]])
