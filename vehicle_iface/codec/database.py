"""Combines a DBC with a profile into the messages that decoder and encoder work with.

Each signal of a message has its field's name beside it, so that decoder and encoder look up no names. All
contradictions are reported before the first frame.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from vehicle_iface.codec.binding import SENT_ROLES, Binding, Role
from vehicle_iface.codec.bus_files import read_dbcs
from vehicle_iface.codec.command_faults import command_range
from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.codec.consistency import find_faults
from vehicle_iface.codec.constants import constant_payload
from vehicle_iface.codec.enumerations import frames_of_reference, translate_from_wire, translate_to_wire
from vehicle_iface.codec.protection import Protection
from vehicle_iface.codec.protection_rules import build_protection
from vehicle_iface.codec.row_reader import build_row_reader
from vehicle_iface.codec.sent_values import NO_VALUES, FindColumn, SentValues, build_sent_values
from vehicle_iface.codec.signal_view import SignalView
from vehicle_iface.command_forms import WireRange
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import FrameKey
from vehicle_iface.profile import Profile
from vehicle_iface.row import RowReader
from vehicle_iface.value import Value

EXACT_ID = 0x1FFF_FFFF
J1939_PGN, J1939_SOURCE = 0x03FF_FF00, 0xFF
"""Masks of an extended identifier (SAE J1939-21). The first selects page, format and group without the priority above
them; the second selects the sender's address."""


class Conversion(NamedTuple):
    """Converts between a signal and its field: field = scale · (value in the DBC's unit) + offset."""

    scale: float
    offset: float


class BoundMessage(Value, frozen=True, kw_only=True):
    """A message of the DBC together with the fields of its signals."""

    name: str
    role: Role
    can_id: int
    is_extended: bool
    bus: int
    """The number of the message's bus, from 0 in the order of the profile."""
    id_mask: int
    """The bits in which the identifier of a received frame must equal `can_id`."""
    is_fd: bool
    length: int
    """Length of the payload in bytes."""
    cycle_s: float | None
    """The message's period in s, from the profile's notes or else the DBC; None if neither states it."""
    codec: MessageCodec
    signals: tuple[SignalView, ...]
    """The signal of each value, in the order of `codec.names`."""
    fields: tuple[str, ...]
    """The field's name of each value, in the order of `codec.names`. It is "" for a multiplexer above bound signals,
    and for a signal of `values`."""
    values: SentValues
    """For a sent message, the changing values that no field fills."""
    conversions: tuple[Conversion | None, ...]
    """For each value, the conversion between the DBC's unit and the field's; None where they are the same."""
    from_wire: tuple[Mapping[int, int] | None, ...]
    """For each value, a map from numbers on the wire to the field's numbers; None where they are the same."""
    to_wire: tuple[Mapping[int, int] | None, ...]
    """For each value, a map from the field's numbers to numbers on the wire; None where they are the same."""
    protection: Protection | None

    @property
    def key(self) -> FrameKey:
        """The key by which the decoder recognises frames of this message."""
        return FrameKey(self.can_id, self.is_extended, self.bus)

    @property
    def dbc_name(self) -> str:
        """The name in the DBC of the message's own bus, without the bus in front of it."""
        return self.name.rpartition(":")[2]

    @property
    def is_masked(self) -> bool:
        """Whether frames of several extended identifiers are this message."""
        return self.id_mask != EXACT_ID


def find_masked(messages: Iterable[BoundMessage], can_id: int, bus: int) -> BoundMessage | None:
    """Return the first message of this bus that matches the extended identifier in the bits of its mask."""
    for message in messages:
        if message.bus == bus and (can_id ^ message.can_id) & message.id_mask == 0:
            return message
    return None


class VehicleDatabase(Value, frozen=True, kw_only=True):
    """Everything that the program knows about the messages of one vehicle."""

    profile: Profile
    sample: tuple[BoundMessage, ...]
    """The messages that form one sample, in the order of the profile."""
    status: tuple[BoundMessage, ...]
    """The messages that carry the vehicle's mode and are not part of the sample."""
    auxiliary: tuple[BoundMessage, ...]
    """Further received messages that carry fields of state or status."""
    commands: tuple[BoundMessage, ...]
    sends: tuple[BoundMessage, ...]
    """The messages of `[[send]]`, in the order of the profile."""
    body: BoundMessage | None
    report: BoundMessage | None
    is_counted: bool
    """Whether messages with the same counter value form a sample; otherwise their arrival times decide."""
    row: RowReader
    """Reads state and status from the values of the received messages."""
    frames: Mapping[int, str]
    """Maps numbers of `pose_frame` on the bus to frames of reference."""
    resolutions: Mapping[str, float]
    """The step of one count of each bound command field, in the field's unit; 0 for a float."""
    command_ranges: Mapping[str, WireRange]
    """The values that the signals of each bound command field can carry."""
    report_ranges: Mapping[str, tuple[float, float]]
    """The smallest and largest value of each bound report field."""

    @property
    def received(self) -> tuple[BoundMessage, ...]:
        """All messages that the vehicle sends."""
        return (*self.sample, *self.status, *self.auxiliary)

    @property
    def sent(self) -> tuple[BoundMessage, ...]:
        """All messages that the program sends."""
        return (*self.commands, *self.sends, *(message for message in (self.body, self.report) if message is not None))

    @property
    def unprotected(self) -> tuple[str, ...]:
        """The names of the received messages and commands that have neither checksum nor counter."""
        return tuple(message.name for message in (*self.received, *self.commands) if message.protection is None)


