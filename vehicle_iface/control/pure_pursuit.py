"""Pure pursuit: steer on the arc through a point of the trajectory at the look-ahead distance.

R. C. Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992, for the
arc. Around it, as Autoware.Auto's controller has them: the direction of travel, the interpolated look-ahead
point (see `lookahead`), and an acceleration from v² = u² + 2·a·s. Stops on the way (see `stop_schedule`) are taken one
after the other.
"""

import math
from collections.abc import Callable, Generator, Iterator

from msgspec.structs import force_setattr, replace

from vehicle_iface import checks
from vehicle_iface.clock import monotonic_ns
from vehicle_iface.command import Command
from vehicle_iface.control.base import BehaviorConfig, ControllerBase
from vehicle_iface.control.lookahead import ArcLength, search_target
from vehicle_iface.control.prediction import predict
from vehicle_iface.control.stop_schedule import Stops, StopSchedule, find_stops
from vehicle_iface.control.tracking import PathProgress
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.pieces import finish
from vehicle_iface.reason import Reason
from vehicle_iface.standstill import CREEPING_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import FloatArray, Trajectory
from vehicle_iface.units import s_from_ns
from vehicle_iface.value import Value

LEAST_DISTANCE_M = 0.01
"""The acceleration law divides by this distance at least."""
GREATEST_AGE_S = 0.5
"""Delay compensation predicts at most this far ahead: an older state is too uncertain."""


class PurePursuitConfig(Value, frozen=True, kw_only=True):
    """The vehicle and the look-ahead. Raises `InvalidValueError`."""

    wheelbase_m: float = 2.7
    """Front to rear axle; above 0."""
    min_lookahead_m: float = 2.0
    """Above 0."""
    max_lookahead_m: float = 20.0
    """At least `min_lookahead_m`."""
    lookahead_time_s: float = 1.0
    """The look-ahead is the distance driven in this time; at least 0."""
    interpolate: bool = True
    """Aim at exactly the look-ahead distance, between two points; otherwise at the next point beyond it."""
    delay_compensation: bool = False
    """Compute from the state predicted for now, not from the one at its stamp."""
    standstill_speed_mps: float = CREEPING_MPS
    """Below this speed the vehicle counts as standing; it is also the speed at which it creeps up to a stop that it did
    not quite reach. At least 0."""

    def __post_init__(self) -> None:
        for name in ("wheelbase_m", "min_lookahead_m", "max_lookahead_m"):
            force_setattr(self, name, checks.positive(name, getattr(self, name)))
        for name in ("lookahead_time_s", "standstill_speed_mps"):
            force_setattr(self, name, checks.non_negative(name, getattr(self, name)))
        for name in ("interpolate", "delay_compensation"):
            if not isinstance(getattr(self, name), bool):
                raise InvalidValueError(f"{name} = {getattr(self, name)!r}: must be true or false")
        if self.max_lookahead_m < self.min_lookahead_m:
            raise InvalidValueError(
                f"max_lookahead_m = {self.max_lookahead_m}: must be at least min_lookahead_m = {self.min_lookahead_m}"
            )


class _Target(Value, frozen=True, gc=False):
    """What the vehicle aims at, as seen from it."""

    dx_m: float
    dy_m: float
    """From the vehicle, in the trajectory's frame."""
    distance_m: float
    point: int
    """Index of the trajectory point that it is, or that was moved back to it; the speed is that point's."""


