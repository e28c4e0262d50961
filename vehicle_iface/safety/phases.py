"""Phases of engagement, by which a profile's `when` decides what is sent besides commands."""

from vehicle_iface.command import Phases
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.status import VehicleMode, VehicleStatus


def find_phases(engagement: Engagement, status: VehicleStatus | None, now_ns: int, *, status_stale_ns: int) -> Phases:
    """The phases at `now_ns`.

    A message of `engaging` may enable the vehicle by itself. It needs a status not older than `status_stale_ns` that
    shows neither a fault nor a driver override.
    """
    mode = engagement.mode
    may_enable = (
        status is not None
        and now_ns - status.stamp_ns <= status_stale_ns
        and status.mode in (VehicleMode.READY, VehicleMode.AUTONOMOUS)
        and not engagement.is_driver_override(status)
    )
    return Phases(
        armed=mode.may_send and not mode.disengaged,
        engaging=mode.engages and may_enable,
        enabled=mode.enables,
        released=mode.disengaged,
        always=engagement.may_report(now_ns),
    )
