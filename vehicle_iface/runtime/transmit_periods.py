"""The allowed rate of each message that is sent."""

from collections.abc import Iterator

from vehicle_iface.codec.binding import Role
from vehicle_iface.codec.database import BoundMessage, VehicleDatabase
from vehicle_iface.profile.sends import ENABLING, ValueTable
from vehicle_iface.runtime.command_pace import CommandPace
from vehicle_iface.safety.transmit_filter import WINDOW_NS, AllowedMessage, TransmitFilter
from vehicle_iface.units import ns_from_s


def period_ns(database: VehicleDatabase, message: BoundMessage) -> int:
    """The period of a sent message."""
    profile = database.profile
    timing = profile.timing
    if message.role is Role.COMMAND:
        return ns_from_s(profile.command.periods.get(message.name, timing.command_period_s))
    if message.role is Role.SEND:
        period_s = next(sent.period_s for sent in profile.send if sent.message == message.name)
        return WINDOW_NS if period_s is None else ns_from_s(period_s)
    return ns_from_s(timing.body_period_s if message.role is Role.BODY else timing.report_period_s)


def allowed_messages(database: VehicleDatabase) -> Iterator[AllowedMessage]:
    """All that may ever leave, and how often."""
    for message in database.sent:
        yield AllowedMessage(
            can_id=message.can_id,
            is_extended=message.is_extended,
            is_fd=message.is_fd,
            length=message.length,
            period_ns=period_ns(database, message),
            bus=message.bus,
        )


def build_pace(database: VehicleDatabase, transmit_filter: TransmitFilter) -> CommandPace:
    """Which command messages each answer is sent in."""
    return CommandPace(
        database.commands,
        {message.name: period_ns(database, message) for message in database.commands},
        sample_period_ns=ns_from_s(database.profile.timing.sample_period_s),
        transmit_filter=transmit_filter,
        carries_enable=_carries_enable(database),
    )


def _carries_enable(database: VehicleDatabase) -> bool:
    """Whether commands say in a value of theirs that they are enabled."""
    command = database.profile.command
    stated = (source.when for source in command.values.values() if isinstance(source, ValueTable))
    return command.signals.enable is not None or any(when in ENABLING for when in stated)
