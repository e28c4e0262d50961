"""Checks that the command signals can carry the profile's limits, in the form in which the vehicle is commanded."""

import math
from collections.abc import Iterator

from vehicle_iface.codec.binding import Binding
from vehicle_iface.command_forms import WireRange
from vehicle_iface.command_forms.speed_target import HORIZON_S
from vehicle_iface.errors import ConfigError
from vehicle_iface.interpolation import interpolate
from vehicle_iface.profile import Profile

_SPEEDS = 500
"""Number of speeds at which the largest yaw rate is searched for."""


def command_range(binding: Binding, field: str) -> WireRange:
    """Return the smallest and largest value that all signals of a command field can carry."""
    views = [binding.view(dotted) for dotted in binding.sections["command"][field]]
    lows, highs = zip(*(view.field_range for view in views), strict=True)
    return WireRange(max(lows), min(highs), max(view.resolution for view in views))


def command_faults(binding: Binding) -> Iterator[ConfigError]:
    """Yield errors for limits outside their signal's range, and for rates below one count of their signal."""
    yield from _limit_faults(binding)
    yield from _rate_faults(binding)
    yield from _speed_faults(binding)
    yield from _pedal_faults(binding)
    limits, wheelbase_m = binding.profile.limits, binding.profile.geometry.wheelbase_m
    place, angle_rad = "$.limits.front_wheel_angle_rad", limits.front_wheel_angle_rad
    turn = math.tan(min(angle_rad, 1.5)) + math.tan(min(limits.rear_wheel_angle_rad, 1.5))
    for field, unit, most in (
        ("curvature_per_m", "1/m", turn / wheelbase_m),
        ("yaw_rate_radps", "rad/s", greatest_yaw_rate_radps(binding.profile)),
    ):
        for dotted in binding.get_signals("command", field):
            view = binding.view(dotted)
            (low, high), count = view.field_range, view.resolution
            needs = f"{angle_rad}: {field} may be ±{most:.4g} {unit}"
            if not low <= -most <= most <= high:
                yield binding.fault(place, f"{needs}, but {dotted} is in [{low:.10g}, {high:.10g}]")
            elif count > most:
                yield binding.fault(place, f"{needs}, less than one count of {dotted} ({count:.4g}): always 0")


def greatest_yaw_rate_radps(profile: Profile) -> float:
    """Return the largest yaw rate in rad/s that the limits allow with front steering alone."""
    limits, wheelbase_m = profile.limits, profile.geometry.wheelbase_m
    most_radps = 0.0
    for index in range(1, _SPEEDS + 1):
        speed_mps = limits.speed_max_mps * index / _SPEEDS
        at_speed_rad = interpolate(limits.front_wheel_angle_by_speed, speed_mps)
        angle_rad = min(limits.front_wheel_angle_rad, at_speed_rad, 1.5)
        by_angle_radps = speed_mps * math.tan(angle_rad) / wheelbase_m
        most_radps = max(most_radps, min(by_angle_radps, limits.lateral_accel_mps2 / speed_mps))
    return most_radps


def _speed_faults(binding: Binding) -> Iterator[ConfigError]:
    """A commanded speed may be unsigned if the vehicle obeys it; a speed for information must be signed."""
    limits, command = binding.profile.limits, binding.profile.command
    is_obeyed = command.longitudinal == "speed"
    for dotted in binding.get_signals("command", "speed_mps"):
        view, most_mps = binding.view(dotted), limits.speed_max_mps
        low, high = view.field_range
        least_mps = 0.0 if is_obeyed and low >= 0.0 else -most_mps
        if not low <= least_mps <= most_mps <= high:
            yield binding.fault("$.limits.speed_max_mps", f"{most_mps}: {dotted} is in [{low:.10g}, {high:.10g}]")
        lead_mps = limits.accel_max_mps2 * HORIZON_S
        if is_obeyed and view.resolution > lead_mps:
            text = (
                f"{limits.accel_max_mps2}: the speed may be {lead_mps:.4g} m/s ahead, less than one count of {dotted}"
            )
            yield binding.fault("$.limits.accel_max_mps2", f"{text} ({view.resolution:.4g}): it could never start")


