"""The messages of a vehicle's DBCs by name: one that several buses have is called BUS:MESSAGE."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from cantools.database.can import Database, Message

WITH_BUS = re.compile(r"(\w+):(\w+)((?:\.\w+)?)", re.ASCII)
NAMED_BY = (("messages",), ("protection", "messages"), ("e2e", "data_ids"), ("signals",))
"""The tables whose keys are messages or signals."""


class AmbiguousNameError(ValueError):
    """A message's name that several buses have."""


class Messages:
    """The messages of all buses, and the bus of each."""

    def __init__(self, databases: Mapping[str, Database]) -> None:
        self._homes: dict[str, list[str]] = {}
        for bus, database in databases.items():
            for name in dict.fromkeys(message.name for message in database.messages):
                self._homes.setdefault(name, []).append(bus)
        self._messages: dict[str, Message] = {}
        self._buses: dict[str, int] = {}
        for number, (bus, database) in enumerate(databases.items()):
            for message in database.messages:
                if len(self._homes[message.name]) > 1:
                    message.name = f"{bus}:{message.name}"
                self._messages[message.name], self._buses[message.name] = message, number

    def find(self, name: str) -> Message:
        """Raises `KeyError` for a message that no DBC has, and `AmbiguousNameError` for one that several have."""
        if len(self._homes.get(name, ())) > 1:
            raise self._ambiguous(name)
        return self._messages[name]

    def bus_of(self, name: str) -> int:
        """The number of the bus that a message is on."""
        return self._buses[name]

    def rename(self, profile: Mapping[str, Any]) -> dict[str, Any]:
        """The profile with the names of messages as they are here: a bus stands before a name that needs it only.

        Raises `AmbiguousNameError` for a table of a message whose bus is not said.
        """
        renamed: dict[str, Any] = self._rename(profile)
        for name in _keys(renamed):
            if len(self._homes.get(name, ())) > 1:
                raise self._ambiguous(name)
        return renamed

    def _rename(self, part: Any) -> Any:
        if isinstance(part, dict):
            return {self._rename(key): self._rename(value) for key, value in part.items()}
        if isinstance(part, list):
            return [self._rename(one) for one in part]
        found = WITH_BUS.fullmatch(part) if isinstance(part, str) else None
        return found[2] + found[3] if found is not None and self._homes.get(found[2]) == [found[1]] else part

    def _ambiguous(self, name: str) -> AmbiguousNameError:
        homes = self._homes[name]
        ways = " or ".join(f"{bus}:{name}" for bus in homes)
        return AmbiguousNameError(f"{name} is on the buses {' and '.join(homes)}; write {ways}")


def _keys(profile: Mapping[str, Any]) -> Iterator[str]:
    for path in NAMED_BY:
        table: Any = profile
        for part in path:
            table = table.get(part, {})
        yield from (str(key).partition(".")[0] for key in table)
