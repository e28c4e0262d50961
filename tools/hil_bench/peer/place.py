"""Where the vehicle's position sensor says it is: on the plane, or on the ellipsoid."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
FIRST_FIX = (52.0601, 5.1102)
"""Where a vehicle begins whose profile takes its first fix as the origin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """How a pose of the rear axle becomes what the sensor measures."""

    source: str
    frame_id: str
    latitude_deg: float
    longitude_deg: float
    mount_x_m: float
    mount_y_m: float
    mount_rad: float

    def measure(self, x_m: float, y_m: float, heading_rad: float) -> dict[str, float]:
        """Fields of the profile → values."""
        cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
        x_m += cosine * self.mount_x_m - sine * self.mount_y_m
        y_m += sine * self.mount_x_m + cosine * self.mount_y_m
        found = {"heading_rad": math.remainder(heading_rad + self.mount_rad, math.tau), "x_m": x_m, "y_m": y_m}
        if self.source == "geographic":
            found |= self._geographic(x_m, y_m)
        return found

    def _geographic(self, east_m: float, north_m: float) -> dict[str, float]:
        """WGS 84, by the two radii of curvature at the origin: within a few millimetres over a kilometre."""
        square = FLATTENING * (2.0 - FLATTENING)
        sine = math.sin(math.radians(self.latitude_deg))
        across_m = SEMI_MAJOR_M / math.sqrt(1.0 - square * sine * sine)
        along_m = across_m * (1.0 - square) / (1.0 - square * sine * sine)
        cosine = math.cos(math.radians(self.latitude_deg))
        return {
            "latitude_deg": self.latitude_deg + math.degrees(north_m / along_m),
            "longitude_deg": self.longitude_deg + math.degrees(east_m / (across_m * cosine)),
        }


def read_place(profile: Mapping[str, Any]) -> Place:
    """From `[state.pose]`."""
    pose = profile["state"].get("pose", {})
    source, mount, origin = pose.get("source", "local"), pose.get("mount", {}), pose.get("origin")
    latitude_deg, longitude_deg = FIRST_FIX if origin is None or isinstance(origin, str) else origin
    return Place(
        source=source,
        frame_id=profile["state"].get("frame_id", "odom" if source == "odometry" else "map"),
        latitude_deg=float(latitude_deg),
        longitude_deg=float(longitude_deg),
        mount_x_m=mount.get("x_m", 0.0),
        mount_y_m=mount.get("y_m", 0.0),
        mount_rad=mount.get("heading_rad", 0.0),
    )
