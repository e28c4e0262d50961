"""Counts that rise for a while: when they began to, and when they have not risen any more for some time."""

from collections.abc import Callable, Hashable, Mapping
from typing import Generic, TypeVar

from vehicle_iface.telemetry.events import Phase
from vehicle_iface.units import NS_PER_MS
from vehicle_iface.value import Value

QUIET_NS = 500 * NS_PER_MS
"""A count that has not risen for this long has ended to rise."""


Name = TypeVar("Name", bound=Hashable)


class Change(Value, Generic[Name], frozen=True):
    """A count that began or ended to rise."""

    at_ns: int
    name: Name
    phase: Phase
    count: int
    """How far it has risen since it began."""
    duration_ns: int
    """From its first rise to its last."""


class _Rise:
    __slots__ = ("before", "began_ns", "last_ns")

    def __init__(self, before: int, now_ns: int) -> None:
        self.before, self.began_ns, self.last_ns = before, now_ns, now_ns


class Activity(Generic[Name]):
    """Watches some counts by name. While none has changed, a call compares two dictionaries."""

    def __init__(self, read: Callable[[], Mapping[Name, int]]) -> None:
        self._read = read
        self._seen = dict(read())
        self._rises: dict[Name, _Rise] = {}

    def poll(self, now_ns: int) -> list[Change[Name]]:
        """Return what began and ended since the last call."""
        counts, seen, rises = self._read(), self._seen, self._rises
        found: list[Change[Name]] = []
        if counts != seen:
            for name, count in counts.items():
                before = seen.get(name, 0)
                if count == before:
                    continue
                seen[name] = count
                if name in rises:
                    rises[name].last_ns = now_ns
                else:
                    rises[name] = _Rise(before, now_ns)
                    found.append(Change(now_ns, name, Phase.BEGAN, count - before, 0))
        if rises:
            for name in [name for name, rise in rises.items() if now_ns - rise.last_ns >= QUIET_NS]:
                found.append(self._end(name))
        return found

    @property
    def lasting(self) -> list[Change[Name]]:
        """All that has begun to rise and has not ended yet, as if it ended now."""
        return [self._describe(name, rise) for name, rise in self._rises.items()]

    def _end(self, name: Name) -> Change[Name]:
        return self._describe(name, self._rises.pop(name))

    def _describe(self, name: Name, rise: _Rise) -> Change[Name]:
        count, duration_ns = self._seen[name] - rise.before, rise.last_ns - rise.began_ns
        return Change(rise.last_ns, name, Phase.ENDED, count, duration_ns)
