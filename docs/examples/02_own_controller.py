"""A controller of your own: steers against lateral and heading error (Stanley), at the reference speed.

    vehicle-iface run --interface embedded --route figure8 --controller docs/examples/02_own_controller.py:Stanley --arm

Source of the law: G. M. Hoffmann et al., "Autonomous Automobile Trajectory Tracking for Off-Road Driving", ACC 2007.
"""

import math

import numpy as np

from vehicle_iface import BehaviorConfig, Command, ControllerBase, Trajectory, VehicleState, tracking_error
from vehicle_iface.control import point_at

GAIN_PER_S = 0.8
"""How fast the lateral error is steered away."""
SOFTENING_MPS = 1.0
"""Keeps the steering gentle at low speed."""


class Stanley(ControllerBase):
    """`ControllerBase` stops the vehicle where there is nothing to follow; this class only computes."""

    def __init__(self, behavior: BehaviorConfig | None = None) -> None:
        super().__init__(behavior)
        self.length_m = 0.0

    def check_new_trajectory(self, trajectory: Trajectory) -> bool:
        """Reject a trajectory with a single point: it has no direction."""
        return len(trajectory) != 1

    def handle_new_trajectory(self, trajectory: Trajectory) -> Trajectory:
        """Called with each accepted trajectory, and returns the one to follow: the place for bookkeeping."""
        self.length_m = float(np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m)).sum())
        return trajectory

    def compute_command_impl(self, state: VehicleState) -> Command:
        """Angles in rad, positive to the left; acceleration in m/s² along the body's x axis."""
        assert self.trajectory is not None  # the base class calls this only with a trajectory
        point = point_at(self.trajectory, self.reference_index)
        error = tracking_error(state, point)
        lateral_rad = math.atan(GAIN_PER_S * error.lateral_m / (SOFTENING_MPS + abs(state.speed_mps)))
        return Command(
            stamp_ns=state.stamp_ns,
            accel_mps2=point.accel_mps2 - error.speed_mps,
            front_wheel_angle_rad=point.front_wheel_angle_rad - error.heading_rad - lateral_rad,
            speed_mps=point.speed_mps,
        )
