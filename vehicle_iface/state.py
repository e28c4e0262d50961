"""The vehicle's pose and motion at one instant."""

from math import isfinite

import msgspec

from vehicle_iface import checks
from vehicle_iface.value import Value

_NUMBERS = (
    "x_m",
    "y_m",
    "heading_rad",
    "speed_mps",
    "accel_mps2",
    "yaw_rate_radps",
    "lateral_speed_mps",
    "front_wheel_angle_rad",
    "rear_wheel_angle_rad",
)
_ALL_FLOAT = [float] * len(_NUMBERS)


class VehicleState(Value, frozen=True, kw_only=True, gc=False):
    """Pose and motion of the rear axle's centre at one instant (ISO 8855 signs: x forward, y left).

    Raises `InvalidValueError` when a number is not finite or the frame has no name.
    """

    stamp_ns: int
    """Receive time of the sample's first message, nanoseconds of the monotonic clock."""
    frame_id: str = "map"
    """Frame of reference of `x_m`, `y_m` and `heading_rad`."""
    x_m: float
    y_m: float
    heading_rad: float
    """Direction of the body's x axis, counter-clockwise from the frame's x axis; wrapped or not."""
    speed_mps: float
    """Along the body's x axis; negative when reversing."""
    accel_mps2: float = 0.0
    """Along the body's x axis, also when reversing: braking is positive then."""
    yaw_rate_radps: float = 0.0
    """Positive to the left."""
    lateral_speed_mps: float = 0.0
    """Along the body's y axis; positive to the left."""
    front_wheel_angle_rad: float = 0.0
    """Road-wheel angle, positive to the left."""
    rear_wheel_angle_rad: float = 0.0
    """Road-wheel angle, positive to the left."""

    def __post_init__(self) -> None:
        numbers = (
            self.x_m,
            self.y_m,
            self.heading_rad,
            self.speed_mps,
            self.accel_mps2,
            self.yaw_rate_radps,
            self.lateral_speed_mps,
            self.front_wheel_angle_rad,
            self.rear_wheel_angle_rad,
        )
        if list(map(type, numbers)) != _ALL_FLOAT or not isfinite(sum(numbers)):  # a finite sum has finite terms
            for name, value in zip(_NUMBERS, numbers, strict=True):
                msgspec.structs.force_setattr(self, name, checks.finite(name, value))
        if type(self.stamp_ns) is not int:
            msgspec.structs.force_setattr(self, "stamp_ns", checks.integer("stamp_ns", self.stamp_ns))
        if self.frame_id != "map":  # the usual one is known to be good
            checks.frame_id("frame_id", self.frame_id)
