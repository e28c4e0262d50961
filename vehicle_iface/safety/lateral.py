"""Limits of the front wheel angle at a speed: lateral acceleration and jerk of the bicycle model without slip.

Curvature κ = (tan δ_front − tan δ_rear) / L, lateral acceleration v²·κ, lateral jerk v²·dκ/dt
(R. Rajamani, Vehicle Dynamics and Control, 2nd ed., 2.2; bounds: ISO 11270).
"""

import math


def curvature_per_m(front_rad: float, rear_rad: float, wheelbase_m: float) -> float:
    """Curvature of the path of the rear axle's centre, in 1/m, positive to the left. Angles in rad."""
    return (math.tan(front_rad) - math.tan(rear_rad)) / wheelbase_m
