"""Messages of the profile's `[[send]]`: sent once when a phase begins, or periodically while it lasts.

A periodic message with a value that depends on a phase is sent at once when the phase begins or ends. So a vehicle that
such a value releases does not wait for the message's period, and the run does not end before it is sent.
"""

from collections.abc import Callable, Iterable

import msgspec

from vehicle_iface.command import Phases
from vehicle_iface.profile.sends import SentMessage, ValueTable
from vehicle_iface.runtime.transmitter import Transmitter
from vehicle_iface.units import ns_from_s


class _Entry(msgspec.Struct, eq=False):
    message: str
    when: str
    period_ns: int | None
    """The period; None for a message that is sent once."""
    watched: tuple[str, ...]
    """The phases that its values depend on."""
    holds: bool = False
    sent_in: Phases | None = None
    """The phases in which it was sent last."""
    next_ns: int | None = None
    """Time at which the message is due; None while it is not scheduled."""


class ScheduledSends:
    """Sends each message when it is due; one that finds no room stays due while its phase lasts."""

    def __init__(
        self,
        sends: Iterable[SentMessage],
        transmitter: Transmitter,
        find_phases: Callable[[int], Phases],
        *,
        sample_period_ns: int,
    ) -> None:
        """Samples arrive unevenly, so a message that is due within half of `sample_period_ns` is sent with the present
        one."""
        self._transmitter, self._find_phases, self._slack_ns = transmitter, find_phases, sample_period_ns // 2
        self._entries = [
            _Entry(one.message, one.when, None if one.period_s is None else ns_from_s(one.period_s), _find_watched(one))
            for one in sends
        ]

    def send_due(self, now_ns: int, *, only_once: bool = False) -> None:
        """Send what is due; where `only_once`, nothing periodic: it is sent behind the answers to samples."""
        if not self._entries:
            return
        phases = self._find_phases(now_ns)
        for entry in self._entries:
            held, entry.holds = entry.holds, getattr(phases, entry.when)
            if not entry.holds:
                entry.next_ns = None
            elif not held:
                entry.next_ns = now_ns
            has_changed = entry.sent_in is not None and _differ(entry.sent_in, phases, entry.watched)
            if entry.next_ns is not None and has_changed:
                entry.next_ns = now_ns
            if entry.next_ns is None or now_ns < entry.next_ns - self._slack_ns:
                continue
            if only_once and entry.period_ns is not None and not has_changed:
                continue
            if self._transmitter.has_room() and self._transmitter.send(entry.message, None):
                entry.next_ns, entry.sent_in = self._next_ns(entry, entry.next_ns, now_ns), phases

    def _next_ns(self, entry: _Entry, due_ns: int, now_ns: int) -> int | None:
        """Return the next time on the grid that starts with the phase; missed times are left out."""
        if entry.period_ns is None:
            return None
        missed = max(0, (now_ns - due_ns) // entry.period_ns)
        return due_ns + (missed + 1) * entry.period_ns


def _differ(before: Phases, after: Phases, watched: Iterable[str]) -> bool:
    """Whether one of the watched phases began or ended."""
    return before != after and any(getattr(before, name) is not getattr(after, name) for name in watched)


def _find_watched(sent: SentMessage) -> tuple[str, ...]:
    """Return the phases that the values of a periodic message depend on."""
    if sent.once:
        return ()
    tables = (value for value in sent.values.values() if isinstance(value, ValueTable))
    return tuple(table.when for table in tables if table.when is not None)
