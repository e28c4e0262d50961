"""Routes: a path to drive, with the highest speed at each point."""

import math

import msgspec
import numpy as np

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.trajectories import speed
from vehicle_iface.trajectory import FloatArray, Trajectory
from vehicle_iface.units import NS_PER_S
from vehicle_iface.value import Value


class RouteConfig(Value, frozen=True, kw_only=True):
    """Parameters of a route: limits, vehicle, and sizes of the shapes.

    Raises `InvalidValueError` when a number is not finite and above zero (dwell: at least zero).
    """

    speed_mps: float = 5.0
    """Maximum speed."""
    lateral_accel_mps2: float = 1.5
    """Maximum of v²·|κ|."""
    accel_mps2: float = 1.0
    decel_mps2: float = 1.5
    point_spacing_m: float = 0.25
    """Approximate; a whole number of equal spacings fits between two stops."""
    wheelbase_m: float = 2.7
    vehicle_width_m: float = 1.9
    """Lane widths and cone positions follow from it."""
    length_m: float = 80.0
    """Length of the straight routes."""
    radius_m: float = 15.0
    """Radius of the circle."""
    half_width_m: float = 27.0
    """Figure of eight: from the crossing to the far end of a loop; its smallest radius is a third of this."""
    turn_radius_m: float = 8.0
    """Smallest radius of the U-turn."""
    three_point_radius_m: float = 5.0
    """Smallest radius of the three-point turn."""
    manoeuvring_speed_mps: float = 1.5
    """Maximum speed of the three-point turn."""
    cone_spacing_m: float = 18.0
    cone_count: int = 6
    stop_spacing_m: float = 25.0
    dwell_s: float = 2.0
    """Time at standstill at each stop and change of direction."""

    def __post_init__(self) -> None:
        for field in msgspec.structs.fields(self):
            check = checks.non_negative if field.name == "dwell_s" else checks.positive
            if field.name == "cone_count":
                check = _count
            msgspec.structs.force_setattr(self, field.name, check(field.name, getattr(self, field.name)))


def _count(name: str, value: object) -> int:
    number = checks.integer(name, value)
    if number < 1:
        raise InvalidValueError(f"{name} = {number}: must be at least 1")
    return number


