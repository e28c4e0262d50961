"""Pure pursuit as it is commonly written: two ways to find the point to aim at, one arc.

`WalkingPursuit` is in the manner of PythonRobotics: points in lists, the nearest one of all for the first state, and
from there on walked along while the distance shrinks. `NearestPursuit` looks at all points for each state with NumPy.
Neither checks anything, brakes, or knows time.
"""

import math

import numpy as np

from vehicle_iface import Trajectory, VehicleState


class WalkingPursuit:
    """Remembers the nearest point."""

    def __init__(self, trajectory: Trajectory, wheelbase_m: float, lookahead_time_s: float) -> None:
        self.xs_m: list[float] = trajectory.x_m.tolist()
        self.ys_m: list[float] = trajectory.y_m.tolist()
        self.wheelbase_m = wheelbase_m
        self.lookahead_time_s = lookahead_time_s
        self.nearest: int | None = None

    def steering(self, state: VehicleState) -> float:
        if self.nearest is None:
            dx_m = [state.x_m - x_m for x_m in self.xs_m]
            dy_m = [state.y_m - y_m for y_m in self.ys_m]
            self.nearest = int(np.argmin(np.hypot(dx_m, dy_m)))
        index = self.nearest
        while index + 1 < len(self.xs_m) and self._distance_m(index + 1, state) < self._distance_m(index, state):
            index += 1
        self.nearest = index
        lookahead_m = self.lookahead_time_s * state.speed_mps
        while index + 1 < len(self.xs_m) and self._distance_m(index, state) < lookahead_m:
            index += 1
        return _steering(state, self.xs_m[index], self.ys_m[index], self.wheelbase_m)

    def _distance_m(self, index: int, state: VehicleState) -> float:
        return math.hypot(self.xs_m[index] - state.x_m, self.ys_m[index] - state.y_m)


class NearestPursuit:
    """Remembers nothing."""

    def __init__(self, trajectory: Trajectory, wheelbase_m: float, lookahead_time_s: float) -> None:
        self.points_m = np.column_stack([trajectory.x_m, trajectory.y_m])  # (n, 2)
        self.wheelbase_m = wheelbase_m
        self.lookahead_time_s = lookahead_time_s

    def steering(self, state: VehicleState) -> float:
        distances_m = np.linalg.norm(self.points_m - (state.x_m, state.y_m), axis=1)
        nearest = int(np.argmin(distances_m))
        far_enough = distances_m[nearest:] >= self.lookahead_time_s * state.speed_mps
        x_m, y_m = self.points_m[nearest + int(np.argmax(far_enough))]
        return _steering(state, float(x_m), float(y_m), self.wheelbase_m)


def _steering(state: VehicleState, x_m: float, y_m: float, wheelbase_m: float) -> float:
    dx_m, dy_m = x_m - state.x_m, y_m - state.y_m
    angle_rad = math.atan2(dy_m, dx_m) - state.heading_rad
    return math.atan2(2.0 * wheelbase_m * math.sin(angle_rad), math.hypot(dx_m, dy_m))
