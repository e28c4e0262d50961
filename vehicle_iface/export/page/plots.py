"""The plots of a drive: their curves, ranges and limits."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from vehicle_iface.telemetry import DrivingLimits
from vehicle_iface.telemetry.columns import (
    ROUNDING_MPS2,
    ROUNDING_RAD,
    Reader,
    of_flag,
    of_limited,
    of_state,
)
from vehicle_iface.units import NS_PER_MS

_DEGREES = math.degrees(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveKind:
    """One curve of a plot."""

    key: str
    """Name of the column in CSV; with its unit."""
    label: str
    color: str
    read: Reader
    """The values in the plot's unit; NaN where their flag says that they are unknown."""
    width: float = 1.6
    is_compared: bool = True
    """Whether it is drawn where two drives are compared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotKind:
    """One plot: curves of one unit."""

    title: str
    unit: str
    digits: int
    range: Callable[[DrivingLimits], tuple[float, float]]
    limits: Callable[[DrivingLimits], list[float]]
    curves: tuple[CurveKind, ...]


def _around_zero(limit: float) -> tuple[float, float]:
    return -limit, limit


def _command_curves(name: str, unit: str, rounding: float, factor: float = 1.0) -> tuple[CurveKind, ...]:
    """The curves of a command, the lowest first."""
    stem = name.rpartition("_")[0]
    return (
        CurveKind(
            key=f"limited_{stem}_{unit}",
            label="limited",
            color="limited",
            width=5.0,
            read=of_limited(name, rounding, factor),
            is_compared=False,
        ),
        CurveKind(
            key=f"requested_{stem}_{unit}",
            label="requested",
            color="requested",
            width=2.2,
            read=of_flag(f"requested_{name}", "has_requested", factor),
            is_compared=False,
        ),
        CurveKind(
            key=f"sent_{stem}_{unit}",
            label="sent",
            color="sent",
            read=of_flag(f"sent_{name}", "sent", factor),
        ),
        CurveKind(
            key=f"{stem}_{unit}",
            label="measured",
            color="measured",
            read=of_state(name, factor),
            is_compared=False,
        ),
    )


PLOTS = (
    PlotKind(
        title="Speed",
        unit="m/s",
        digits=2,
        range=lambda limits: (0.0, limits.speed_max_mps),
        limits=lambda limits: [limits.speed_max_mps],
        curves=(
            CurveKind(
                key="reference_speed_mps",
                label="reference",
                color="requested",
                width=2.2,
                read=of_state("reference_speed_mps", flag="has_reference"),
                is_compared=False,
            ),
            CurveKind(key="speed_mps", label="vehicle", color="measured", read=of_state("speed_mps")),
        ),
    ),
    PlotKind(
        title="Lateral error",
        unit="m, left positive",
        digits=3,
        range=lambda limits: _around_zero(limits.lateral_warn_m),
        limits=lambda limits: list(_around_zero(limits.lateral_warn_m)),
        curves=(
            CurveKind(
                key="lateral_error_m",
                label="vehicle",
                color="error",
                read=of_state("lateral_error_m", flag="has_reference"),
            ),
        ),
    ),
    PlotKind(
        title="Heading error",
        unit="°, left positive",
        digits=2,
        range=lambda limits: _around_zero(math.degrees(limits.heading_stop_rad) / 4),
        limits=lambda limits: list(_around_zero(math.degrees(limits.heading_stop_rad))),
        curves=(
            CurveKind(
                key="heading_error_deg",
                label="vehicle",
                color="error",
                read=of_state("heading_error_rad", _DEGREES, flag="has_reference"),
            ),
        ),
    ),
    PlotKind(
        title="Road wheel",
        unit="°, left positive",
        digits=2,
        range=lambda limits: _around_zero(math.degrees(limits.front_wheel_angle_rad)),
        limits=lambda limits: list(_around_zero(math.degrees(limits.front_wheel_angle_rad))),
        curves=_command_curves("front_wheel_angle_rad", "deg", ROUNDING_RAD, _DEGREES),
    ),
    PlotKind(
        title="Acceleration",
        unit="m/s²",
        digits=2,
        range=lambda limits: (limits.accel_min_mps2, limits.accel_max_mps2),
        limits=lambda limits: [limits.accel_min_mps2, limits.accel_max_mps2],
        curves=_command_curves("accel_mps2", "mps2", ROUNDING_MPS2),
    ),
    PlotKind(
        title="Latency",
        unit="ms, from sample to command",
        digits=2,
        range=lambda _: (0.0, 1.0),
        limits=lambda _: [],
        curves=(
            CurveKind(
                key="latency_ms",
                label="command",
                color="latency",
                read=of_flag("latency_ns", "sent", 1.0 / NS_PER_MS),
            ),
        ),
    ),
)
