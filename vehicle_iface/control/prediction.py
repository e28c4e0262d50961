"""Prediction of the state a short time ahead."""

import math
from dataclasses import replace

from vehicle_iface import checks
from vehicle_iface.state import VehicleState
from vehicle_iface.units import ns_from_s

_SERIES_BELOW_RAD = 0.3
_SERIES = (1 / 3, -1 / 30, 1 / 840, -1 / 45360, 1 / 3991680, -1 / 518918400)
"""(−1)^k (2k+2) / (2k+3)!: the power series of (sin φ − φ cos φ) / φ² is the sum of these times φ^(2k+1)."""


def predict(state: VehicleState, dt_s: float) -> VehicleState:
    """The state `dt_s` seconds later, if acceleration and yaw rate stay constant.

    The closed form of the CATR model (constant acceleration and turn rate), with the lateral speed constant
    in the body frame: speed v + a·t, heading θ + ω·t, and the body's velocity (v + a·t, u) turned by the
    heading and integrated. Exact at every yaw rate, 0 included, without cancellation near it. A negative
    `dt_s` predicts backwards in time.

    The acceleration stays constant also through standstill: a braking vehicle that is predicted for longer
    than it needs to stop moves backwards. The heading is not wrapped.

    Raises `InvalidValueError` when `dt_s`, or a predicted number, is not finite.
    """
    dt_s = checks.finite("dt_s", dt_s)
    turned_rad = state.yaw_rate_radps * dt_s
    forward_m, left_m = _body_displacement_m(
        state.speed_mps, state.accel_mps2, state.lateral_speed_mps, turned_rad, dt_s
    )
    cos, sin = math.cos(state.heading_rad), math.sin(state.heading_rad)
    return replace(
        state,
        stamp_ns=state.stamp_ns + ns_from_s(dt_s),
        x_m=state.x_m + cos * forward_m - sin * left_m,
        y_m=state.y_m + sin * forward_m + cos * left_m,
        heading_rad=state.heading_rad + turned_rad,
        speed_mps=state.speed_mps + state.accel_mps2 * dt_s,
    )


def _body_displacement_m(
    speed_mps: float, accel_mps2: float, lateral_mps: float, turned_rad: float, dt_s: float
) -> tuple[float, float]:
    """The displacement (forward, left) in m, in the body frame at the beginning.

    With φ = ω·t, the mean over the time of cos, sin, and of both weighted with the time passed:

        ∫ cos = sin φ / φ           ∫ τ cos = sin φ / φ − ½ (sin(φ/2) / (φ/2))²
        ∫ sin = φ/2 (sin(φ/2) / (φ/2))²     ∫ τ sin = (sin φ − φ cos φ) / φ²
    """
    half_sinc_squared = _sinc(turned_rad / 2) ** 2
    mean_cos = _sinc(turned_rad)
    mean_sin = turned_rad / 2 * half_sinc_squared
    ramp_cos = mean_cos - half_sinc_squared / 2
    ramp_sin = _ramp_sin(turned_rad)
    way_m, lateral_way_m, gained_m = speed_mps * dt_s, lateral_mps * dt_s, accel_mps2 * dt_s * dt_s
    forward_m = way_m * mean_cos + gained_m * ramp_cos - lateral_way_m * mean_sin
    left_m = way_m * mean_sin + gained_m * ramp_sin + lateral_way_m * mean_cos
    return forward_m, left_m


def _sinc(angle_rad: float) -> float:
    """sin φ / φ, 1 at 0; the quotient is accurate as near to 0 as floats go."""
    return math.sin(angle_rad) / angle_rad if angle_rad else 1.0


def _ramp_sin(angle_rad: float) -> float:
    """(sin φ − φ cos φ) / φ², by its series near 0, where the difference would cancel."""
    if abs(angle_rad) >= _SERIES_BELOW_RAD:
        return (math.sin(angle_rad) / angle_rad - math.cos(angle_rad)) / angle_rad
    square, total = angle_rad * angle_rad, 0.0
    for factor in reversed(_SERIES):
        total = total * square + factor
    return total * angle_rad
