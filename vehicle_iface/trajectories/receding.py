"""Receding horizon: in each period a trajectory over the next seconds of a route."""

import math
from bisect import bisect_left, bisect_right

import numpy as np
import numpy.typing as npt

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.standstill import CREEPING_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectories.route import Route
from vehicle_iface.trajectory import FloatArray, Trajectory
from vehicle_iface.units import NS_PER_S, ns_from_s
from vehicle_iface.value import Value

_S, _X, _Y, _HEADING, _CURVATURE, _WHEEL, _SQUARED = range(7)
"""Rows of a leg's table. The last is v², at least `_FLOOR_MPS`²: linear in s at constant acceleration."""

_MAX_POINTS = 256
_FLOOR_MPS = 0.3
"""Lowest requested speed except into a stop: a first point at 0 m/s would have no direction."""
_ARRIVED_M = 0.02
_STOPPED_SHORT_M = 2.5
"""Within this distance of a stop a controller with 2 m look-ahead only finds 0 m/s: a vehicle at rest stays there."""
_WINDOW_M = 5.0
"""Length of route ahead in which the vehicle is searched: more than it drives in a period, less than a loop."""
_LOST_M = 4.0
"""Distance from the route beyond which the vehicle is searched on the whole route."""
_HEADING_WEIGHT_M = 3.0
"""Distance that 1 rad of heading error counts for in that search, which separates crossing branches."""
_SAME_PLACE_M = 1e-3


class _Leg(Value, frozen=True, eq=False):
    """One stretch from standstill to standstill, or a lap of a closed route with the beginning of the next."""

    table: FloatArray
    """(7, n), rows named above; s in metres from the route's beginning."""
    s_m: list[float]
    """The table's first row as floats, which bisect faster than an array."""
    direction: float
    end_m: float
    """Where the vehicle stops; infinite on a closed route."""
    dwell_ns: int
    """Dwell time at the end."""
    short_m: float
    """A vehicle at rest within this distance of the end has stopped there."""


