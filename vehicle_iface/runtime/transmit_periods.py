"""How often each message may leave."""

from collections.abc import Iterator

from vehicle_iface.codec.binding import Role
from vehicle_iface.codec.database import BoundMessage, VehicleDatabase
from vehicle_iface.safety.transmit_filter import AllowedMessage
from vehicle_iface.units import ns_from_s


def period_ns(database: VehicleDatabase, message: BoundMessage) -> int:
    """The period of a sent message."""
    profile = database.profile
    timing = profile.timing
    if message.role is Role.COMMAND:
        return ns_from_s(profile.command.periods.get(message.name, timing.command_period_s))
    return ns_from_s(timing.body_period_s if message.role is Role.BODY else timing.report_period_s)


def allowed_messages(database: VehicleDatabase) -> Iterator[AllowedMessage]:
    """All that may ever leave, and how often."""
    for message in database.sent:
        yield AllowedMessage(
            message.can_id, message.is_extended, message.is_fd, message.length, period_ns(database, message)
        )
