"""Latitude and longitude on WGS 84 to the plane that touches the ellipsoid at an origin, and back.

A place is converted to geocentric coordinates and these to east and north at the origin: EPSG Guidance Note 7-2,
methods 9602 (geographic/geocentric) and 9837 (geocentric/topocentric), with the heights taken as 0. The plane is exact
by its definition. A distance in it is shorter than that on the ground by d³ / 6R², 4 mm in 10 km and 4 m in 100 km.
"""

import math
from typing import NamedTuple

from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.profile.state_pose import origin_faults

SEMI_MAJOR_AXIS_M = 6_378_137.0
FLATTENING = 1.0 / 298.257_223_563
"""WGS 84: NGA.STND.0036, table 3.1."""
MAX_DISTANCE_M = 100_000.0
"""Maximum distance from the origin. A farther place is a fault, such as the 0, 0 of a receiver without a fix."""
_E2 = FLATTENING * (2.0 - FLATTENING)
_FROM_Z2 = 1.0 / (1.0 - _E2)


class Fix(NamedTuple):
    """A place on the ellipsoid, in degrees."""

    latitude_deg: float
    longitude_deg: float


class PlanePoint(NamedTuple):
    """A place in the plane, from its origin."""

    east_m: float
    north_m: float


class GeographicPlane:
    """The plane at one origin."""

    def __init__(self, origin: Fix) -> None:
        """Raises `ConfigError` for an origin that is not on the earth, or within a degree of a pole."""
        for text in origin_faults(*origin):
            raise ConfigError(f"origin {text}")
        self.origin = origin
        self._latitude_rad = math.radians(origin.latitude_deg)
        self._sin, self._cos = math.sin(self._latitude_rad), math.cos(self._latitude_rad)
        normal_m = SEMI_MAJOR_AXIS_M / math.sqrt(1.0 - _E2 * self._sin * self._sin)
        self._outward_m = normal_m * self._cos
        """Origin in geocentric axes that are turned to its meridian."""
        self._up_m = normal_m * (1.0 - _E2) * self._sin

    def locate(self, fix: Fix) -> PlanePoint | None:
        """Convert to the plane; None when the place is not finite or beyond `MAX_DISTANCE_M` from the origin."""
        latitude_rad = math.radians(fix.latitude_deg)
        if not (abs(fix.latitude_deg) <= 90.0 and math.isfinite(fix.longitude_deg)):
            return None
        turn_rad = self._turn_rad(fix.longitude_deg)
        sin, cos = math.sin(latitude_rad), math.cos(latitude_rad)
        normal_m = SEMI_MAJOR_AXIS_M / math.sqrt(1.0 - _E2 * sin * sin)
        outward_m = normal_m * cos * math.cos(turn_rad) - self._outward_m
        east_m = normal_m * cos * math.sin(turn_rad)
        up_m = normal_m * (1.0 - _E2) * sin - self._up_m
        if math.hypot(outward_m, east_m, up_m) > MAX_DISTANCE_M:
            return None
        return PlanePoint(east_m, self._cos * up_m - self._sin * outward_m)

    def fix_at(self, point: PlanePoint) -> Fix:
        """Convert a place in the plane to the ellipsoid: the reverse of `locate`, longitude in ±180.

        Raises `InvalidValueError` further than `MAX_DISTANCE_M` from the origin.
        """
        east_m, north_m = point
        if not math.hypot(east_m, north_m) <= MAX_DISTANCE_M:
            text = f"must be at most {MAX_DISTANCE_M:.0f} m from the origin"
            raise InvalidValueError(f"place {east_m} m east, {north_m} m north: {text}")
        # Where the plane's normal through the point meets the ellipsoid r² + z² / (1 − e²) = a²: a root of
        # square · h² + 2 · half · h + rest = 0 for the height h, the one next to the plane.
        outward_m, up_m = self._outward_m - self._sin * north_m, self._up_m + self._cos * north_m
        square = self._cos * self._cos + _FROM_Z2 * self._sin * self._sin
        half_m = outward_m * self._cos + _FROM_Z2 * up_m * self._sin
        rest_m2 = outward_m * outward_m + east_m * east_m + _FROM_Z2 * up_m * up_m - SEMI_MAJOR_AXIS_M**2
        height_m = -rest_m2 / (half_m + math.sqrt(half_m * half_m - square * rest_m2))
        outward_m, up_m = outward_m + self._cos * height_m, up_m + self._sin * height_m
        latitude_rad = math.atan2(_FROM_Z2 * up_m, math.hypot(outward_m, east_m))
        longitude_deg = self.origin.longitude_deg + math.degrees(math.atan2(east_m, outward_m))
        return Fix(math.degrees(latitude_rad), math.remainder(longitude_deg, 360.0))

    def convergence_rad(self, fix: Fix) -> float:
        """Return the angle from the plane's east to the local east, counter-clockwise: 2 mrad in 10 km at 52° N.

        A receiver's heading is from the local east, so this is added to it. The angle between the meridians along the
        great circle to the origin, by Napier's analogies.
        """
        turn_rad, latitude_rad = self._turn_rad(fix.longitude_deg), math.radians(fix.latitude_deg)
        mean_rad, half_rad = 0.5 * (latitude_rad + self._latitude_rad), 0.5 * (latitude_rad - self._latitude_rad)
        return 2.0 * math.atan(math.tan(0.5 * turn_rad) * math.sin(mean_rad) / math.cos(half_rad))

    def _turn_rad(self, longitude_deg: float) -> float:
        """Return the angle from the origin's meridian to that of a place, the shorter way round."""
        return math.radians(math.remainder(longitude_deg - self.origin.longitude_deg, 360.0))
