"""Looks up the signals and messages of a profile in its DBC: each signal's field, and each message's role.

A name that the DBC does not have is left out here; `consistency` reports it.
"""

from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import NamedTuple

import msgspec

from vehicle_iface.codec.bus_files import ResolvedNames, resolve_names
from vehicle_iface.codec.cantools_classes import Signal
from vehicle_iface.codec.dbc_file import DbcFile
from vehicle_iface.codec.protection_rules import find_rule
from vehicle_iface.codec.signal_view import SignalView
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile
from vehicle_iface.profile.forms import FieldForm, signals_of, value_of
from vehicle_iface.profile.notes import MessageNotes, SignalNotes
from vehicle_iface.profile.sends import SentValue, ValueTable
from vehicle_iface.profile.signals import DriverConditions, ModeConditions
from vehicle_iface.profile.state_pose import StatePose

_NO_NOTES, _NO_MESSAGE_NOTES = SignalNotes(), MessageNotes()
CONDITIONS = frozenset(("valid", "negative_if", *ModeConditions.__struct_fields__, *DriverConditions.__struct_fields__))
"""The names of conditions. A condition may read a signal that is also bound to a field."""


class Role(Enum):
    """What the program uses a message for."""

    SAMPLE = "sample"
    """Received: the message is a part of one sample of the state."""
    STATUS = "status"
    """Received: the message carries the vehicle's mode."""
    AUXILIARY = "auxiliary"
    """Received: the message carries further fields of state or status."""
    COMMAND = "command"
    """Sent: the message carries a command; one frame for each computed command."""
    BODY = "body"
    """Sent: the message carries lights and horn."""
    REPORT = "report"
    """Sent: the message carries the controller's state."""
    SEND = "send"
    """Sent: the message is listed in the profile's `[[send]]`."""


SENT_ROLES = (Role.COMMAND, Role.BODY, Role.REPORT, Role.SEND)
PERIODS = {
    Role.SAMPLE: "sample_period_s",
    Role.STATUS: "status_period_s",
    Role.COMMAND: "command_period_s",
    Role.BODY: "body_period_s",
    Role.REPORT: "report_period_s",
}
"""The key below `timing` in the profile that states the period of a role's messages."""


class StatedValue(NamedTuple):
    """The value that the profile states for a signal of a sent message, and the place where it is stated."""

    place: str
    source: SentValue


