"""When the simulated vehicle sends which message: each at its own period, on one absolute grid."""

from collections.abc import Mapping
from typing import NamedTuple


class Due(NamedTuple):
    """What is sent now."""

    messages: tuple[str, ...]
    """In the order of the schedule."""
    instant_ns: int
    """The newest of the instants at which they were due."""
    missed: int
    """Instants of the most frequent message that passed without it."""


class SendSchedule:
    """The periods of all messages; instants that were missed are not made up for."""

    def __init__(self, periods_ns: Mapping[str, int], start_ns: int) -> None:
        self._periods_ns, self._start_ns = dict(periods_ns), start_ns
        self._sent = dict.fromkeys(periods_ns, -1)
        self._shortest = min(periods_ns, key=lambda name: periods_ns[name])

    @property
    def next_due_ns(self) -> int:
        """When the next message is due."""
        sent = self._sent
        return self._start_ns + min([(sent[name] + 1) * period_ns for name, period_ns in self._periods_ns.items()])

    def take_due(self, now_ns: int) -> Due | None:
        """The messages that are due, each once; None where there are none."""
        passed_ns, sent = now_ns - self._start_ns, self._sent
        numbers = {name: passed_ns // period_ns for name, period_ns in self._periods_ns.items()}
        due = tuple([name for name, number in numbers.items() if number > sent[name]])
        if not due:
            return None
        missed = max(0, numbers[self._shortest] - sent[self._shortest] - 1)
        instant_ns = max([numbers[name] * self._periods_ns[name] for name in due])
        sent.update(numbers)
        return Due(due, self._start_ns + instant_ns, missed)
