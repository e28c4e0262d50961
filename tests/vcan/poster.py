"""Another process that posts trajectories: `poster.py FILE empty`, `FILE line LENGTH_M LAST_S [TIMES]`.

A line runs along +x from the origin at 3 m/s; its last point is due after LAST_S. TIMES are posted at 10 Hz.
"""

import sys
import time

import numpy as np

from vehicle_iface import clock
from vehicle_iface.trajectories.mailbox import post
from vehicle_iface.trajectory import Trajectory


def main(file: str, kind: str, length_m: str = "0", last_s: str = "0", times: str = "1") -> None:
    """Post, and end."""
    if kind == "empty":
        post(file, Trajectory.empty(stamp_ns=clock.monotonic_ns()))
        return
    x_m = np.arange(0.0, float(length_m), 0.5)
    zeros = np.zeros_like(x_m)
    for left in range(int(times), 0, -1):
        post(
            file,
            Trajectory(
                stamp_ns=clock.monotonic_ns(),
                time_from_start_ns=np.linspace(0.0, float(last_s) * 1e9, len(x_m)).astype(np.int64),
                x_m=x_m,
                y_m=zeros,
                heading_rad=zeros,
                speed_mps=zeros + 3.0,
            ),
        )
        if left > 1:
            time.sleep(0.1)


if __name__ == "__main__":
    main(*sys.argv[1:])
