"""States of a vehicle that drives without slip, as its sensors see them: exact, or with the noise of real ones."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vehicle_iface import VehicleState
from vehicle_iface.trajectories.route import Route
from vehicle_iface.units import wrapped_rad

WHEELBASE_M = 2.7
PERIOD_NS = 10_000_000
PERIOD_S = 0.01
SMOOTHED_SAMPLES = 30
"""A route's speeds may step; a vehicle's do not."""


def drive(
    seconds: float,
    *,
    speed_mps: float = 5.0,
    accel_mps2: float = 0.0,
    front_rad: float = 0.0,
    rear_rad: float = 0.0,
    start_ns: int = 0,
) -> list[VehicleState]:
    """At one acceleration until standstill, and one wheel angle; sampled at 100 Hz."""
    states, x_m, y_m, heading_rad = [], 0.0, 0.0, 0.3
    curvature = (math.tan(front_rad) - math.tan(rear_rad)) / WHEELBASE_M
    for tick in range(round(seconds / PERIOD_S)):
        states.append(
            VehicleState(
                stamp_ns=start_ns + tick * PERIOD_NS,
                x_m=x_m,
                y_m=y_m,
                heading_rad=wrapped_rad(heading_rad),
                speed_mps=speed_mps,
                accel_mps2=accel_mps2,
                yaw_rate_radps=speed_mps * curvature,
                lateral_speed_mps=speed_mps * math.tan(rear_rad),
                front_wheel_angle_rad=front_rad,
                rear_wheel_angle_rad=rear_rad,
            )
        )
        faster_mps = speed_mps + accel_mps2 * PERIOD_S
        if faster_mps * speed_mps < 0.0:
            faster_mps = accel_mps2 = 0.0
        way_m = 0.5 * (speed_mps + faster_mps) * PERIOD_S
        course_rad = heading_rad + 0.5 * way_m * curvature
        x_m += way_m * (math.cos(course_rad) - math.tan(rear_rad) * math.sin(course_rad))
        y_m += way_m * (math.sin(course_rad) + math.tan(rear_rad) * math.cos(course_rad))
        heading_rad = heading_rad + way_m * curvature
        speed_mps = faster_mps
    return states


def distort(states: list[VehicleState], field: str, change: Callable[[float, int], float]) -> list[VehicleState]:
    """The same, with `change(value, number of the sample)` in the place of one field's values."""
    changed: list[dict[str, Any]] = [{field: change(getattr(state, field), i)} for i, state in enumerate(states)]
    return [replace(state, **values) for state, values in zip(states, changed, strict=True)]


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Standard deviations of white noise, and constant errors, of sensors that are good enough to drive by.

    An RTK receiver with inertial aiding, wheel speeds of tyres that are 1.5 % too small, a gyroscope and an
    accelerometer of the kind that is built into cars, on a road that rises by 1 %.
    """

    position_m: float = 0.03
    heading_rad: float = 0.005
    heading_offset_rad: float = 0.01
    speed_mps: float = 0.05
    speed_scale: float = 1.015
    accel_mps2: float = 0.2
    accel_offset_mps2: float = 0.1
    yaw_rate_radps: float = 0.01
    yaw_rate_offset_radps: float = 0.005
    lateral_speed_mps: float = 0.05
    front_wheel_rad: float = 0.003
    front_wheel_offset_rad: float = 0.01


def drive_route(route: Route, noise: SensorNoise, seed: int) -> Iterator[VehicleState]:
    """Once from the route's first point to its last at its speeds, sampled at 100 Hz, with noise."""
    trajectory = route.to_trajectory()
    t_s = trajectory.time_from_start_ns / 1e9  # (n,)
    at_s = np.arange(0.0, t_s[-1], PERIOD_S)  # (m,)
    smooth = np.full(SMOOTHED_SAMPLES, 1.0 / SMOOTHED_SAMPLES)
    here, ahead, behind = (
        np.sign(np.interp(at_s + shift_s, t_s, trajectory.speed_mps)) for shift_s in (0.0, 0.3, -0.3)
    )
    direction = np.where(here != 0.0, here, np.where(ahead != 0.0, ahead, np.where(behind != 0.0, behind, 1.0)))
    way_m = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m)))))  # (n,)
    pace = np.convolve(np.gradient(np.interp(at_s, t_s, way_m), PERIOD_S), smooth, mode="same")
    s_m = np.concatenate(([0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * PERIOD_S)))
    speed = pace * direction
    x, y = np.interp(s_m, way_m, trajectory.x_m), np.interp(s_m, way_m, trajectory.y_m)
    heading = np.interp(s_m, way_m, np.unwrap(trajectory.heading_rad))
    accel, yaw_rate = np.gradient(speed, PERIOD_S), np.gradient(heading, PERIOD_S)
    wheel = np.where(pace > 0.2, np.arctan2(yaw_rate * WHEELBASE_M, np.maximum(pace, 0.2)) * np.sign(speed), 0.0)
    rng = np.random.default_rng(seed)

    def noisy(values: np.typing.NDArray[np.float64], sigma: float, offset: float = 0.0) -> list[float]:
        return (values + offset + rng.normal(0.0, sigma, len(values))).tolist()  # type: ignore[no-any-return]

    columns = zip(
        noisy(x, noise.position_m),
        noisy(y, noise.position_m),
        noisy(heading, noise.heading_rad, noise.heading_offset_rad),
        noisy(speed * noise.speed_scale, noise.speed_mps),
        noisy(accel, noise.accel_mps2, noise.accel_offset_mps2),
        noisy(yaw_rate, noise.yaw_rate_radps, noise.yaw_rate_offset_radps),
        noisy(0.0 * speed, noise.lateral_speed_mps),
        noisy(wheel, noise.front_wheel_rad, noise.front_wheel_offset_rad),
        strict=True,
    )
    for tick, (x_m, y_m, heading_rad, speed_mps, accel_mps2, yaw_radps, lateral_mps, wheel_rad) in enumerate(columns):
        yield VehicleState(
            stamp_ns=tick * PERIOD_NS,
            x_m=x_m,
            y_m=y_m,
            heading_rad=math.remainder(heading_rad, math.tau),
            speed_mps=speed_mps,
            accel_mps2=accel_mps2,
            yaw_rate_radps=yaw_radps,
            lateral_speed_mps=lateral_mps,
            front_wheel_angle_rad=wheel_rad,
        )
