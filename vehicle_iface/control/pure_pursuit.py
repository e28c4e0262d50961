"""Steer on the arc that leads to a point of the trajectory some way ahead.

R. C. Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992, for the
arc. Around it, as Autoware.Auto's controller has them: the direction of travel, the interpolated look-ahead
point, and an acceleration from v² = u² + 2·a·s. Stops on the way (see `stops`) are taken one after the
other.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vehicle_iface import checks
from vehicle_iface.clock import monotonic_ns
from vehicle_iface.command import Command
from vehicle_iface.control.base import BehaviorConfig, ControllerBase
from vehicle_iface.control.prediction import predict
from vehicle_iface.control.stops import Stops
from vehicle_iface.control.tracking import Progress
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.reason import Reason
from vehicle_iface.state import VehicleState
from vehicle_iface.units import s_from_ns

LEAST_DISTANCE_M = 0.01
"""The acceleration law divides by no less."""
GREATEST_AGE_S = 0.5
"""Delay compensation looks no further ahead: a state that is older belongs to nobody's prediction."""

_SCALAR_POINTS = 64
_FIRST_BLOCK, _GREATEST_BLOCK = 128, 4096
_REACH = 4.0
"""In look-aheads: a search that went on for longer along the path than round a circle within reach ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PurePursuitConfig:
    """The vehicle and the look-ahead. Raises `InvalidValueError`."""

    wheelbase_m: float = 2.7
    """Front to rear axle; above 0."""
    min_lookahead_m: float = 2.0
    """Above 0."""
    max_lookahead_m: float = 20.0
    """At least `min_lookahead_m`."""
    lookahead_time_s: float = 1.0
    """The look-ahead is the way that the vehicle's speed makes in this time; at least 0."""
    interpolate: bool = True
    """Aim exactly the look-ahead away, between two points; otherwise at the next point beyond it."""
    delay_compensation: bool = False
    """Compute from where the vehicle will be by now, not from where it was at the state's stamp."""
    standstill_speed_mps: float = 0.1
    """Slower than this the vehicle stands: so fast it creeps up to a stop that it came to rest short of; at
    least 0."""

    def __post_init__(self) -> None:
        for name in ("wheelbase_m", "min_lookahead_m", "max_lookahead_m"):
            object.__setattr__(self, name, checks.positive(name, getattr(self, name)))
        for name in ("lookahead_time_s", "standstill_speed_mps"):
            object.__setattr__(self, name, checks.non_negative(name, getattr(self, name)))
        for name in ("interpolate", "delay_compensation"):
            if not isinstance(getattr(self, name), bool):
                raise InvalidValueError(f"{name} = {getattr(self, name)!r}: must be true or false")
        if self.max_lookahead_m < self.min_lookahead_m:
            raise InvalidValueError(
                f"max_lookahead_m = {self.max_lookahead_m}: must be at least min_lookahead_m = {self.min_lookahead_m}"
            )


class _Target(NamedTuple):
    """What the vehicle aims at, as seen from it."""

    dx_m: float
    dy_m: float
    """From the vehicle, in the trajectory's frame."""
    distance_m: float
    speed_squared: float
    """v·|v| in m²/s²: the square of the speed there, with its sign."""
    point: int
    """Index of the trajectory point that it is, or lies before."""


