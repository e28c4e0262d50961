"""Send a trajectory to a running loop from another process, as a planner does.

    vehicle-iface run --interface embedded --trajectory-mailbox /dev/shm/plan --arm &
    python docs/examples/03_post_trajectory.py /dev/shm/plan

The loop takes a trajectory whole or not at all and never waits for it. Its first point should be where the vehicle is.
"""

import sys

import numpy as np

from vehicle_iface import Trajectory, clock
from vehicle_iface.trajectories.mailbox import publish_trajectory

LENGTH_M, SPEED_MPS, ACCEL_MPS2, SPACING_M = 20.0, 2.0, 0.5, 0.25


def straight_line(stamp_ns: int) -> Trajectory:
    """20 m straight ahead from the origin: speeding up, cruising at 2 m/s, and braking to standstill at the end."""
    x_m = np.arange(0.0, LENGTH_M + SPACING_M / 2, SPACING_M)  # (n,)
    speed_mps = np.minimum(SPEED_MPS, np.sqrt(2.0 * ACCEL_MPS2 * np.minimum(x_m, LENGTH_M - x_m)))
    mean_mps = np.maximum(0.5 * (speed_mps[1:] + speed_mps[:-1]), 1e-3)
    time_s = np.concatenate(([0.0], np.cumsum(np.diff(x_m) / mean_mps)))
    return Trajectory(
        stamp_ns=stamp_ns,
        frame_id="map",
        time_from_start_ns=np.round(time_s * 1e9).astype(np.int64),
        x_m=x_m,
        y_m=np.zeros_like(x_m),
        heading_rad=np.zeros_like(x_m),
        speed_mps=speed_mps,
    )


if __name__ == "__main__":
    publish_trajectory(sys.argv[1], straight_line(clock.monotonic_ns()))
