"""What the names of a profile stand for in its DBC: each signal's field, each message's role.

A name that the DBC does not have is left out here; `consistency` reports it.
"""

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from pathlib import Path

import msgspec
from cantools.database import Message, Signal

from vehicle_iface.codec.dbc_file import DbcFile
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile


class Role(Enum):
    """What the program uses a message for."""

    SAMPLE = "sample"
    """Received: a part of one sample of the state."""
    STATUS = "status"
    """Received: mode, gear, driver."""
    AUXILIARY = "auxiliary"
    """Received: further fields of state or status."""
    COMMAND = "command"
    """Sent, one frame for each computed command."""
    BODY = "body"
    """Sent: lights and horn."""
    REPORT = "report"
    """Sent: the controller's state."""


SENT_ROLES = (Role.COMMAND, Role.BODY, Role.REPORT)
PERIODS = {
    Role.SAMPLE: "sample_period_s",
    Role.STATUS: "status_period_s",
    Role.COMMAND: "command_period_s",
    Role.BODY: "body_period_s",
    Role.REPORT: "report_period_s",
}
"""The key of the profile's timing that states the period of a role's messages."""


class Binding:
    """One profile's names, looked up in one DBC."""

    def __init__(self, profile: Profile, file: DbcFile) -> None:
        self.profile = profile
        self.file = file
        self.profile_name = Path(profile.file).name or profile.name
        """For error messages."""
        self.messages: Mapping[str, Message] = {message.name: message for message in file.database.messages}
        self.sections: Mapping[str, Mapping[str, tuple[str, ...]]] = {
            "state": _named_signals(profile.state.signals),
            "status": _named_signals(profile.status.signals),
            "command": _named_signals(profile.command.signals),
            "body": _named_signals(profile.body.signals) if profile.body else {},
            "report": _named_signals(profile.report.signals) if profile.report else {},
        }
        """Section of the profile → field → its signals as MESSAGE.SIGNAL."""
        self.fields: Mapping[str, str] = self._fields()
        """MESSAGE.SIGNAL → its field; the first one where the profile names several."""
        self.roles: Mapping[str, Role] = self._roles()
        """Each bound message's role; the first one where the profile gives it several."""

    def find_signal(self, dotted: str) -> Signal | None:
        """The signal of a MESSAGE.SIGNAL."""
        message_name, _, name = dotted.partition(".")
        message = self.messages.get(message_name)
        if message is None:
            return None
        return next((signal for signal in message.signals if signal.name == name), None)

    def get_signals(self, section: str, field: str) -> dict[str, Signal]:
        """MESSAGE.SIGNAL → signal, of those of a field that the DBC has."""
        found = {dotted: self.find_signal(dotted) for dotted in self.sections[section].get(field, ())}
        return {dotted: signal for dotted, signal in found.items() if signal is not None}

    def is_protected(self, message_name: str) -> bool:
        """Whether the profile gives the message a checksum and a counter."""
        return self.profile.e2e is not None and message_name in self.profile.e2e.data_ids

    def fault(self, place: str, text: str) -> ConfigError:
        """An error about a place in the profile."""
        return ConfigError(f"{self.profile_name}: {place}: {text}")

    def role_claims(self) -> Iterator[tuple[str, Role]]:
        """Each message with each role that the profile gives it; within a role in the order of the DBC."""
        yield from ((name, Role.SAMPLE) for name in self.profile.state.sample if name in self.messages)
        mode_message = self.profile.status.signals.mode.partition(".")[0]
        if mode_message in self.messages:
            yield mode_message, Role.STATUS
        for role, sections in (
            (Role.AUXILIARY, ("state", "status")),
            (Role.COMMAND, ("command",)),
            (Role.BODY, ("body",)),
            (Role.REPORT, ("report",)),
        ):
            used = {
                dotted.partition(".")[0]
                for section in sections
                for signals in self.sections[section].values()
                for dotted in signals
            }
            yield from ((name, role) for name in self.messages if name in used)

    def _fields(self) -> dict[str, str]:
        fields: dict[str, str] = {}
        for bindings in self.sections.values():
            for field, signals in bindings.items():
                for dotted in signals:
                    if self.find_signal(dotted) is not None:
                        fields.setdefault(dotted, field)
        return fields

    def _roles(self) -> dict[str, Role]:
        roles: dict[str, Role] = {}
        for name, role in self.role_claims():
            roles.setdefault(name, role)
        return roles


def _named_signals(signals: msgspec.Struct) -> dict[str, tuple[str, ...]]:
    """Field → its signals, without the fields that are not bound."""
    places = {field: getattr(signals, field) for field in signals.__struct_fields__}
    return {
        field: (value,) if isinstance(value, str) else tuple(value)
        for field, value in places.items()
        if value is not None
    }


def suggest(name: str, names: Iterable[str]) -> str:
    """The names that are most like `name`, for the end of an error message."""
    found = difflib.get_close_matches(name, list(names), n=3, cutoff=0.4)
    return f"; nearest: {', '.join(found)}" if found else ""


def value_range(signal: Signal) -> tuple[float, float]:
    """Smallest and greatest value that both the bits and the [min|max] of a signal allow."""
    if signal.is_float:
        low, high = -math.inf, math.inf
    else:
        raw_low = -(1 << signal.length - 1) if signal.is_signed else 0
        raw_high = (1 << signal.length - bool(signal.is_signed)) - 1
        low, high = sorted(raw * signal.scale + signal.offset for raw in (raw_low, raw_high))
    if signal.minimum is not None:
        low = max(low, signal.minimum)
    if signal.maximum is not None:
        high = min(high, signal.maximum)
    return low, high


def resolution(signal: Signal) -> float:
    """The step of one count, in the signal's unit; 0 for a float."""
    return 0.0 if signal.is_float else abs(float(signal.scale))
