"""Joins the DBCs of a profile's buses. A message name that several DBCs have becomes `BUS:MESSAGE`."""

import dataclasses
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from vehicle_iface.codec.dbc_file import DbcFile, read_dbc
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile
from vehicle_iface.profile.bus_names import rename_messages


class ResolvedNames(NamedTuple):
    """A profile whose message names are those of the joined DBCs."""

    profile: Profile
    faults: list[str]
    """Names whose bus is missing or wrong, each as `place: text`."""


def read_dbcs(profile: Profile) -> DbcFile:
    """Load and join all DBCs of a profile.

    Raises `ConfigError` with the faults of every file that cannot be used.
    """
    if profile.bus is not None:
        return read_dbc(Path(profile.dbc))
    files: dict[str, DbcFile] = {}
    errors: list[str] = []
    for name, bus in profile.buses.items():
        try:
            files[name] = read_dbc(Path(bus.dbc))
        except ConfigError as error:
            errors.append(str(error))
    if errors:
        raise ConfigError("\n".join(dict.fromkeys(errors)))
    return _join(files)


def resolve_names(profile: Profile, parts: Mapping[str, DbcFile]) -> ResolvedNames:
    """Return the profile with the message names of the joined files.

    A name that several buses have must be written as `BUS:MESSAGE`; otherwise it is reported in `faults`.
    """
    owners: dict[str, list[str]] = {}
    for bus, part in parts.items():
        for name in _message_names(part):
            owners.setdefault(name.rpartition(":")[2], []).append(bus)
    faults: list[str] = []

    def resolve(place: str, message: str) -> str:
        bus, _, name = message.rpartition(":")
        found = owners.get(name, [])
        if not found or (bus and bus not in parts):
            return message  # reported as a message that is missing
        if not bus and len(found) > 1:
            ways = " or ".join(f"{one}:{name}" for one in found)
            faults.append(f"{place}: {name} is on the buses {' and '.join(found)}; write {ways}")
        elif bus and bus not in found:
            faults.append(f"{place}: {name} is not on the bus {bus}, but on {' and '.join(found)}")
        return name if len(found) == 1 else f"{bus if bus in found else found[0]}:{name}"

    renamed = rename_messages(profile, resolve)
    return ResolvedNames(renamed.profile, [*dict.fromkeys(faults), *renamed.faults])


def _join(files: Mapping[str, DbcFile]) -> DbcFile:
    counts = Counter(name for file in files.values() for name in _message_names(file))
    parts = {bus: _qualify(file, bus, counts) for bus, file in files.items()}
    return DbcFile(
        name=" or ".join(dict.fromkeys(part.name for part in parts.values())),
        messages={name: message for part in parts.values() for name, message in part.messages.items()},
        lines={dotted: line for part in parts.values() for dotted, line in part.lines.items()},
        findings=tuple(finding for part in parts.values() for finding in part.findings),
        e2e={name: stated for part in parts.values() for name, stated in part.e2e.items()},
        parts=parts,
    )


def _message_names(file: DbcFile) -> list[str]:
    """The names of all messages, unusable ones included."""
    return [dotted for dotted in file.lines if "." not in dotted]


def _qualify(file: DbcFile, bus: str, counts: Mapping[str, int]) -> DbcFile:
    """Prefix the messages whose names occur on several buses with the name of this bus."""

    def rename(dotted: str) -> str:
        return f"{bus}:{dotted}" if counts[dotted.partition(".")[0]] > 1 else dotted

    for message in file.messages.values():
        message.name = rename(message.name)
    return dataclasses.replace(
        file,
        messages={message.name: message for message in file.messages.values()},
        lines={rename(dotted): line for dotted, line in file.lines.items()},
        e2e={rename(name): stated for name, stated in file.e2e.items()},
        findings=tuple(
            dataclasses.replace(finding, about=tuple(map(rename, finding.about))) for finding in file.findings
        ),
    )
