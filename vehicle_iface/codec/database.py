"""A DBC and the profile that gives it a meaning, as one: the messages that decoder and encoder work with.

For each signal of a message there is the field's name, so that decoder and encoder never look one up. Everything
that does not fit is reported before the first frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cantools.database import Message, Signal

from vehicle_iface.codec.binding import Binding, Role, resolution, value_range
from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.codec.consistency import find_faults
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.codec.e2e import Protection
from vehicle_iface.codec.enumerations import enumerated_signals, frames_of_reference, translate_from_wire
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundMessage:
    """A message of the DBC with the fields of its signals."""

    name: str
    role: Role
    can_id: int
    is_extended: bool
    is_fd: bool
    length: int
    """Payload, bytes."""
    codec: MessageCodec
    fields: tuple[str, ...]
    """The field's name of each value, in the order of `codec.names`; "" where it has none."""
    constants: tuple[float | int, ...]
    """What is sent where there is no field; checksum and counter are written afterwards."""
    from_wire: tuple[Mapping[int, int] | None, ...]
    """Number on the wire → the program's number of each value; None where they are the same."""
    to_wire: tuple[Mapping[int, int] | None, ...]
    """The program's number → number on the wire of each value; None where they are the same."""
    protection: Protection | None
    max_counter_step: int


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleDatabase:
    """All that the program knows about one vehicle's messages."""

    profile: Profile
    sample: tuple[BoundMessage, ...]
    """One sample: these, with the same counter; in the order of the profile."""
    status: BoundMessage
    """The message with the vehicle's mode."""
    auxiliary: tuple[BoundMessage, ...]
    """Further received messages with fields of state or status."""
    commands: tuple[BoundMessage, ...]
    body: BoundMessage | None
    report: BoundMessage | None
    frames: Mapping[int, str]
    """Number of `pose_frame` on the bus = frame of reference."""
    resolutions: Mapping[str, float]
    """The step of each bound command field on the wire, in its unit; 0 for a float."""
    report_ranges: Mapping[str, tuple[float, float]]
    """Smallest and greatest value of each bound report field."""

    @property
    def received(self) -> tuple[BoundMessage, ...]:
        """What the vehicle sends."""
        return (*self.sample, self.status, *self.auxiliary)

    @property
    def sent(self) -> tuple[BoundMessage, ...]:
        """What the program sends."""
        return (*self.commands, *(message for message in (self.body, self.report) if message is not None))


def load_database(profile: Profile) -> VehicleDatabase:
    """The profile's DBC, bound and checked; `ConfigError` with a line for each thing that does not fit."""
    binding = Binding(profile, read_dbc(Path(profile.dbc)))
    faults = find_faults(binding)
    if faults:
        raise ConfigError("\n".join(map(str, faults)))
    return build_database(binding)


def build_database(binding: Binding) -> VehicleDatabase:
    """The database of a profile and a DBC in which `consistency` has found no fault."""
    profile = binding.profile
    bound = {name: _bind_message(binding, name) for name in binding.roles}

    def of_role(role: Role) -> tuple[BoundMessage, ...]:
        return tuple(message for message in bound.values() if message.role is role)

    return VehicleDatabase(
        profile=profile,
        sample=tuple(bound[name] for name in profile.state.sample),
        status=of_role(Role.STATUS)[0],
        auxiliary=of_role(Role.AUXILIARY),
        commands=of_role(Role.COMMAND),
        body=next(iter(of_role(Role.BODY)), None),
        report=next(iter(of_role(Role.REPORT)), None),
        frames=frames_of_reference(binding),
        resolutions={
            field: max(map(resolution, binding.get_signals("command", field).values()))
            for field in binding.sections["command"]
        },
        report_ranges={
            field: _common_range(list(binding.get_signals("report", field).values()))
            for field in binding.sections["report"]
        },
    )


def _bind_message(binding: Binding, name: str) -> BoundMessage:
    message, e2e = binding.messages[name], binding.profile.e2e
    codec = MessageCodec(message, enumerated=enumerated_signals(binding, name))
    places = [f"{name}.{value}" for value in codec.names]
    from_wire = tuple(translate_from_wire(binding, dotted) for dotted in places)
    protection = None
    if e2e is not None and binding.is_protected(name):
        protection = Protection(e2e.profile, e2e.data_ids[name], message.length, e2e.data_id_mode)
    return BoundMessage(
        name=name,
        role=binding.roles[name],
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        is_fd=message.is_fd,
        length=message.length,
        codec=codec,
        fields=tuple(binding.fields.get(dotted, "") for dotted in places),
        constants=tuple(_constant(binding, message, signal) for signal in message.signals),
        from_wire=from_wire,
        to_wire=tuple(None if table is None else {ours: wire for wire, ours in table.items()} for table in from_wire),
        protection=protection,
        max_counter_step=e2e.max_counter_step if e2e else 1,
    )


def _constant(binding: Binding, message: Message, signal: Signal) -> float | int:
    """What an unbound signal is sent as: its constant, or the allowed value nearest to 0."""
    value = binding.profile.constants.get(f"{message.name}.{signal.name}")
    if value is not None:
        return value
    low, high = value_range(signal)
    return min(max(0, low), high)


def _common_range(signals: list[Signal]) -> tuple[float, float]:
    """What all of them can express."""
    lows, highs = zip(*map(value_range, signals), strict=True)
    return max(lows), min(highs)