class PurePursuit(ControllerBase):
    """Pure pursuit on the rear axle's centre, forwards and backwards, from stop to stop.

    Look-ahead: clamp(|v| · lookahead time, least, greatest). Target: the first point from the spatial index
    on that is in the direction of travel and at least the look-ahead away, moved back along the path to
    exactly the look-ahead (along the straight line from the vehicle where the path does not cross that
    circle); otherwise the farthest one in the direction of travel; none: a stop command (`PAST_END_SPACE`
    on the last point, `DEVIATION` before it). Points beyond a change of direction are not in the direction
    of travel.

    Front wheels: atan(2 · y · L / d²) with the target y to the left, d away. Acceleration: ±|v_t² − v²| /
    (2 · max(d, 0.01 m)), + towards greater speeds and − towards lesser ones, signed as speeds are; a
    vehicle that moves against the direction of travel brakes with the sum of the squares.

    Command speed: the reference point's; 0 where that has the other direction than the vehicle is to take
    (just after a change of direction), so that it never asks for the wrong gear.

    Raises `InvalidValueError` where numbers beyond 1e150 leave no finite command.
    """

    def __init__(
        self,
        config: PurePursuitConfig | None = None,
        *,
        behavior: BehaviorConfig | None = None,
        clock: Callable[[], int] = monotonic_ns,
    ) -> None:
        """`clock` tells the age of a state for `delay_compensation` (nanoseconds, the stamps' clock)."""
        super().__init__(behavior)
        self.config = PurePursuitConfig() if config is None else config
        self._clock = clock
        self._stops_of: Progress | None = None
        self._stops = Stops((), 0)
        self._lookahead_point: tuple[float, float] | None = None

    @property
    def lookahead_point(self) -> tuple[float, float] | None:
        """The point (x, y) in metres that the last command steers at; None when that was a stop."""
        return None if self.is_stopping else self._lookahead_point

    def compute_command_impl(self, state: VehicleState) -> Command:
        progress = self._progress
        assert progress is not None  # the base calls only with a trajectory
        seen = self._compensated(state) if self.config.delay_compensation else state
        self._look_for_stops(progress, state)
        target = self._target(progress, seen)
        accel_mps2 = self._acceleration(progress, seen, target)
        if accel_mps2 is None:
            at_end = progress.spatial_index == progress.last
            return self.compute_stop_command(state, Reason.PAST_END_SPACE if at_end else Reason.DEVIATION)
        self._lookahead_point = None if target is None else (seen.x_m + target.dx_m, seen.y_m + target.dy_m)
        return Command(
            stamp_ns=state.stamp_ns,
            accel_mps2=accel_mps2,
            front_wheel_angle_rad=state.front_wheel_angle_rad if target is None else self._steering(seen, target),
            speed_mps=self._reference_speed(progress),
        )

    def stop_steering_impl(self, state: VehicleState) -> tuple[float, float]:
        """On at the target while there is one; straight otherwise, and in another frame."""
        progress = self._progress
        if progress is None or progress.last < 0 or state.frame_id != progress.trajectory.frame_id:
            return 0.0, 0.0
        if self._stops_of is not progress:
            self._look_for_stops(progress, state)
        target = self._target(progress, state)
        return (0.0, 0.0) if target is None else (self._steering(state, target), 0.0)

    def _compensated(self, state: VehicleState) -> VehicleState:
        """Where the vehicle is by now; braking ends at standstill."""
        age_s = min(max(s_from_ns(self._clock() - state.stamp_ns), 0.0), GREATEST_AGE_S)
        if state.speed_mps * state.accel_mps2 < 0.0:
            time_to_rest_s = -state.speed_mps / state.accel_mps2
            if time_to_rest_s < age_s:
                return replace(predict(state, time_to_rest_s), speed_mps=0.0, accel_mps2=0.0)
        return predict(state, age_s)

    # ── what to aim at ──

    def _look_for_stops(self, progress: Progress, state: VehicleState) -> None:
        """Goes on from the present stop when it is done, and knows the direction of travel afterwards."""
        index = progress.spatial_index
        if self._stops_of is not progress:
            self._stops_of, self._stops = progress, Stops(progress.speeds_mps, index)
        stops = self._stops
        stops.look(index, index)
        first = stops.first
        if first is None or first > index:
            return
        is_time = state.stamp_ns - progress.trajectory.stamp_ns >= progress.times_ns[stops.last]
        stands = abs(state.speed_mps) <= self.config.standstill_speed_mps
        if is_time and (stands or not stops.must_stand):
            stops.release()

    def _target(self, progress: Progress, seen: VehicleState) -> _Target | None:
        config, stops = self.config, self._stops
        lookahead_m = min(
            max(abs(seen.speed_mps) * config.lookahead_time_s, config.min_lookahead_m), config.max_lookahead_m
        )
        target = self._target_before(progress, seen, lookahead_m)
        if target is None or stops.first is not None:
            return target
        # one point further: the way back from a change of direction is behind the vehicle, and never aimed at
        if stops.look(progress.spatial_index, target.point + 1) and stops.turns:
            return self._target_before(progress, seen, lookahead_m)
        return target

    def _target_before(self, progress: Progress, seen: VehicleState, lookahead_m: float) -> _Target | None:
        """The target among the points up to the next change of direction."""
        stops, start = self._stops, progress.spatial_index
        end = stops.first + 1 if stops.first is not None and stops.turns else progress.last + 1
        ahead_x = math.cos(seen.heading_rad) * stops.direction
        ahead_y = math.sin(seen.heading_rad) * stops.direction
        xs_m, ys_m = progress.xs_m, progress.ys_m
        index = search_target(xs_m, ys_m, start, end, seen.x_m, seen.y_m, ahead_x, ahead_y, lookahead_m)
        if index < 0:
            return None
        dx_m, dy_m = xs_m[index] - seen.x_m, ys_m[index] - seen.y_m
        distance_m = math.hypot(dx_m, dy_m)
        square = _signed_square(progress.speeds_mps[index])
        if not self.config.interpolate or distance_m <= lookahead_m:
            return _Target(dx_m, dy_m, distance_m, square, index)
        if index > start:
            before_x_m, before_y_m = xs_m[index - 1] - seen.x_m, ys_m[index - 1] - seen.y_m
            part = _crossing(before_x_m, before_y_m, dx_m, dy_m, lookahead_m)
            x_m, y_m = before_x_m + part * (dx_m - before_x_m), before_y_m + part * (dy_m - before_y_m)
            if part >= 0.0 and x_m * ahead_x + y_m * ahead_y > 0.0:
                before = _signed_square(progress.speeds_mps[index - 1])
                return _Target(x_m, y_m, lookahead_m, before + part * (square - before), index)
        part, before = lookahead_m / distance_m, _signed_square(seen.speed_mps)
        return _Target(part * dx_m, part * dy_m, lookahead_m, before + part * (square - before), index)

    # ── what to do about it ──

    def _steering(self, seen: VehicleState, target: _Target) -> float:
        """Coulter's arc through the target, tangent to the vehicle; the same backwards.

        `atan2` is the arc tangent of the quotient here, also where d² is so small that it is 0.
        """
        left_m = math.cos(seen.heading_rad) * target.dy_m - math.sin(seen.heading_rad) * target.dx_m
        return math.atan2(2.0 * left_m * self.config.wheelbase_m, target.distance_m * target.distance_m)

    def _acceleration(self, progress: Progress, seen: VehicleState, target: _Target | None) -> float | None:
        """Towards the target's speed, or to rest at the stop before it; None when there is nowhere to go."""
        stops, square = self._stops, _signed_square(seen.speed_mps)
        if stops.first is None:
            return None if target is None else _acceleration(target.speed_squared, square, target.distance_m)
        if stops.first <= progress.spatial_index:
            return self._waiting(progress, seen, target)
        distance_m = math.hypot(progress.xs_m[stops.first] - seen.x_m, progress.ys_m[stops.first] - seen.y_m)
        if target is None:
            if distance_m > self.config.min_lookahead_m:
                return None
        elif target.point < stops.first:
            return _acceleration(target.speed_squared, square, target.distance_m)
        creeps = abs(seen.speed_mps) < self.config.standstill_speed_mps
        towards = stops.direction * _signed_square(self.config.standstill_speed_mps) if creeps else 0.0
        return _acceleration(towards, square, distance_m)

    def _waiting(self, progress: Progress, seen: VehicleState, target: _Target | None) -> float | None:
        """At a stop: to rest, at once where the vehicle should be standing already."""
        stops = self._stops
        if stops.must_stand:
            ends_here = stops.last == progress.last and target is None
            return None if ends_here else self.stop_acceleration(seen.speed_mps)
        if target is None:
            return None
        return _acceleration(0.0, _signed_square(seen.speed_mps), target.distance_m)

    def _reference_speed(self, progress: Progress) -> float:
        speed_mps = progress.speeds_mps[self.reference_index]
        return speed_mps if speed_mps * self._stops.direction >= 0.0 else 0.0