class Binding:
    """The names of one profile, looked up in one DBC."""

    def __init__(self, profile: Profile, file: DbcFile) -> None:
        names = resolve_names(profile, file.parts) if file.parts else ResolvedNames(profile, [])
        self.profile = profile = names.profile
        self.name_faults = names.faults
        """Names that do not say on which bus, each `place: text`."""
        self.file = file
        self.profile_name = Path(profile.file).name or profile.name
        """For error messages."""
        self.messages = file.messages
        self.sections: Mapping[str, Mapping[str, tuple[str, ...]]] = {
            "state": _named_signals(profile.state.signals, profile.state.pose),
            "status": _named_signals(profile.status.signals, profile.status.when, profile.status.driver),
            "command": _named_signals(profile.command.signals),
            "body": _named_signals(profile.body.signals) if profile.body else {},
            "report": _named_signals(profile.report.signals) if profile.report else {},
        }
        """Section of the profile → field or condition → its signals as MESSAGE.SIGNAL."""
        self.values: Mapping[str, StatedValue] = _stated_values(profile)
        """MESSAGE.SIGNAL of a sent message → its value by the profile."""
        self.fields: Mapping[str, str] = self._fields()
        """MESSAGE.SIGNAL → its field, or where it has none the first condition that looks at it.

        "" for a received signal that is only echoed."""
        self.roles: Mapping[str, Role] = self._roles()
        """Each bound message's role; the first one where the profile gives it several."""
        self._views: dict[str, SignalView] = {}

    @property
    def constants(self) -> dict[str, float]:
        """Map MESSAGE.SIGNAL to the one value that is always sent, in the DBC's unit."""
        return {dotted: one.source for dotted, one in self.values.items() if isinstance(one.source, float)}

    @property
    def echoes(self) -> dict[str, str]:
        """Map MESSAGE.SIGNAL of a sent message to the received signal that it sends back."""
        tables = {dotted: one.source for dotted, one in self.values.items() if isinstance(one.source, ValueTable)}
        return {dotted: table.echo for dotted, table in tables.items() if table.echo is not None}

    def value_place(self, dotted: str) -> str:
        """Return the place in the profile where the value of a signal is stated or could be stated."""
        if dotted in self.values:
            return self.values[dotted].place
        message, _, signal = dotted.partition(".")
        for index, sent in enumerate(self.profile.send):
            if sent.message == message:
                return f"$.send[{index}].values.{signal}"
        return f"$.{'command.values' if self.roles.get(message) is Role.COMMAND else 'constants'}.{dotted}"

    @property
    def status_messages(self) -> frozenset[str]:
        """The messages from which the vehicle's mode is read."""
        status = self.profile.status
        modes = (status.signals.mode, status.when and tuple(msgspec.structs.astuple(status.when)))
        return frozenset(dotted.partition(".")[0] for dotted in signals_of(modes))

    def find_bus(self, message_name: str) -> int:
        """Return the number of the bus that a message is on, from 0 in the order of the profile."""
        parts = self.file.parts.values()
        return next((number for number, part in enumerate(parts) if message_name in part.lines), 0)

    def find_signal(self, dotted: str) -> Signal | None:
        """Return the signal of a MESSAGE.SIGNAL; None if the DBC does not have it."""
        message_name, _, name = dotted.partition(".")
        message = self.messages.get(message_name)
        if message is None:
            return None
        return next((signal for signal in message.signals if signal.name == name), None)

    def get_signals(self, section: str, field: str) -> dict[str, Signal]:
        """Map MESSAGE.SIGNAL to the signal, for each signal of a field that the DBC has."""
        found = {dotted: self.find_signal(dotted) for dotted in self.sections[section].get(field, ())}
        return {dotted: signal for dotted, signal in found.items() if signal is not None}

    def view(self, dotted: str) -> SignalView:
        """Return a signal that the DBC has, as the profile converts and limits it."""
        if dotted not in self._views:
            self._views[dotted] = self._build_view(dotted)
        return self._views[dotted]

    def _build_view(self, dotted: str) -> SignalView:
        signal = self.find_signal(dotted)
        assert signal is not None, dotted
        pedals = (*self.sections["command"].get("throttle", ()), *self.sections["command"].get("brake", ()))
        notes, field = self.notes_of(dotted), self.fields.get(dotted, "")
        return SignalView.of(signal, notes, field, in_own_unit=dotted in pedals)

    def notes_of(self, dotted: str) -> SignalNotes:
        """Return the profile's notes on a signal."""
        return self.profile.signals.get(dotted, _NO_NOTES)

    def cycle_ms(self, message_name: str) -> float | None:
        """Return the message's period in ms, from the profile's notes or else the DBC; None if neither states it."""
        return self.message_notes(message_name).cycle_ms or self.messages[message_name].cycle_time or None

    def message_notes(self, message_name: str) -> MessageNotes:
        """Return the profile's notes on a message."""
        return self.profile.messages.get(message_name, _NO_MESSAGE_NOTES)

    @property
    def is_counted(self) -> bool:
        """Whether messages with the same counter value form a sample; otherwise their arrival times decide."""
        state = self.profile.state
        if state.assemble is not None:
            return state.assemble == "counter"
        return self.profile.e2e is not None and set(state.sample) <= self.profile.e2e.data_ids.keys()

    def signals_used(self, message_name: str) -> list[str]:
        """Return the names of a message's signals that are read or written one by one, in the order of the DBC."""
        names = (signal.name for signal in self.messages[message_name].signals)
        return [name for name in names if self._is_used(f"{message_name}.{name}")]

    def _is_used(self, dotted: str) -> bool:
        """Whether the signal is bound or its value changes by itself. A complement changes with another signal."""
        source = self.values[dotted].source if dotted in self.values else 0.0
        changes = not isinstance(source, float) and not (isinstance(source, ValueTable) and source.complement)
        return dotted in self.fields or changes

    def is_multiplexed(self, message_name: str) -> bool:
        """Whether a frame of the message may lack a bound signal."""
        used = self.signals_used(message_name)
        return any(signal.multiplexer_signal for signal in self.messages[message_name].signals if signal.name in used)

    def has_counter(self, message_name: str) -> bool:
        """Whether the profile protects the message with a counter."""
        rule = find_rule(self.profile, message_name)
        return rule is not None and rule.counter is not None

    @property
    def protection_signals(self) -> frozenset[str]:
        """Checksums and counters of protected messages, as MESSAGE.SIGNAL."""
        rules = {name: find_rule(self.profile, name) for name in self.roles}
        return frozenset(f"{name}.{one}" for name, rule in rules.items() if rule for one in rule.signals)

    def fault(self, place: str, text: str) -> ConfigError:
        """Build an error about a place in the profile."""
        return ConfigError(f"{self.profile_name}: {place}: {text}")

    def missing_message(self, name: str, place: str) -> ConfigError:
        """Build the error about a message that is not in the DBC or was left out as unusable."""
        file = self.file.parts.get(name.partition(":")[0], self.file)
        text = f"no message {name!r} in {file.name}{suggest(name, self.messages)}"
        return self.file.find_error(name) or self.fault(place, text)

    def missing_signal(self, dotted: str, place: str) -> ConfigError:
        """Build the error about a signal that is not in the DBC or was left out as unusable."""
        message_name, _, name = dotted.partition(".")
        message = self.messages.get(message_name)
        if message is None:
            return self.missing_message(message_name, place)
        text = f"no signal {name!r} in {message_name}{suggest(name, [signal.name for signal in message.signals])}"
        return self.file.find_error(dotted) or self.fault(place, text)

    def role_claims(self) -> Iterator[tuple[str, Role]]:
        """Yield each message with each role that the profile gives it; within a role in the order of the DBC."""
        yield from ((name, Role.SAMPLE) for name in self.profile.state.sample if name in self.messages)
        yield from ((name, Role.STATUS) for name in self.messages if name in self.status_messages)
        sent = {message.message for message in self.profile.send}
        echoed = {dotted.partition(".")[0] for dotted in self.echoes.values()}
        for role, sections in (
            (Role.AUXILIARY, ("state", "status")),
            (Role.COMMAND, ("command",)),
            (Role.BODY, ("body",)),
            (Role.REPORT, ("report",)),
        ):
            used = self._messages_of(*sections)
            if role is Role.AUXILIARY:
                used |= echoed - sent - self._messages_of("command", "body", "report")
            yield from ((name, role) for name in self.messages if name in used)
        yield from ((name, Role.SEND) for name in self.messages if name in sent)

    def _messages_of(self, *sections: str) -> set[str]:
        """Return the messages that contain the signals of these sections."""
        bindings = (signals for section in sections for signals in self.sections[section].values())
        return {dotted.partition(".")[0] for signals in bindings for dotted in signals}

    def _fields(self) -> dict[str, str]:
        named = [one for bindings in self.sections.values() for one in bindings.items()]
        fields: dict[str, str] = {}
        for field, signals in sorted(named, key=lambda one: one[0] in CONDITIONS):
            for dotted in signals:
                if self.find_signal(dotted) is not None:
                    fields.setdefault(dotted, field)
        for dotted in self.echoes.values():
            if self.find_signal(dotted) is not None:
                fields.setdefault(dotted, "")
        return fields

    def _roles(self) -> dict[str, Role]:
        roles: dict[str, Role] = {}
        for name, role in self.role_claims():
            roles.setdefault(name, role)
        return roles