class PurePursuit(ControllerBase):
    """Pure pursuit on the rear axle's centre, forwards and backwards, from stop to stop.

    Look-ahead distance: |v| · `lookahead_time_s`, clamped to `min_lookahead_m` … `max_lookahead_m`. Target: the
    first point from the spatial index on that is in the direction of travel and at least the look-ahead away,
    moved back along the path to exactly the look-ahead (or along the straight line from the vehicle where the
    path does not cross that circle); it keeps its speed. If no point is that far away, the target is the
    farthest one in the direction of travel. If there is none: a stop command (`PAST_END_SPACE` on the last
    point, `DEVIATION` before it). Points beyond a change of direction are not in the direction of travel.

    Front wheel angle: atan(2 · y · L / d²) with the target at the distance d, y of it to the left.
    Acceleration along the body's x axis: (v_t · |v_t| − v · |v|) / (2 · max(d, 0.01 m)). If a dwell or a change
    of direction comes before the target, the vehicle brakes for that instead, and creeps to it if it came to
    rest before it. The end of the trajectory is a target like any other.

    Command speed: the reference point's; 0 where its direction is not the vehicle's next one (just after a
    change of direction), so that the wrong gear is never requested.

    Raises `InvalidValueError` where numbers beyond 1e150 leave no finite command.
    """

    def __init__(
        self,
        config: PurePursuitConfig | None = None,
        *,
        behavior: BehaviorConfig | None = None,
        clock: Callable[[], int] = monotonic_ns,
    ) -> None:
        """`clock` returns the time for `delay_compensation`, in nanoseconds of the stamps' clock."""
        super().__init__(behavior)
        self.config = PurePursuitConfig() if config is None else config
        self._clock = clock
        self._found = Stops()
        self._found_in: FloatArray | None = None
        """The locked array `x_m` of the trajectory with these stops."""
        self._stops_of: PathProgress | None = None
        self._stops: StopSchedule
        self._arc_length: ArcLength
        self._lookahead_point: tuple[float, float] | None = None

    @property
    def lookahead_point(self) -> tuple[float, float] | None:
        """The point (x, y) in metres that the last command steers at; None when that was a stop."""
        return None if self.is_stopping else self._lookahead_point

    def compute_command_impl(self, state: VehicleState) -> Command:
        progress = self._progress
        assert progress is not None  # the base calls only with a trajectory
        seen = self._compensate_delay(state) if self.config.delay_compensation else state
        self._go_on_from_stops(progress, state)
        target = self._target(progress, seen)
        accel_mps2 = self._acceleration(progress, seen, target)
        if accel_mps2 is None:
            at_end = progress.spatial_index == progress.last
            return self.compute_stop_command(state, Reason.PAST_END_SPACE if at_end else Reason.DEVIATION)
        if target is None:
            self._lookahead_point, front_rad = None, state.front_wheel_angle_rad
        else:
            self._lookahead_point = seen.x_m + target.dx_m, seen.y_m + target.dy_m
            front_rad = self._steering(seen, target)
        return Command(
            stamp_ns=state.stamp_ns,
            accel_mps2=accel_mps2,
            front_wheel_angle_rad=front_rad,
            speed_mps=self._reference_speed(progress),
        )

    def prepare_new_trajectory(self, trajectory: Trajectory) -> Iterator[None]:
        """Find the trajectory's stops."""
        if len(trajectory):
            yield from self._find_stops(trajectory)

    def stop_steering_impl(self, state: VehicleState) -> tuple[float, float]:
        """On at the target while there is one; straight otherwise, and in another frame."""
        progress = self._progress
        if progress is None or progress.last < 0 or state.frame_id != progress.trajectory.frame_id:
            return 0.0, 0.0
        self._take_up(progress)
        target = self._target(progress, state)
        return (0.0, 0.0) if target is None else (self._steering(state, target), 0.0)

    def _compensate_delay(self, state: VehicleState) -> VehicleState:
        """The state predicted for now; braking ends at standstill."""
        age_s = min(max(s_from_ns(self._clock() - state.stamp_ns), 0.0), GREATEST_AGE_S)
        if state.speed_mps * state.accel_mps2 < 0.0:
            time_to_rest_s = -state.speed_mps / state.accel_mps2
            if time_to_rest_s < age_s:
                return replace(predict(state, time_to_rest_s), speed_mps=0.0, accel_mps2=0.0)
        return predict(state, age_s)

    # ── what to aim at ──

    def _take_up(self, progress: PathProgress) -> None:
        """Compute stops and arc length of a new trajectory."""
        if self._stops_of is not progress:
            trajectory = progress.trajectory
            if trajectory.x_m is not self._found_in:
                finish(self._find_stops(trajectory))
            self._stops, self._arc_length = StopSchedule(progress, self._found), ArcLength(progress.xs_m, progress.ys_m)
            self._stops_of = progress

    def _find_stops(self, trajectory: Trajectory) -> Generator[None]:
        found = yield from find_stops(trajectory)
        self._found, self._found_in = found, trajectory.x_m

    def _go_on_from_stops(self, progress: PathProgress, state: VehicleState) -> None:
        """Goes on from the present stop when it is done, and knows the direction of travel afterwards."""
        self._take_up(progress)
        stops, index = self._stops, progress.spatial_index
        if stops.first > index:
            return
        if stops.last < index and not stops.must_stand:
            stops.resume(index)  # the vehicle was set ahead, past stops
            if stops.first > index:
                return
        is_time = state.stamp_ns - progress.trajectory.stamp_ns >= progress.times_ns[stops.last]
        stands = abs(state.speed_mps) <= self.config.standstill_speed_mps
        if is_time and (stands or not stops.must_stand):
            stops.release(index)

    def _target(self, progress: PathProgress, seen: VehicleState) -> _Target | None:
        """The target among the points up to the next change of direction."""
        config, stops, start = self.config, self._stops, progress.spatial_index
        lookahead_m = abs(seen.speed_mps) * config.lookahead_time_s
        if lookahead_m < config.min_lookahead_m:
            lookahead_m = config.min_lookahead_m
        elif lookahead_m > config.max_lookahead_m:
            lookahead_m = config.max_lookahead_m
        end = max(stops.first, start) + 1 if stops.turns else progress.last + 1
        ahead_x = math.cos(seen.heading_rad) * stops.direction
        ahead_y = math.sin(seen.heading_rad) * stops.direction
        index = search_target(self._arc_length, start, end, seen.x_m, seen.y_m, ahead_x, ahead_y, lookahead_m)
        if index < 0:
            return None
        if start < stops.first <= index:
            stops.must_stand = True
        dx_m, dy_m = progress.xs_m[index] - seen.x_m, progress.ys_m[index] - seen.y_m
        distance_m = math.hypot(dx_m, dy_m)
        if distance_m <= lookahead_m or not config.interpolate:
            return _Target(dx_m, dy_m, distance_m, index)
        if index > start:
            before_x_m, before_y_m = progress.xs_m[index - 1] - seen.x_m, progress.ys_m[index - 1] - seen.y_m
            part = _crossing(before_x_m, before_y_m, dx_m, dy_m, lookahead_m)
            x_m, y_m = before_x_m + part * (dx_m - before_x_m), before_y_m + part * (dy_m - before_y_m)
            if part >= 0.0 and x_m * ahead_x + y_m * ahead_y > 0.0:
                return _Target(x_m, y_m, lookahead_m, index)
        part = lookahead_m / distance_m
        return _Target(part * dx_m, part * dy_m, lookahead_m, index)

    # ── what to do about it ──

    def _steering(self, seen: VehicleState, target: _Target) -> float:
        """Coulter's arc through the target, tangent to the vehicle; the same backwards.

        `atan2` is the arc tangent of the quotient here, also where d² is so small that it is 0.
        """
        left_m = math.cos(seen.heading_rad) * target.dy_m - math.sin(seen.heading_rad) * target.dx_m
        return math.atan2(2.0 * left_m * self.config.wheelbase_m, target.distance_m * target.distance_m)

    def _acceleration(self, progress: PathProgress, seen: VehicleState, target: _Target | None) -> float | None:
        """Towards the target's speed, or to rest at the stop before it; None when there is neither."""
        stops = self._stops
        if target is not None and target.point < stops.first:
            speed_mps = progress.speeds_mps[target.point]
            return _acceleration(speed_mps, seen.speed_mps, target.distance_m)
        if stops.first > progress.last:
            return None
        if stops.first <= progress.spatial_index:
            return self._hold_for_stop(seen, target)
        distance_m = math.hypot(progress.xs_m[stops.first] - seen.x_m, progress.ys_m[stops.first] - seen.y_m)
        if target is None and distance_m > self.config.min_lookahead_m:
            return None
        creeps = abs(seen.speed_mps) < self.config.standstill_speed_mps
        towards_mps = stops.direction * self.config.standstill_speed_mps if creeps else 0.0
        return _acceleration(towards_mps, seen.speed_mps, distance_m)

    def _hold_for_stop(self, seen: VehicleState, target: _Target | None) -> float | None:
        """At a stop: to rest, at once where the vehicle should be standing already."""
        if self._stops.must_stand:
            return self.stop_acceleration(seen.speed_mps)
        return None if target is None else _acceleration(0.0, seen.speed_mps, target.distance_m)

    def _reference_speed(self, progress: PathProgress) -> float:
        speed_mps = progress.speeds_mps[self.reference_index]
        return speed_mps if speed_mps * self._stops.direction >= 0.0 else 0.0


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


def _acceleration(target_mps: float, speed_mps: float, distance_m: float) -> float:
    """From one speed to another over a distance: v² = u² + 2·a·s, the squares signed as the speeds are."""
    squares = target_mps * abs(target_mps) - speed_mps * abs(speed_mps)
    return squares / (2.0 * (distance_m if distance_m > LEAST_DISTANCE_M else LEAST_DISTANCE_M))