def search_target(
    xs_m: Sequence[float],
    ys_m: Sequence[float],
    start: int,
    end: int,
    x_m: float,
    y_m: float,
    ahead_x: float,
    ahead_y: float,
    lookahead_m: float,
) -> int:
    """The first of the points start..end−1 that is ahead of (x_m, y_m) and at least the look-ahead away.

    Ahead is where (p − s) · (ahead_x, ahead_y) > 0. Without such a point the farthest that is ahead, or −1.
    After the first 64 points the search ends four look-aheads further along the path, so that its cost does
    not depend on how long the trajectory is.
    """
    reach, stop = lookahead_m * lookahead_m, min(start + _SCALAR_POINTS, end)
    for index in range(start, stop):
        dx_m, dy_m = xs_m[index] - x_m, ys_m[index] - y_m
        if dx_m * dx_m + dy_m * dy_m >= reach and dx_m * ahead_x + dy_m * ahead_y > 0.0:
            return index
    farthest, greatest = _farthest(xs_m, ys_m, start, stop, x_m, y_m, ahead_x, ahead_y)
    if stop == end:
        return farthest
    return _search_in_blocks(xs_m, ys_m, stop, end, x_m, y_m, ahead_x, ahead_y, lookahead_m, farthest, greatest)


def _farthest(
    xs_m: Sequence[float],
    ys_m: Sequence[float],
    start: int,
    stop: int,
    x_m: float,
    y_m: float,
    ahead_x: float,
    ahead_y: float,
) -> tuple[int, float]:
    """The first of the farthest points ahead and the square of its distance; −1 and −1.0 without one."""
    farthest, greatest = -1, -1.0
    for index in range(start, stop):
        dx_m, dy_m = xs_m[index] - x_m, ys_m[index] - y_m
        square = dx_m * dx_m + dy_m * dy_m
        if square > greatest and dx_m * ahead_x + dy_m * ahead_y > 0.0:
            farthest, greatest = index, square
    return farthest, greatest