class RecedingRoute:
    """Each period, a trajectory over the next seconds of a route, from the vehicle's position on it.

    The position on the route is searched near the last one and never goes back, so a route that crosses itself
    keeps its branch. At the beginning, and when the vehicle is more than 4 m off, the whole route is searched by
    distance and heading. Each trajectory begins at the vehicle's position on the route and its speed, and reaches
    the route's speeds with the route's acceleration. It does not pass a stop or a change of direction: it ends
    there at 0 m/s, and the next one begins when the vehicle has stood there for the dwell time. The route's end is
    a stop without a next one: no further trajectory is given, and the last one runs to its end.

    State and route must be in one frame; the controller checks that.
    """

    def __init__(self, route: Route, horizon_s: float = 8.0, period_s: float = 0.1, *, frame_id: str = "map") -> None:
        """`horizon_s` is the duration of each trajectory, `period_s` the time between them, both in seconds.

        Raises `InvalidValueError` when a number is not above zero or the frame has no name.
        """
        self.route = route
        self._frame_id = checks.frame_id("frame_id", frame_id)
        self._horizon_s = checks.positive("horizon_s", horizon_s)
        self._period_ns = ns_from_s(checks.positive("period_s", period_s))
        if self._period_ns < 1:
            raise InvalidValueError(f"period_s = {period_s}: must be at least 1 ns")
        self._accel_mps2 = route.config.accel_mps2
        self._legs = _build_legs(route, self._horizon_s)
        self.restart()

    @property
    def progress_m(self) -> float:
        """Position of the vehicle along the route in m, from its beginning; on a closed route within the lap."""
        return self._s_m

    @property
    def laps(self) -> int:
        """Number of times that the beginning of a closed route was passed since the start."""
        return self._laps

    @property
    def lap(self) -> int | None:
        """As `laps` on a closed route; None on an open one."""
        return self._laps if self.route.closed else None

    @property
    def finished(self) -> bool:
        """Whether the vehicle has reached the end of an open route."""
        return self._leg_index == len(self._legs)

    def restart(self) -> None:
        """Reset position, laps and period; the next call searches the whole route."""
        self._due_ns: int | None = None
        self._found = False
        self._s_m = 0.0
        self._laps = 0
        self._leg_index = 0
        self._standing_since_ns: int | None = None
        self._arrived = False

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:
        """Return the next seconds from the vehicle's position on, stamped `now_ns`; None when not due and at a stop.

        The first call is due, and then one after each whole period; missed ones are skipped.
        """
        if not self._is_due(now_ns) or self.finished:
            return None
        self._locate(state)
        if self._must_wait(now_ns, state):
            return None
        return self._cut(now_ns, state)

    def _is_due(self, now_ns: int) -> bool:
        if self._due_ns is None:
            self._due_ns = now_ns
        if now_ns < self._due_ns:
            return False
        missed = (now_ns - self._due_ns) // self._period_ns
        self._due_ns += (missed + 1) * self._period_ns
        return True

    def _locate(self, state: VehicleState) -> None:
        """Update the position along the route from the vehicle's pose."""
        if self._arrived:
            return
        leg = self._legs[self._leg_index]
        if self._found:
            s_m, distance_m = _project(leg, state, self._s_m)
            if distance_m <= _LOST_M:
                self._advance_to(max(s_m, self._s_m))
                return
        self._leg_index, index = _find_nearest(self._legs, self.route, state)
        leg = self._legs[self._leg_index]
        # Not across a closed route's beginning: a vehicle put just behind it has not driven a lap when it passes it.
        before = leg.s_m[max(index - 1, 0)]
        self._found, self._s_m = True, before
        self._advance_to(_project(leg, state, before)[0])

    def _advance_to(self, s_m: float) -> None:
        length_m = self.route.length_m
        if self.route.closed and s_m >= length_m:
            s_m -= length_m
            self._laps += 1
        self._s_m = s_m

    def _must_wait(self, now_ns: int, state: VehicleState) -> bool:
        """Return whether the vehicle must stay at the end of its leg; may advance to the next leg."""
        leg = self._legs[self._leg_index]
        standing = abs(state.speed_mps) < CREEPING_MPS
        left_m = leg.end_m - self._s_m
        self._arrived |= left_m < _ARRIVED_M or (standing and left_m < leg.short_m)
        if not self._arrived:
            return False
        if self._standing_since_ns is None and standing:
            self._standing_since_ns = now_ns
        if self._standing_since_ns is None or now_ns - self._standing_since_ns < leg.dwell_ns:
            return True
        self._s_m = leg.end_m
        self._leg_index += 1
        self._arrived, self._standing_since_ns = False, None
        return self.finished

    def _cut(self, now_ns: int, state: VehicleState) -> Trajectory:
        """Cut the trajectory from the position to the horizon or the leg's end."""
        leg = self._legs[self._leg_index]
        begin = bisect_right(leg.s_m, self._s_m + _SAME_PLACE_M)
        cut = _slice_table(leg, self._s_m, begin)
        s_m, heading, curvature = cut[_S], cut[_HEADING], cut[_CURVATURE]
        start_mps = max(state.speed_mps * leg.direction, _FLOOR_MPS)
        squared = np.minimum(cut[_SQUARED], start_mps**2 + 2.0 * self._accel_mps2 * (s_m - s_m[0]))
        speed_mps = np.sqrt(squared)
        spacing_m = s_m[1:] - s_m[:-1]
        times_s = np.empty_like(s_m)
        times_s[0] = 0.0
        np.cumsum(2.0 * spacing_m / (speed_mps[1:] + speed_mps[:-1]), out=times_s[1:])
        accel_mps2 = np.empty_like(s_m)
        accel_mps2[:-1] = leg.direction * (squared[1:] - squared[:-1]) / (2.0 * spacing_m)
        accel_mps2[-1] = 0.0
        # A whole number of turns off the heading, so that it stays small after many laps.
        turns = math.tau * round(float(heading[0]) / math.tau)
        signed_mps = leg.direction * speed_mps
        count = int(times_s.searchsorted(self._horizon_s)) + 1
        return Trajectory(
            stamp_ns=now_ns,
            frame_id=self._frame_id,
            time_from_start_ns=np.rint(times_s[:count] * NS_PER_S).astype(np.int64),
            x_m=cut[_X, :count],
            y_m=cut[_Y, :count],
            heading_rad=heading[:count] - turns,
            speed_mps=signed_mps[:count],
            accel_mps2=accel_mps2[:count],
            yaw_rate_radps=(signed_mps * curvature)[:count],
            front_wheel_angle_rad=cut[_WHEEL, :count],
        )


def _build_legs(route: Route, horizon_s: float) -> list[_Leg]:
    """Build the tables of the route's stretches, thinned so that a piece of `_MAX_POINTS` reaches the horizon."""
    reach_m = float(np.abs(route.speed_mps).max()) * horizon_s
    spacing_m = float(np.diff(route.s_m).max())
    stride = math.ceil(reach_m / (spacing_m * (_MAX_POINTS - 2)))
    table = np.stack(
        [
            route.s_m,
            route.x_m,
            route.y_m,
            route.heading_rad,
            route.curvature_per_m,
            route.front_wheel_angle_rad,
            route.speed_mps**2,
        ]
    )
    return [_leg(route, table, first, last, direction, stride) for first, last, direction in route.legs()]