def load_database(profile: Profile) -> VehicleDatabase:
    """Load the database of a profile; raises what `load_binding` raises."""
    return build_database(load_binding(profile))


def load_binding(profile: Profile) -> Binding:
    """Load a profile's DBCs and check them against the profile.

    Raises `ConfigError` with one line for each contradiction.
    """
    binding = Binding(profile, read_dbcs(profile))
    faults = find_faults(binding)
    if faults:
        raise ConfigError("\n".join(map(str, faults)))
    return binding


def build_database(binding: Binding) -> VehicleDatabase:
    """Build the database from a binding in which `consistency` has found no fault."""
    profile = binding.profile
    received = {name: _bind_message(binding, name) for name, role in binding.roles.items() if role not in SENT_ROLES}
    frames = frames_of_reference(binding)
    row = build_row_reader(binding, {name: message.codec.names for name, message in received.items()}, frames)

    def find_column(dotted: str) -> int:
        name, _, signal = dotted.partition(".")
        first: int = row.places[name].start
        return first + received[name].codec.names.index(signal)

    bound = {name: received.get(name) or _bind_message(binding, name, find_column) for name in binding.roles}

    def of_role(role: Role) -> tuple[BoundMessage, ...]:
        return tuple(message for message in bound.values() if message.role is role)

    return VehicleDatabase(
        profile=profile,
        sample=tuple(bound[name] for name in profile.state.sample),
        status=of_role(Role.STATUS),
        auxiliary=of_role(Role.AUXILIARY),
        commands=of_role(Role.COMMAND),
        sends=tuple(bound[sent.message] for sent in profile.send),
        body=next(iter(of_role(Role.BODY)), None),
        report=next(iter(of_role(Role.REPORT)), None),
        is_counted=binding.is_counted,
        row=row,
        frames=frames,
        resolutions={
            field: max(binding.view(dotted).resolution for dotted in signals)
            for field, signals in binding.sections["command"].items()
        },
        command_ranges={field: command_range(binding, field) for field in binding.sections["command"]},
        report_ranges={
            field: _common_range([binding.view(dotted).field_range for dotted in signals])
            for field, signals in binding.sections["report"].items()
        },
    )


def _bind_message(binding: Binding, name: str, find_column: FindColumn | None = None) -> BoundMessage:
    """Build the bound message. `find_column` is given for a sent message."""
    message, used = binding.messages[name], binding.signals_used(name)
    views = {signal: binding.view(f"{name}.{signal}") for signal in used}
    codec = MessageCodec(
        message,
        only=used,
        rules={signal: view.rules for signal, view in views.items()},
        base=constant_payload(binding, name) if find_column is not None else None,
    )
    places = [f"{name}.{value}" for value in codec.names]
    conversions = [views.get(value) for value in codec.names]
    cycle_ms = binding.cycle_ms(name)
    return BoundMessage(
        name=name,
        role=binding.roles[name],
        can_id=_can_id(binding, name),
        is_extended=message.is_extended_frame,
        bus=binding.find_bus(name),
        id_mask=_id_mask(binding, name),
        is_fd=message.is_fd,
        length=message.length,
        cycle_s=cycle_ms / 1000 if cycle_ms is not None else None,
        codec=codec,
        signals=tuple(views.get(value) or binding.view(f"{name}.{value}") for value in codec.names),
        fields=tuple(binding.fields.get(dotted, "") for dotted in places),
        values=NO_VALUES if find_column is None else build_sent_values(binding, name, find_column),
        conversions=tuple(
            Conversion(view.scale, view.offset) if view is not None and view.is_converted else None
            for view in conversions
        ),
        from_wire=tuple(translate_from_wire(binding, dotted) for dotted in places),
        to_wire=tuple(translate_to_wire(binding, dotted) for dotted in places),
        protection=build_protection(binding.profile, message),
    )


def _can_id(binding: Binding, name: str) -> int:
    """Return the DBC's identifier with the source address from the profile's notes."""
    can_id, j1939 = binding.messages[name].frame_id, binding.message_notes(name).j1939
    if j1939 is None or j1939.source_address is None:
        return can_id
    return can_id & ~J1939_SOURCE | j1939.source_address


def _id_mask(binding: Binding, name: str) -> int:
    j1939 = binding.message_notes(name).j1939
    if j1939 is None or binding.roles[name] in SENT_ROLES:
        return EXACT_ID
    return J1939_PGN if j1939.source_address is None else J1939_PGN | J1939_SOURCE


def _common_range(ranges: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the range that all of them can express."""
    lows, highs = zip(*ranges, strict=True)
    return max(lows), min(highs)