def _search_in_blocks(
    xs_m: Sequence[float],
    ys_m: Sequence[float],
    start: int,
    end: int,
    x_m: float,
    y_m: float,
    ahead_x: float,
    ahead_y: float,
    lookahead_m: float,
    farthest: int,
    greatest: float,
) -> int:
    """`search_target` goes on from `start` ≥ 1, with the farthest point so far and the square of its
    distance."""
    reach, way_m, size = lookahead_m * lookahead_m, 0.0, _FIRST_BLOCK
    with np.errstate(over="ignore", invalid="ignore"):
        while start < end and way_m <= _REACH * lookahead_m:
            stop = min(start + size, end)
            x, y = np.asarray(xs_m[start - 1 : stop]), np.asarray(ys_m[start - 1 : stop])  # (m + 1,)
            dx, dy = x[1:] - x_m, y[1:] - y_m  # (m,)
            ahead = dx * ahead_x + dy * ahead_y > 0.0
            square = np.where(ahead, dx * dx + dy * dy, -1.0)
            found = square >= reach
            if found.any():
                return start + int(found.argmax())
            best = int(square.argmax())
            if square[best] > greatest:
                farthest, greatest = start + best, float(square[best])
            way_m += float(np.hypot(np.diff(x), np.diff(y)).sum())
            start, size = stop, min(2 * size, _GREATEST_BLOCK)
    return farthest


def _crossing(ax_m: float, ay_m: float, bx_m: float, by_m: float, radius_m: float) -> float:
    """Where the way from a to b leaves the circle about the origin, as a part of it; −1 when a does not
    lead inside.

    The greater root of |a + t·(b − a)|² = r², for b outside the circle.
    """
    ex_m, ey_m = bx_m - ax_m, by_m - ay_m
    square, along = ex_m * ex_m + ey_m * ey_m, ax_m * ex_m + ay_m * ey_m
    outside = ax_m * ax_m + ay_m * ay_m - radius_m * radius_m
    rest = along * along - square * outside
    if square == 0.0 or rest < 0.0:
        return -1.0
    root = math.sqrt(rest)
    part = (root - along) / square if along <= 0.0 else -outside / (along + root)
    return part if 0.0 <= part <= 1.0 else -1.0


def _signed_square(speed_mps: float) -> float:
    return speed_mps * abs(speed_mps)


def _acceleration(target_square: float, square: float, distance_m: float) -> float:
    """From one signed square of speed to another over a distance: v² = u² + 2·a·s for either direction."""
    return (target_square - square) / (2.0 * max(distance_m, LEAST_DISTANCE_M))
