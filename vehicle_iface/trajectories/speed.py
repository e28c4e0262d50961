"""Speed profile of a path: the lateral limit first, then the limits of acceleration and deceleration.

All arrays belong to points at `s_m` (n,), rising, of a path. Between neighbours the acceleration is constant, so v² is
linear in distance: v₂² = v₁² + 2·a·Δs.
"""

import numpy as np

from vehicle_iface.trajectory import FloatArray


def lateral_limit_mps(curvature_per_m: FloatArray, *, speed_mps: float, lateral_accel_mps2: float) -> FloatArray:
    """Return (n,) the highest speeds with v²·|κ| within the lateral acceleration, at most `speed_mps`."""
    sharp = np.maximum(np.abs(curvature_per_m), lateral_accel_mps2 / speed_mps**2)
    return np.sqrt(lateral_accel_mps2 / sharp)


def reachable_mps(s_m: FloatArray, limit_mps: FloatArray, *, accel_mps2: float, decel_mps2: float) -> FloatArray:
    """Return (n,) the highest speeds within `limit_mps` that the vehicle can reach and can slow down from.

    v²(s) − 2·a·s never rises when a is the acceleration limit: its running minimum is the forward pass, and
    the same from behind with the deceleration is the backward pass.
    """
    squared = limit_mps**2
    gain = 2.0 * accel_mps2 * s_m
    squared = gain + np.minimum.accumulate(squared - gain)
    loss = 2.0 * decel_mps2 * s_m
    squared = np.minimum.accumulate((squared + loss)[::-1])[::-1] - loss
    # Rounding must not lift a limit; above all a stop stays exactly 0, by which it is known as one.
    return np.minimum(limit_mps, np.sqrt(np.maximum(squared, 0.0)))


def reachable_cyclic_mps(s_m: FloatArray, limit_mps: FloatArray, *, accel_mps2: float, decel_mps2: float) -> FloatArray:
    """Return (n,) the reachable speeds on a closed path, whose last point is the first again: equal in each lap."""
    length_m = float(s_m[-1])
    three_s_m = np.concatenate([s_m[:-1] - length_m, s_m[:-1], s_m + length_m])
    three_mps = np.concatenate([limit_mps[:-1], limit_mps[:-1], limit_mps])
    lap = len(s_m) - 1
    speeds = reachable_mps(three_s_m, three_mps, accel_mps2=accel_mps2, decel_mps2=decel_mps2)
    return speeds[lap : 2 * lap + 1]


def durations_s(s_m: FloatArray, speed_mps: FloatArray) -> FloatArray:
    """Return (n − 1,) the time from each point to the next at constant acceleration: distance over mean speed.

    `speed_mps` is without sign; two neighbours at standstill some way apart have no finite time between them.
    """
    return 2.0 * np.diff(s_m) / (speed_mps[1:] + speed_mps[:-1])


def accelerations_mps2(s_m: FloatArray, speed_mps: FloatArray) -> FloatArray:
    """Return (n,) the acceleration of the stretch that begins at each point; at the last point, of the last stretch."""
    stretch = np.diff(speed_mps**2) / (2.0 * np.diff(s_m))
    return np.append(stretch, stretch[-1:])
