"""Limits that depend on signals that the vehicle does not send: those are unknown, not 0."""

import math

import msgspec

from vehicle_iface.profile import Limits, Plausibility, Profile


def without_unmeasured(profile: Profile) -> tuple[Limits, Plausibility]:
    """The profile's limits, infinite where they compare with a signal that the vehicle does not send."""
    limits, plausibility, signals = profile.limits, profile.plausibility, profile.state.signals
    if signals.front_wheel_angle_rad is None:
        limits = msgspec.structs.replace(limits, front_wheel_deviation_rad=math.inf)
    if signals.front_wheel_angle_rad is None or signals.yaw_rate_radps is None:
        plausibility = msgspec.structs.replace(plausibility, yaw_rate_tolerance_radps=math.inf)
    if signals.yaw_rate_radps is None:
        plausibility = msgspec.structs.replace(plausibility, heading_tolerance_rad=math.inf)
    return limits, plausibility
