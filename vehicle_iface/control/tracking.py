"""Reference index on the trajectory, in space and in time, and the tracking error against a reference point.

Both indices only increase, one point at a time; the cost of a step grows with the points that it passes. Points are
read through memory views, which give plain Python floats without a copy; a long jump continues in NumPy blocks with the
same arithmetic.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, Protocol, cast

import numpy as np

from vehicle_iface.errors import FrameMismatchError, InvalidValueError
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import wrapped_rad
from vehicle_iface.value import Value

PASSED_TOLERANCE = 1e-7
"""How far below zero a half-plane's product may be and still count as past it, in the product's own unit."""

_SCALAR_STEPS = 32
_FIRST_BLOCK, _GREATEST_BLOCK = 64, 16384


def as_numbers(array: np.typing.NDArray[Any]) -> Sequence[Any]:
    """`array` (n,) as a sequence of plain Python numbers, without a copy."""
    return cast("Sequence[Any]", memoryview(array))  # type: ignore[arg-type]  # arrays are buffers at run time


def advance_in_space(xs_m: Sequence[float], ys_m: Sequence[float], index: int, x_m: float, y_m: float) -> int:
    """Index of the last point, from `index` on, that (x_m, y_m) is past or level with.

    Past point i+1: (p_{i+1} − p_i) · (s − p_{i+1}) ≥ −`PASSED_TOLERANCE`; the walk ends at the first point
    that is not passed. Neighbours at one place give 0 and are passed together. A product that overflows to
    NaN (from coordinates beyond 1e150) does not pass its point.
    """
    last = len(xs_m) - 1
    stop = min(index + _SCALAR_STEPS, last)
    x0, y0 = xs_m[index], ys_m[index]
    while index < stop:
        x1, y1 = xs_m[index + 1], ys_m[index + 1]
        if not (x1 - x0) * (x_m - x1) + (y1 - y0) * (y_m - y1) >= -PASSED_TOLERANCE:
            return index
        index += 1
        x0, y0 = x1, y1
    return advance_in_blocks(xs_m, ys_m, index, x_m, y_m) if index < last else index


def advance_in_blocks(xs_m: Sequence[float], ys_m: Sequence[float], index: int, x_m: float, y_m: float) -> int:
    """As `advance_in_space`, for long jumps: growing blocks, so that the cost follows the number of points passed."""
    last, size = len(xs_m) - 1, _FIRST_BLOCK
    with np.errstate(over="ignore", invalid="ignore"):
        while index < last:
            stop = min(index + size, last)
            x, y = np.asarray(xs_m[index : stop + 1]), np.asarray(ys_m[index : stop + 1])  # (m + 1,)
            product = (x[1:] - x[:-1]) * (x_m - x[1:]) + (y[1:] - y[:-1]) * (y_m - y[1:])  # (m,)
            passed = product >= -PASSED_TOLERANCE
            if not passed.all():
                return index + int(passed.argmin())
            index, size = stop, min(2 * size, _GREATEST_BLOCK)
    return index


def advance_in_time(times_ns: Sequence[int], index: int, elapsed_ns: int) -> int:
    """Index of the last point, from `index` on, whose time is not after `elapsed_ns`; `index` when there is none.

    Exact integers. Steps of doubling length, then a bisection: the cost grows with the logarithm of the advance.
    """
    end, step = len(times_ns), 1
    if index + 1 >= end or times_ns[index + 1] > elapsed_ns:
        return index  # the usual case at the loop's rate
    while index + step < end and times_ns[index + step] <= elapsed_ns:
        index += step
        step *= 2
    return bisect_right(times_ns, elapsed_ns, index + 1, min(index + step, end)) - 1


class PathProgress:
    """One trajectory and the vehicle's progress on it. Created for each trajectory, at constant cost."""

    __slots__ = (
        "end_ns",
        "last",
        "spatial_index",
        "speeds_mps",
        "temporal_index",
        "times_ns",
        "trajectory",
        "xs_m",
        "ys_m",
    )

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self.last = len(trajectory) - 1
        """Index of the last point; −1 when there is none."""
        self.xs_m: Sequence[float] = as_numbers(trajectory.x_m)
        self.ys_m: Sequence[float] = as_numbers(trajectory.y_m)
        self.speeds_mps: Sequence[float] = as_numbers(trajectory.speed_mps)
        self.times_ns: Sequence[int] = as_numbers(trajectory.time_from_start_ns)
        self.end_ns = trajectory.stamp_ns + (self.times_ns[-1] if self.last >= 0 else 0)
        """Stamp of the last point."""
        self.spatial_index = 0
        self.temporal_index = 0

    def advance(self, stamp_ns: int, x_m: float, y_m: float) -> None:
        """Advance both indices to this time and this position."""
        elapsed_ns = stamp_ns - self.trajectory.stamp_ns
        self.temporal_index = advance_in_time(self.times_ns, self.temporal_index, elapsed_ns)
        self.spatial_index = advance_in_space(self.xs_m, self.ys_m, self.spatial_index, x_m, y_m)

    def is_past_end_in_time(self, stamp_ns: int) -> bool:
        """Whether the last point's time has come."""
        return stamp_ns >= self.end_ns

    def is_past_end_in_space(self, x_m: float, y_m: float) -> bool:
        """Whether the last point is reached and the plane through it, across its heading, is passed."""
        last = self.last
        if self.spatial_index != last:
            return False
        heading_rad = float(self.trajectory.heading_rad[last])
        past_m = math.cos(heading_rad) * (x_m - self.xs_m[last])
        past_m += math.sin(heading_rad) * (y_m - self.ys_m[last])
        return past_m >= -PASSED_TOLERANCE


