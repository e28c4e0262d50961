"""Selects the command messages that are sent for a sample: each message on every n-th sample, by its period.

Commands are computed on every sample. Those of a message whose period is n samples are sent n samples apart, also after
a pause. A first enabled command, a stop and a release do not wait for their turn while the transmit filter has room;
the next one comes n samples later.
"""

from collections.abc import Iterable, Mapping

import msgspec

from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.command import SafeCommand
from vehicle_iface.safety.transmit_filter import TransmitFilter

_NEVER_NS = -(1 << 62)


class _Group(msgspec.Struct, eq=False):
    """Messages with the same period, which are sent together."""

    messages: tuple[BoundMessage, ...]
    names: frozenset[str]
    wait_ns: int
    """Least time between two frames; 0 if every sample gets one."""
    sent_ns: int = _NEVER_NS
    was_enabled: bool = False
    was_stop: bool = False


class CommandPace:
    """Selects the messages that are sent for each sample."""

    def __init__(
        self,
        commands: Iterable[BoundMessage],
        periods_ns: Mapping[str, int],
        *,
        sample_period_ns: int,
        transmit_filter: TransmitFilter,
        carries_enable: bool = True,
    ) -> None:
        """`periods_ns` maps message names to periods, which are whole multiples of the sample period.

        Command messages without an enable signal are sent only while commands are enabled.
        """
        self._carries_enable = carries_enable
        self._transmit_filter = transmit_filter
        by_count: dict[int, list[BoundMessage]] = {}
        for message in commands:
            by_count.setdefault(round(periods_ns[message.name] / sample_period_ns), []).append(message)
        self._groups = [
            _Group(
                tuple(messages),
                frozenset(message.name for message in messages),
                wait_ns=(2 * count - 1) * sample_period_ns // 2 if count > 1 else 0,  # half a period for uneven samples
            )
            for count, messages in sorted(by_count.items())
        ]
        self._has_waiting = any(group.wait_ns for group in self._groups)
        self.all_names = frozenset(name for group in self._groups for name in group.names)

    def select(self, command: SafeCommand, now_ns: int, *, is_newest: bool = True) -> frozenset[str]:
        """Return the messages in which this command is sent now.

        A command that is not for the newest sample is sent only in messages that every sample gets.
        """
        if not command.enable and not self._carries_enable:
            for group in self._groups:
                group.was_enabled = False
            return frozenset()
        if not self._has_waiting:
            return self.all_names
        due = [
            group.names
            for group in self._groups
            if not group.wait_ns or (is_newest and self._is_due(group, command, now_ns))
        ]
        return self.all_names if len(due) == len(self._groups) else frozenset[str]().union(*due)

    def commit(self, command: SafeCommand, now_ns: int, names: frozenset[str]) -> None:
        """Record that all frames of these messages were sent."""
        for group in self._groups:
            if group.names <= names:
                group.sent_ns, group.was_enabled, group.was_stop = now_ns, command.enable, command.safe_stop

    def _is_due(self, group: _Group, command: SafeCommand, now_ns: int) -> bool:
        if now_ns - group.sent_ns >= group.wait_ns:
            return True
        is_urgent = command.enable is not group.was_enabled or (command.safe_stop and not group.was_stop)
        return is_urgent and all(
            self._transmit_filter.has_room(
                message.can_id, message.is_extended, message.is_fd, message.length, now_ns, message.bus
            )
            for message in group.messages
        )
