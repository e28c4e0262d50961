"""Transmit schedule of the simulated vehicle: each message at its own period, on one absolute time grid."""

from collections.abc import Mapping
from typing import NamedTuple


class Due(NamedTuple):
    """Messages to send now."""

    messages: tuple[str, ...]
    """Message names in the order of the schedule."""
    instant_ns: int
    """Newest instant at which they were due."""
    missed: int
    """Number of missed instants of the most frequent message."""


class SendSchedule:
    """The periods of all messages; missed instants are skipped."""

    def __init__(self, periods_ns: Mapping[str, int], start_ns: int) -> None:
        self._messages, self._start_ns = tuple(periods_ns.items()), start_ns
        self._sent = dict.fromkeys(sorted(periods_ns.values()), -1)
        """Number of the newest instant of each period, the shortest first."""

    @property
    def next_due_ns(self) -> int:
        """Time at which the next message is due."""
        return self._start_ns + min([(number + 1) * period_ns for period_ns, number in self._sent.items()])

    def take_due(self, now_ns: int) -> Due | None:
        """Return the messages that are due, each once; None where there are none."""
        passed_ns, sent = now_ns - self._start_ns, self._sent
        numbers = {period_ns: passed_ns // period_ns for period_ns in sent}
        due = {period_ns: number for period_ns, number in numbers.items() if number > sent[period_ns]}
        if not due:
            return None
        shortest_ns, newest = next(iter(sent.items()))
        missed = max(0, numbers[shortest_ns] - newest - 1)
        sent.update(due)
        instant_ns = self._start_ns + max([number * period_ns for period_ns, number in due.items()])
        return Due(tuple([name for name, period_ns in self._messages if period_ns in due]), instant_ns, missed)
