"""A kinematic bicycle with slow actuators, and trajectories to drive on; virtual time."""

import math
from collections.abc import Callable

import numpy as np

from vehicle_iface.command import Command
from vehicle_iface.control import ControllerBase
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import NS_PER_S

WHEELBASE_M = 2.7
STEP_S = 0.01


class Bicycle:
    """The rear axle's centre of a bicycle whose steering and drive follow with a first-order lag."""

    def __init__(self, *, x_m: float = 0.0, y_m: float = 0.0, heading_rad: float = 0.0, speed_mps: float = 0.0) -> None:
        self.x_m, self.y_m, self.heading_rad, self.speed_mps = x_m, y_m, heading_rad, speed_mps
        self.accel_mps2 = self.front_rad = 0.0
        self.steering_lag_s = 0.1
        self.drive_lag_s = 0.05
        self.greatest_steering_rad = 0.6
        self.greatest_accel_mps2 = 4.0

    def state(self, stamp_ns: int) -> VehicleState:
        return VehicleState(
            stamp_ns=stamp_ns,
            x_m=self.x_m,
            y_m=self.y_m,
            heading_rad=self.heading_rad,
            speed_mps=self.speed_mps,
            accel_mps2=self.accel_mps2,
            yaw_rate_radps=self.speed_mps * math.tan(self.front_rad) / WHEELBASE_M,
            front_wheel_angle_rad=self.front_rad,
        )

    def drive(self, command: Command) -> None:
        """One time step; a brake holds at standstill, so a stop never turns into driving the other way."""
        limit = self.greatest_steering_rad
        wanted_rad = min(limit, max(-limit, command.front_wheel_angle_rad))
        self.front_rad += (wanted_rad - self.front_rad) * STEP_S / (self.steering_lag_s + STEP_S)
        wanted_mps2 = min(self.greatest_accel_mps2, max(-self.greatest_accel_mps2, command.accel_mps2))
        self.accel_mps2 += (wanted_mps2 - self.accel_mps2) * STEP_S / (self.drive_lag_s + STEP_S)
        speed_mps = self.speed_mps + self.accel_mps2 * STEP_S
        if self.speed_mps * speed_mps < 0.0 or (self.speed_mps == 0.0 and command.accel_mps2 == 0.0):
            speed_mps = self.accel_mps2 = 0.0
        mean_mps, self.speed_mps = (self.speed_mps + speed_mps) / 2, speed_mps
        turned_rad = mean_mps * math.tan(self.front_rad) / WHEELBASE_M * STEP_S
        self.x_m += mean_mps * math.cos(self.heading_rad + turned_rad / 2) * STEP_S
        self.y_m += mean_mps * math.sin(self.heading_rad + turned_rad / 2) * STEP_S
        self.heading_rad += turned_rad


def drive(
    controller: ControllerBase,
    vehicle: Bicycle,
    *,
    duration_s: float,
    every_step: Callable[[int], None] = lambda _: None,
) -> list[tuple[VehicleState, Command]]:
    """The loop at 100 Hz from stamp 0 on; `every_step` is called before each command, with its stamp."""
    log = []
    for step in range(round(duration_s / STEP_S)):
        stamp_ns = round(step * STEP_S * NS_PER_S)
        every_step(stamp_ns)
        state = vehicle.state(stamp_ns)
        command = controller.compute_command(state)
        log.append((state, command))
        vehicle.drive(command)
    return log


def trajectory_of(
    x_m: np.ndarray,
    y_m: np.ndarray,
    heading_rad: np.ndarray,
    speed_mps: np.ndarray,
    *,
    stamp_ns: int = 0,
    dwell_s: float = 0.0,
) -> Trajectory:
    """Times from way and mean speed; each inner point without speed gets a second one `dwell_s` later."""
    way_m = np.hypot(np.diff(x_m), np.diff(y_m))
    mean_mps = (np.abs(speed_mps[1:]) + np.abs(speed_mps[:-1])) / 2
    time_s = np.concatenate([[0.0], np.cumsum(way_m / mean_mps)])
    keep = np.arange(len(x_m))
    if dwell_s > 0.0:
        stops = np.flatnonzero(speed_mps[1:-1] == 0.0) + 1
        keep = np.sort(np.concatenate([keep, stops]))
        second = np.concatenate([[False], keep[1:] == keep[:-1]])
        time_s = time_s[keep] + dwell_s * np.cumsum(second)
    return Trajectory(
        stamp_ns=stamp_ns,
        time_from_start_ns=np.round(time_s * NS_PER_S).astype(np.int64),
        x_m=x_m[keep],
        y_m=y_m[keep],
        heading_rad=heading_rad[keep],
        speed_mps=speed_mps[keep],
    )


