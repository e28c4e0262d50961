"""The messages that a profile names: identifiers, lengths, signals and protection."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cantools.database.can import Message, Signal
from vehicle_bus_contract.reference import Frame

from hil_bench.peer.protection import Protection, UnknownProtectionError, read_protection
from hil_bench.peer.signals import (
    PeerSignal,
    field_signals,
    initial_of,
    read_signal,
    received_signals,
    sent_values,
    sources_of,
)
from hil_bench.profile import ProfileError, ProfileFiles

EXTENDED = 1 << 31
"""Marks an identifier of 29 bits."""
ANY_SENDER = 1 << 32
"""Marks a J1939 group whose sender does not matter."""
ON_BUS = 1 << 40
"""The number of a bus, times this, is part of an identifier there."""
GROUP, SENDER = 0x3FFFF00, 0xFF
OWN_UNIT = ("throttle", "brake")


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Everything by the name of the message, or MESSAGE.SIGNAL."""

    messages: Mapping[str, Message]
    signals: Mapping[str, PeerSignal]
    protections: Mapping[str, Protection]
    dotted: Mapping[str, tuple[tuple[str, str], ...]]
    """The signals that the profile names, of each message: by full and short name."""
    initial: Mapping[str, Mapping[str, float]]
    """Values of all signals of each message, in the DBC's unit, where nothing else is said."""
    branches: Mapping[str, Sequence[Mapping[str, float]]]
    """Of a multiplexed message, the multiplexer's value of each branch."""
    ids: Mapping[str, int]
    buses: Mapping[str, int]
    """The number of the bus of each message."""
    fd: Mapping[str, bool]
    """Whether a message's bus carries FD frames."""
    names: Mapping[int, str]
    """Identifier, with `EXTENDED` and `ON_BUS` → message."""
    groups: Mapping[int, str]
    """J1939: group and sender, or group with `ANY_SENDER`, each with `ON_BUS` → message."""

    def name_of(self, frame: Frame) -> str | None:
        """The message of a frame's identifier; of a J1939 message whatever its priority."""
        on = frame.bus * ON_BUS
        name = self.names.get(frame.can_id | EXTENDED * frame.is_extended | on)
        if name is None and frame.is_extended:
            group = frame.can_id & GROUP | on
            name = self.groups.get(group | frame.can_id & SENDER) or self.groups.get(group | ANY_SENDER)
        return name


def read_layout(files: ProfileFiles) -> Layout:
    """Raises `ProfileError` for what the bench cannot play, and `KeyError` for what the DBC does not have."""
    profile, found = files.profile, files.messages
    fields, values = field_signals(profile), sent_values(profile)
    reported = (profile.get(part, {}).get("signals", {}).values() for part in ("body", "report"))
    named = [*received_signals(profile), *(name for names in fields.values() for name in names), *values]
    named += [name for forms in reported for form in forms for name in sources_of(form)]
    own = {*values, *(name for key in OWN_UNIT for name in fields.get(key, ()))}
    signals = {name: read_signal(found, profile, name, own_unit=name in own) for name in dict.fromkeys(named)}
    owners = [*(name.partition(".")[0] for name in signals), *profile["state"]["sample"]]
    owners += [str(send["message"]) for send in profile.get("send", ())]
    messages = {name: found.find(name) for name in dict.fromkeys(owners)}
    for name, message in messages.items():
        if any(len(signal.multiplexer_ids or ()) > 1 or signal.is_multiplexer for signal in _inner(message)):
            raise ProfileError(f"{files.path}: {name} has multiplexers in multiplexers, which the bench does not play")
    try:
        protections = {name: read_protection(profile, message, files.path.parent) for name, message in messages.items()}
    except UnknownProtectionError as error:
        raise ProfileError(f"{files.path}: the bench has no code of its own for {error}") from None
    ids = {name: message.frame_id | EXTENDED * message.is_extended_frame for name, message in messages.items()}
    buses = {name: found.bus_of(name) for name in messages}
    tables = list(profile.get("buses", {"": profile.get("bus", {})}).values())
    return Layout(
        messages=messages,
        signals=signals,
        protections=protections,
        dotted={one: tuple((n, n.partition(".")[2]) for n in signals if n.startswith(f"{one}.")) for one in messages},
        initial={one: {s.name: initial_of(s) for s in message.signals} for one, message in messages.items()},
        branches={name: _branches_of(message) for name, message in messages.items()},
        ids=ids,
        buses=buses,
        fd={name: bool(tables[number].get("fd", False)) for name, number in buses.items()},
        names={can_id | buses[name] * ON_BUS: name for name, can_id in ids.items()},
        groups=_read_groups(profile, messages, buses),
    )


def _branches_of(message: Message) -> list[dict[str, float]]:
    """The multiplexer's value of each branch, of a multiplexed message."""
    chosen = {
        (signal.multiplexer_signal, number) for signal in _inner(message) for number in signal.multiplexer_ids or ()
    }
    return [{str(name): number} for name, number in sorted(chosen, key=lambda one: one[1])]


def _inner(message: Message) -> list[Signal]:
    """The signals of branches."""
    return [signal for signal in message.signals if signal.multiplexer_ids is not None]


def _read_groups(
    profile: Mapping[str, Any], messages: Mapping[str, Message], buses: Mapping[str, int]
) -> dict[int, str]:
    groups = {}
    for name, message in messages.items():
        note = profile.get("messages", {}).get(name, {}).get("j1939")
        if note is not None:
            group = message.frame_id & GROUP | note.get("source_address", ANY_SENDER)
            groups[group | buses[name] * ON_BUS] = name
    return groups