class Reference(Protocol):
    """The attributes that `tracking_error` reads of a reference: those of `ReferencePoint` and `VehicleState`."""

    @property
    def x_m(self) -> float: ...
    @property
    def y_m(self) -> float: ...
    @property
    def heading_rad(self) -> float: ...
    @property
    def speed_mps(self) -> float: ...
    @property
    def accel_mps2(self) -> float: ...
    @property
    def yaw_rate_radps(self) -> float: ...


class ReferencePoint(Value, frozen=True, kw_only=True):
    """One point of a trajectory, in plain floats."""

    stamp_ns: int
    """Time at which the vehicle should be here, nanoseconds of the monotonic clock."""
    frame_id: str = "map"
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    """Negative where the vehicle reverses."""
    accel_mps2: float = 0.0
    yaw_rate_radps: float = 0.0
    front_wheel_angle_rad: float = 0.0


class TrackingError(Value, frozen=True, kw_only=True):
    """State minus reference. The position error is in the reference's axes: x along its heading, y to its left."""

    lateral_m: float
    """Positive when the vehicle is left of the reference."""
    longitudinal_m: float
    """Positive when the vehicle is ahead, along the reference's heading, also where it reverses."""
    heading_rad: float
    """Positive when the vehicle's heading is further left; in [−π, π]."""
    speed_mps: float
    """Positive when the vehicle is faster forwards."""
    accel_mps2: float
    yaw_rate_radps: float


def point_at(trajectory: Trajectory, index: int) -> ReferencePoint:
    """Point `index` of a trajectory, counted from 0. Raises `InvalidValueError` when there is no such point."""
    if not 0 <= index < len(trajectory):
        raise InvalidValueError(f"index = {index}: must be in 0..{len(trajectory) - 1}")
    return ReferencePoint(
        stamp_ns=trajectory.stamp_ns + int(trajectory.time_from_start_ns[index]),
        frame_id=trajectory.frame_id,
        x_m=float(trajectory.x_m[index]),
        y_m=float(trajectory.y_m[index]),
        heading_rad=float(trajectory.heading_rad[index]),
        speed_mps=float(trajectory.speed_mps[index]),
        accel_mps2=float(trajectory.accel_mps2[index]),
        yaw_rate_radps=float(trajectory.yaw_rate_radps[index]),
        front_wheel_angle_rad=float(trajectory.front_wheel_angle_rad[index]),
    )


def tracking_error(state: VehicleState, reference_point: Reference) -> TrackingError:
    """The error of the state against the reference: state minus reference.

    The difference in position is turned into the reference point's axes (x along its heading, y to its left);
    the heading error is wrapped. Raises `FrameMismatchError` when the reference names another frame.
    """
    frame_id = getattr(reference_point, "frame_id", state.frame_id)
    if frame_id != state.frame_id:
        raise FrameMismatchError(f"state in frame {state.frame_id!r}, reference in {frame_id!r}")
    dx_m, dy_m = state.x_m - reference_point.x_m, state.y_m - reference_point.y_m
    longitudinal_m, lateral_m = to_body_axes(dx_m, dy_m, reference_point.heading_rad)
    return TrackingError(
        lateral_m=lateral_m,
        longitudinal_m=longitudinal_m,
        heading_rad=wrapped_rad(state.heading_rad - reference_point.heading_rad),
        speed_mps=state.speed_mps - reference_point.speed_mps,
        accel_mps2=state.accel_mps2 - reference_point.accel_mps2,
        yaw_rate_radps=state.yaw_rate_radps - reference_point.yaw_rate_radps,
    )


def to_body_axes(dx_m: float, dy_m: float, heading_rad: float) -> tuple[float, float]:
    """A difference in position (m) in the axes of a heading: the distance along it, and to its left."""
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    return cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m