def _leg(route: Route, table: FloatArray, first: int, last: int, direction: float, stride: int) -> _Leg:
    kept = np.append(np.arange(first, last, stride), last)
    table = _repeat_lap(table[:, kept]) if route.closed else table[:, kept]
    squared = np.maximum(table[_SQUARED], _FLOOR_MPS**2)
    if not route.closed:
        to_end_m = table[_S, -1] - table[_S]
        squared = np.minimum(squared, 2.0 * route.config.decel_mps2 * to_end_m)
    table[_SQUARED] = squared
    end_m = math.inf if route.closed else float(table[_S, -1])
    length_m = float(route.s_m[last] - route.s_m[first])
    return _Leg(
        table=table,
        s_m=table[_S].tolist(),
        direction=direction,
        end_m=end_m,
        dwell_ns=ns_from_s(float(route.dwell_s[last])),
        short_m=min(_STOPPED_SHORT_M, 0.4 * length_m),
    )


def _repeat_lap(table: FloatArray) -> FloatArray:
    """Return one lap, and as many more as a piece that begins at its end can need."""
    lap = table[:, :-1]
    step = table[:, -1] - table[:, 0]
    # Distance and heading continue from lap to lap; everything else starts again.
    step[[_X, _Y, _CURVATURE, _WHEEL, _SQUARED]] = 0.0
    count = 1 + math.ceil((_MAX_POINTS + 1) / lap.shape[1])
    return np.concatenate([lap + n * step[:, None] for n in range(count)], axis=1)


def _slice_table(leg: _Leg, s_m: float, begin: int) -> FloatArray:
    """Return (7, k): one column interpolated at `s_m`, then the table's columns from `begin` on."""
    behind, ahead = leg.table[:, begin - 1], leg.table[:, begin : begin + _MAX_POINTS - 1]
    piece = np.empty((len(leg.table), ahead.shape[1] + 1))
    share = (s_m - leg.s_m[begin - 1]) / (leg.s_m[begin] - leg.s_m[begin - 1])
    piece[:, 0] = behind + share * (ahead[:, 0] - behind)
    piece[:, 1:] = ahead
    return piece


def _project(leg: _Leg, state: VehicleState, from_s_m: float) -> tuple[float, float]:
    """Return the nearest place within the window ahead of `from_s_m`, and the distance to it, both in m."""
    first = max(bisect_right(leg.s_m, from_s_m) - 1, 0)
    last = bisect_right(leg.s_m, from_s_m + _WINDOW_M, first) + 1
    x, y = leg.table[_X, first:last] - state.x_m, leg.table[_Y, first:last] - state.y_m
    nearest = first + int((x * x + y * y).argmin())
    candidates = [_project_on_chord(leg, state, i) for i in (nearest - 1, nearest) if first <= i < len(leg.s_m) - 1]
    return min(candidates, key=lambda place: place[1], default=(leg.s_m[-1], math.inf))


def _project_on_chord(leg: _Leg, state: VehicleState, i: int) -> tuple[float, float]:
    """Return the nearest place on the line from point i to the next, and the distance to it, both in m."""
    (s0, s1), (x0, x1), (y0, y1) = leg.table[: _Y + 1, i : i + 2].tolist()
    dx, dy = x1 - x0, y1 - y0
    share = ((state.x_m - x0) * dx + (state.y_m - y0) * dy) / (dx * dx + dy * dy)
    share = min(max(share, 0.0), 1.0)
    distance_m = math.hypot(x0 + share * dx - state.x_m, y0 + share * dy - state.y_m)
    return s0 + share * (s1 - s0), distance_m


def _find_nearest(legs: list[_Leg], route: Route, state: VehicleState) -> tuple[int, int]:
    """Return the leg and point of the whole route that are nearest to the vehicle in place and heading."""
    best = (math.inf, 0, 0)
    for number, leg in enumerate(legs):
        count = bisect_left(leg.s_m, route.length_m) if route.closed else len(leg.s_m)
        x, y, heading = leg.table[[_X, _Y, _HEADING], :count]
        turned = _wrap(heading - state.heading_rad) * _HEADING_WEIGHT_M
        cost = (x - state.x_m) ** 2 + (y - state.y_m) ** 2 + turned**2
        index = int(cost.argmin())
        best = min(best, (float(cost[index]), number, index))
    return best[1], best[2]


def _wrap(angle_rad: npt.NDArray[np.float64]) -> FloatArray:
    """Wrap angles to [−π, π]."""
    return angle_rad - math.tau * np.rint(angle_rad / math.tau)