def _stated_values(profile: Profile) -> dict[str, StatedValue]:
    stated = {dotted: StatedValue(f"$.constants.{dotted}", value) for dotted, value in profile.constants.items()}
    for dotted, value in profile.command.values.items():
        stated[dotted] = StatedValue(f"$.command.values.{dotted}", value)
    for index, sent in enumerate(profile.send):
        for signal, value in sent.values.items():
            stated[f"{sent.message}.{signal}"] = StatedValue(f"$.send[{index}].values.{signal}", value)
    return stated


def _named_signals(*tables: msgspec.Struct | None) -> dict[str, tuple[str, ...]]:
    """Map each field or condition to its signals; unbound ones are left out."""
    places = {field: getattr(table, field) for table in tables if table for field in _source_fields(table)}
    found = {field: tuple(signals_of(value_of(form))) for field, form in places.items() if form is not None}
    signs = [form.negative_if for form in places.values() if isinstance(form, FieldForm)]
    return found | ({"negative_if": tuple(signals_of(tuple(signs)))} if any(signs) else {})


def _source_fields(table: msgspec.Struct) -> tuple[str, ...]:
    return ("valid",) if isinstance(table, StatePose) else table.__struct_fields__


def suggest(name: str, names: Iterable[str]) -> str:
    """Return the names closest to `name` as "; nearest: …", for the end of an error message; "" if none is close."""
    import difflib  # only where there is a fault: it takes a while

    found = difflib.get_close_matches(name, list(names), n=3, cutoff=0.4)
    return f"; nearest: {', '.join(found)}" if found else ""