def eased_speed(way_m: np.ndarray, greatest_mps: np.ndarray, stops_m: list[float], accel_mps2: float) -> np.ndarray:
    """The fastest speed under `greatest_mps` that is 0 at each of `stops_m` and never changes faster."""
    speed = greatest_mps.astype(float).copy()
    for stop_m in stops_m:
        speed = np.minimum(speed, np.sqrt(2 * accel_mps2 * np.abs(way_m - stop_m)))
    step = np.diff(way_m)
    for i in range(1, len(speed)):
        speed[i] = min(speed[i], math.sqrt(speed[i - 1] ** 2 + 2 * accel_mps2 * step[i - 1]))
    for i in range(len(speed) - 2, -1, -1):
        speed[i] = min(speed[i], math.sqrt(speed[i + 1] ** 2 + 2 * accel_mps2 * step[i]))
    return speed


def straight(length_m: float, *, greatest_mps: float, stops_m: list[float], dwell_s: float = 0.0) -> Trajectory:
    """Along +x from the origin."""
    way = np.arange(0.0, length_m + 0.125, 0.25)
    speed = eased_speed(way, np.full(len(way), greatest_mps), stops_m, 1.0)
    return trajectory_of(way, np.zeros(len(way)), np.zeros(len(way)), speed, dwell_s=dwell_s)


def circle(radius_m: float, *, laps: float, speed_mps: float) -> Trajectory:
    """Counter-clockwise from the origin, heading +x at first; backwards (clockwise, facing +x) for a
    negative speed."""
    angle = np.arange(0.0, math.tau * laps, 0.25 / radius_m)
    sign = math.copysign(1.0, speed_mps)
    speed = sign * eased_speed(angle * radius_m, np.full(len(angle), abs(speed_mps)), [0.0, angle[-1] * radius_m], 1.0)
    return trajectory_of(sign * radius_m * np.sin(angle), radius_m * (1 - np.cos(angle)), sign * angle, speed)


def figure_of_eight(*, size_m: float = 15.0, laps: int = 1, greatest_mps: float = 5.0) -> Trajectory:
    """x = a sin t, y = a sin t cos t in points 0.25 m apart; speed by a lateral acceleration of 1.5 m/s²."""
    t = np.linspace(0.0, math.tau * laps, 20000 * laps)
    x, y = size_m * np.sin(t), size_m * np.sin(t) * np.cos(t)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    heading = np.unwrap(np.arctan2(size_m * np.cos(2 * t), size_m * np.cos(t)))
    at = np.arange(0.0, way[-1], 0.25)
    curvature = np.interp(at, way, np.gradient(heading, way))
    greatest = np.minimum(greatest_mps, np.sqrt(1.5 / np.maximum(np.abs(curvature), 1e-6)))
    speed = eased_speed(at, greatest, [0.0, at[-1]], 1.0)
    return trajectory_of(np.interp(at, way, x), np.interp(at, way, y), np.interp(at, way, heading), speed)


def cusp() -> Trajectory:
    """10 m forwards on a left arc of 12 m radius, then 10 m backwards on the arc to the other side."""
    way = np.arange(0.0, 10.125, 0.25)
    speed = eased_speed(way, np.full(len(way), 2.0), [0.0, 10.0], 1.0)
    radius = 12.0
    x1, y1, h1 = radius * np.sin(way / radius), radius * (1 - np.cos(way / radius)), way / radius
    # backwards with the opposite curvature: the heading goes on growing
    back, h0 = way[1:], h1[-1]
    h2 = h0 + back / radius
    x2 = x1[-1] - radius * (np.sin(h2) - np.sin(h0))
    y2 = y1[-1] + radius * (np.cos(h2) - np.cos(h0))
    return trajectory_of(
        np.concatenate([x1, x2]),
        np.concatenate([y1, y2]),
        np.concatenate([h1, h2]),
        np.concatenate([speed, -speed[1:]]),
    )


def lateral_errors(log: list[tuple[VehicleState, Command]], trajectory: Trajectory) -> np.ndarray:
    """How far each state is from the path (m), to the nearest of its segments."""
    a = np.stack([trajectory.x_m, trajectory.y_m], axis=1)  # (n, 2)
    way = a[1:] - a[:-1]
    square = np.maximum((way**2).sum(axis=1), 1e-12)
    errors = []
    for state, _ in log:
        to = np.array([state.x_m, state.y_m]) - a[:-1]
        part = np.clip((to * way).sum(axis=1) / square, 0.0, 1.0)
        errors.append(np.hypot(*(to - part[:, None] * way).T).min())
    return np.array(errors)