class Route(Value, frozen=True, kw_only=True, eq=False):
    """n ≥ 2 points along a path, in the order of driving; arrays are copied and locked.

    Where the speed is 0 the vehicle stops: at interior stops, at changes of direction, at the end of an open
    route. An open route also begins at 0. A closed route ends at the point where it begins, and never stops.

    Raises `InvalidValueError` when an array is not (n,) and finite, `s_m` does not rise, or stops do not fit.
    """

    name: str
    config: RouteConfig
    closed: bool = False
    s_m: FloatArray
    """(n,) distance driven from the first point, also when reversing; from 0, rising."""
    x_m: FloatArray
    """(n,)"""
    y_m: FloatArray
    """(n,)"""
    heading_rad: FloatArray
    """(n,) heading of the body's x axis, continuous: not wrapped."""
    curvature_per_m: FloatArray
    """(n,) tan(front wheel angle) / wheelbase, positive to the left; yaw rate = curvature × signed speed."""
    speed_mps: FloatArray
    """(n,) the highest speed within the limits; negative where the vehicle reverses."""
    dwell_s: FloatArray
    """(n,) time to stand at the point, 0 where the vehicle does not stop."""

    def __post_init__(self) -> None:
        for name in ("s_m", "x_m", "y_m", "heading_rad", "curvature_per_m", "speed_mps", "dwell_s"):
            msgspec.structs.force_setattr(self, name, _lock(name, getattr(self, name), np.shape(self.s_m)))
        if self.s_m[0] != 0.0 or np.any(np.diff(self.s_m) <= 0.0):
            raise InvalidValueError(f"s_m of route {self.name!r}: must rise from 0")
        if self.closed and np.any(self.speed_mps == 0.0):
            raise InvalidValueError(f"speed_mps of closed route {self.name!r}: must not be 0 anywhere")
        if not self.closed and (self.speed_mps[0] != 0.0 or self.speed_mps[-1] != 0.0):
            raise InvalidValueError(f"speed_mps of open route {self.name!r}: must be 0 at both ends")

    def __len__(self) -> int:
        return len(self.s_m)

    @property
    def length_m(self) -> float:
        """Length from the first point to the last in m; one lap of a closed route."""
        return float(self.s_m[-1])

    @property
    def start(self) -> tuple[float, float, float]:
        """Return x, y (m) and heading (rad) of the first point: the start pose of a vehicle that drives the route."""
        return float(self.x_m[0]), float(self.y_m[0]), math.remainder(float(self.heading_rad[0]), math.tau)

    @property
    def front_wheel_angle_rad(self) -> FloatArray:
        """Return (n,) wheel angles of a vehicle without slip and with the config's wheelbase, positive to the left."""
        return np.arctan(self.config.wheelbase_m * self.curvature_per_m)

    def legs(self) -> list[tuple[int, int, float]]:
        """Return first and last index and direction (±1.0) of each stretch from one standstill to the next."""
        if self.closed:
            return [(0, len(self) - 1, math.copysign(1.0, float(self.speed_mps[0])))]
        stops = np.flatnonzero(self.speed_mps == 0.0).tolist()
        directions = [math.copysign(1.0, float(self.speed_mps[i + 1])) for i in stops[:-1]]
        return list(zip(stops[:-1], stops[1:], directions, strict=True))

    def to_trajectory(self, stamp_ns: int = 0, frame_id: str = "map") -> Trajectory:
        """Return the trajectory of the whole route, or one lap, driven once from standstill to standstill.

        Times follow from the speeds at constant acceleration between points, to the nanosecond. At a stop
        with dwell there are two points at one place: arriving and leaving.
        """
        direction = np.concatenate([np.full(last - first, d) for first, last, d in self.legs()])
        driven_mps = self._limit_to_standstill_mps()
        accel_mps2 = speed.accelerations_mps2(self.s_m, driven_mps)
        accel_mps2 *= np.append(direction, direction[-1])
        signed_mps = np.copysign(driven_mps, self.speed_mps) * (driven_mps > 0.0)
        dwells = np.flatnonzero(self.dwell_s[:-1] > 0.0)
        steps_s = np.insert(speed.durations_s(self.s_m, driven_mps), dwells, self.dwell_s[dwells])
        times_s = np.concatenate([[0.0], np.cumsum(steps_s)])
        columns = {
            "x_m": self.x_m,
            "y_m": self.y_m,
            "heading_rad": self.heading_rad,
            "speed_mps": signed_mps,
            "accel_mps2": accel_mps2,
            "yaw_rate_radps": self.curvature_per_m * signed_mps,
            "front_wheel_angle_rad": self.front_wheel_angle_rad,
        }
        doubled = {name: np.insert(values, dwells, values[dwells]) for name, values in columns.items()}
        # While it stands at a stop the vehicle does not accelerate; at its end it has nowhere to go.
        doubled["accel_mps2"][dwells + np.arange(len(dwells))] = 0.0
        doubled["accel_mps2"][-1] = 0.0
        times_ns = np.rint(times_s * NS_PER_S).astype(np.int64)
        return Trajectory(stamp_ns=stamp_ns, frame_id=frame_id, time_from_start_ns=times_ns, **doubled)

    def _limit_to_standstill_mps(self) -> FloatArray:
        """Return (n,) unsigned speeds, with both ends of a lap slowed down to standstill."""
        limit_mps = np.abs(self.speed_mps)
        limit_mps[[0, -1]] = 0.0
        config = self.config
        return speed.reachable_mps(self.s_m, limit_mps, accel_mps2=config.accel_mps2, decel_mps2=config.decel_mps2)


def _lock(name: str, given: object, shape: tuple[int, ...]) -> FloatArray:
    """Return a locked float64 copy, checked to have the shape of all arrays of the route."""
    values = np.array(given, dtype=np.float64)
    if values.ndim != 1 or values.shape != shape or len(values) < 2 or not np.isfinite(values).all():
        raise InvalidValueError(f"{name} of shape {values.shape}: must be (n,) and finite, n ≥ 2, all alike")
    values.setflags(write=False)
    return values
