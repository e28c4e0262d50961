"""Convert the pose of a sensor to that of the rear axle's centre, and back.

Only the pose is converted. A speed that is measured at the sensor differs from that of the rear axle by the yaw rate
times the lever arm (v − r·y forwards, v + r·x to the left): bind a speed that the vehicle computes for its rear axle,
or that of its wheels. The yaw rate is the same everywhere on the vehicle.
"""

import math

from vehicle_iface.pose.data import Pose
from vehicle_iface.units import wrapped_rad
from vehicle_iface.value import Value


class SensorMount(Value, frozen=True, kw_only=True):
    """Position and heading of a sensor on the vehicle, from the rear axle's centre in body axes."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0

    def to_body(self, sensor: Pose) -> Pose:
        """Convert the sensor's pose to that of the rear axle's centre, in the same frame."""
        heading_rad = sensor.heading_rad - self.heading_rad
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        return Pose(
            x_m=sensor.x_m - cos * self.x_m + sin * self.y_m,
            y_m=sensor.y_m - sin * self.x_m - cos * self.y_m,
            heading_rad=wrapped_rad(heading_rad),
        )

    def to_sensor(self, body: Pose) -> Pose:
        """Convert the pose of the rear axle's centre to that of the sensor, in the same frame."""
        cos, sin = math.cos(body.heading_rad), math.sin(body.heading_rad)
        return Pose(
            x_m=body.x_m + cos * self.x_m - sin * self.y_m,
            y_m=body.y_m + sin * self.x_m + cos * self.y_m,
            heading_rad=wrapped_rad(body.heading_rad + self.heading_rad),
        )