def _pedal_faults(binding: Binding) -> Iterator[ConfigError]:
    command, limits = binding.profile.command, binding.profile.limits
    pedals = command.pedals
    if pedals is None:
        return
    for field, rows, most_mps2 in (
        ("throttle", pedals.throttle, limits.accel_max_mps2),
        ("brake", pedals.brake, -limits.accel_min_mps2),
    ):
        place = f"$.command.pedals.{field}"
        for dotted in binding.get_signals("command", field):
            view = binding.view(dotted)
            (low, high), most = view.field_range, interpolate(rows, most_mps2)
            text = f"{dotted} is in [{low:.10g}, {high:.10g}], in its own unit {view.signal.unit or 'without name'}"
            for row, (_, value) in enumerate(rows):
                if not low <= value <= high:
                    yield binding.fault(f"{place}[{row}][1]", f"{value}: {text}")
            if not low <= 0.0 <= high:
                yield binding.fault(place, f"released it is 0: {text}")
            if view.resolution > most:
                text = f"{most:.4g} at {most_mps2} m/s² is less than one count of {dotted} ({view.resolution:.4g})"
                yield binding.fault(place, text)


def _limit_faults(binding: Binding) -> Iterator[ConfigError]:
    """Each limit must be within the range of the signal that carries the command."""
    limits = binding.profile.limits
    limited: tuple[tuple[str, str, tuple[float, ...]], ...] = (
        ("front_wheel_angle_rad", "front_wheel_angle_rad", _both_signs(limits.front_wheel_angle_rad)),
        ("rear_wheel_angle_rad", "rear_wheel_angle_rad", _both_signs(limits.rear_wheel_angle_rad)),
        ("accel_max_mps2", "accel_mps2", (limits.accel_max_mps2,)),
        ("accel_min_mps2", "accel_mps2", (limits.accel_min_mps2,)),
        ("accel_max_mps2", "drive_mps2", (limits.accel_max_mps2, 0.0)),
        ("accel_min_mps2", "brake_mps2", (-limits.accel_min_mps2, 0.0)),
    )
    for key, field, values in limited:
        for dotted in binding.get_signals("command", field):
            low, high = binding.view(dotted).field_range
            if any(not low <= value <= high for value in values):
                text = f"{getattr(limits, key)}: {dotted} is in [{low:.10g}, {high:.10g}]"
                yield binding.fault(f"$.limits.{key}", text)


def _both_signs(limit: float) -> tuple[float, float]:
    return limit, -limit


def _rate_faults(binding: Binding) -> Iterator[ConfigError]:
    """A rate below one count of its signal per sample would never move the command."""
    limits, period_s = binding.profile.limits, binding.profile.timing.sample_period_s
    rates = [
        *(("accel_rate_mps3", field, limits.accel_rate_mps3) for field in ("accel_mps2", "drive_mps2", "brake_mps2")),
        ("front_wheel_rate_radps", "front_wheel_angle_rad", limits.front_wheel_rate_radps),
    ]
    if limits.rear_wheel_angle_rad > 0.0:
        rates.append(("rear_wheel_rate_radps", "rear_wheel_angle_rad", limits.rear_wheel_rate_radps))
    for key, field, per_s in rates:
        for dotted in sorted(binding.get_signals("command", field)):
            count, step = binding.view(dotted).resolution, per_s * period_s
            if step < count * (1.0 - 1e-6):
                text = f"{per_s}: {field} may change by {step:.4g} in {period_s} s, less than one count of {dotted}"
                yield binding.fault(f"$.limits.{key}", f"{text} ({count:.4g}): it could never change")
