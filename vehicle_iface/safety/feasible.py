"""Whether a vehicle may follow a trajectory at all."""

import numpy as np

from vehicle_iface.profile import Limits
from vehicle_iface.trajectory import FloatArray, Trajectory


def refusal(trajectory: Trajectory, limits: Limits) -> str:
    """The first point that asks for more than the limits allow, with the value and the limit; empty for none."""
    for name, limit in (
        ("speed_mps", limits.speed_max_mps),
        ("front_wheel_angle_rad", limits.front_wheel_angle_rad),
    ):
        values: FloatArray = getattr(trajectory, name)  # (n,)
        beyond = np.abs(values) > limit * (1.0 + 1e-9)
        if beyond.any():
            point = int(beyond.argmax())
            return f"{name}[{point}] = {values[point]:.10g}: must be in [{-limit}, {limit}]"
    return ""
