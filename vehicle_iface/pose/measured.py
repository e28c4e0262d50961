"""Measured poses: local ones, and geographic ones in the plane at an origin."""

import math

from vehicle_iface.errors import ConfigError
from vehicle_iface.pose.data import Pose, PoseInputs
from vehicle_iface.pose.geographic import Fix, GeographicPlane, PlanePoint
from vehicle_iface.pose.mount import SensorMount
from vehicle_iface.units import wrapped_rad


class LocalPosition:
    """A position and a heading in the frame itself."""

    driven_m: float | None = None

    def __init__(self, mount: SensorMount) -> None:
        self._mount = mount
        self.invalid_because = ""

    def resolve(self, stamp_ns: int, values: PoseInputs) -> Pose | None:  # noqa: ARG002
        """Convert the sensor's pose to that of the rear axle's centre."""
        x_m, y_m, heading_rad = values.x_m, values.y_m, values.heading_rad
        if x_m is None or y_m is None or heading_rad is None or not math.isfinite(x_m + y_m + heading_rad):
            self.invalid_because = "position or heading without a value"
            return None
        self.invalid_because = ""
        return self._mount.to_body(Pose(x_m=x_m, y_m=y_m, heading_rad=heading_rad))

    def reset(self) -> None:
        """Do nothing: no data is kept between samples."""
        self.invalid_because = ""

    def measure(self, body: Pose) -> PoseInputs:
        """Return the sensor's measurement at a pose of the rear axle's centre."""
        sensor = self._mount.to_sensor(body)
        return PoseInputs(x_m=sensor.x_m, y_m=sensor.y_m, heading_rad=sensor.heading_rad)


class GeographicPosition:
    """A latitude, a longitude, and a heading from the local east."""

    driven_m: float | None = None

    def __init__(self, mount: SensorMount, origin: Fix | None) -> None:
        """Without an origin, the first fix becomes the origin: the place of the sensor, not of the rear axle.

        Raises `ConfigError` for an origin out of range.
        """
        self._mount = mount
        self.plane = GeographicPlane(origin) if origin is not None else None
        """Plane of the positions; None before the first fix."""
        self.invalid_because = ""

    def resolve(self, stamp_ns: int, values: PoseInputs) -> Pose | None:  # noqa: ARG002
        """Return the pose of the rear axle's centre in the plane at the origin."""
        latitude_deg, longitude_deg, heading_rad = values.latitude_deg, values.longitude_deg, values.heading_rad
        if latitude_deg is None or longitude_deg is None or heading_rad is None or not math.isfinite(heading_rad):
            self.invalid_because = "position or heading without a value"
            return None
        fix = Fix(latitude_deg, longitude_deg)
        plane = self.plane if self.plane is not None else self._begin(fix)
        point = plane.locate(fix) if plane is not None else None
        if plane is None or point is None:
            self.invalid_because = "fix too far from the origin" if plane is not None else "no fix yet"
            return None
        self.invalid_because = ""
        heading_rad += plane.convergence_rad(fix)
        return self._mount.to_body(Pose(x_m=point.east_m, y_m=point.north_m, heading_rad=heading_rad))

    def reset(self) -> None:
        """Do nothing: the origin stays."""
        self.invalid_because = ""

    def measure(self, body: Pose) -> PoseInputs:
        """Return the sensor's measurement at a pose of the rear axle's centre, headings in [−π, π].

        Raises `ConfigError` before there is an origin, and `InvalidValueError` too far from it.
        """
        if self.plane is None:
            raise ConfigError("no origin yet: the first fix becomes the origin")
        sensor = self._mount.to_sensor(body)
        fix = self.plane.fix_at(PlanePoint(sensor.x_m, sensor.y_m))
        heading_rad = wrapped_rad(sensor.heading_rad - self.plane.convergence_rad(fix))
        return PoseInputs(
            latitude_deg=fix.latitude_deg,
            longitude_deg=fix.longitude_deg,
            heading_rad=heading_rad,
        )

    def _begin(self, fix: Fix) -> GeographicPlane | None:
        """Create the plane of the first fix. Receivers send 0, 0 before they have one."""
        latitude_deg, longitude_deg = fix
        if not math.isfinite(longitude_deg) or latitude_deg == 0.0 == longitude_deg:
            return None
        try:
            self.plane = GeographicPlane(Fix(latitude_deg, math.remainder(longitude_deg, 360.0)))
        except ConfigError:
            return None
        return self.plane
