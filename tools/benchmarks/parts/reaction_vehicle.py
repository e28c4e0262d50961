"""The vehicle in the `reaction` benchmark: it speaks by the bus contract and moves on rails along a figure of eight.

It goes where the course says and not where it is told, so that every contestant sees the same states.
"""

import math
import struct
from dataclasses import dataclass

import numpy as np
from vehicle_bus_contract.reference import AUTONOMOUS, COUNTERS, DRIVE, MAP, READY, Frame, intact, pack

from vehicle_iface import Trajectory
from vehicle_iface.trajectories import make_route

SPEED_MPS = 4.0
ACCEL_MPS2 = 3.0
WHEELBASE_M = 2.7
LAPS = 60
"""35 minutes: no run comes to the end."""
PAIRS_TO_ENGAGE = 3
CAN_FRAME = struct.Struct("=IB3x8s")
"""The kernel's struct can_frame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """Where to drive, at one speed."""

    s_m: list[float]
    """Way along one lap, from its beginning to its end, which is the same place."""
    x_m: list[float]
    y_m: list[float]
    heading_rad: list[float]
    """Without jumps at ±π."""
    curvature_per_m: list[float]
    """Positive to the left."""

    def trajectory(self, laps: int = LAPS) -> Trajectory:
        """So many laps."""
        count = len(self.s_m) - 1
        ways_m = np.concatenate([np.array(self.s_m[:-1]) + lap * self.s_m[-1] for lap in range(laps)])
        return Trajectory(
            stamp_ns=0,
            frame_id="map",
            time_from_start_ns=np.rint(ways_m / SPEED_MPS * 1e9).astype(np.int64),
            x_m=np.tile(self.x_m[:-1], laps),
            y_m=np.tile(self.y_m[:-1], laps),
            heading_rad=np.tile(self.heading_rad[:-1], laps),
            speed_mps=np.full(count * laps, SPEED_MPS),
        )


def figure_of_eight() -> Course:
    """One lap of the route of that name."""
    route = make_route("figure8")
    closing_m = float(np.hypot(route.x_m[-1] - route.x_m[0], route.y_m[-1] - route.y_m[0]))
    heading_rad = np.unwrap(route.heading_rad)
    curvature_per_m = np.gradient(heading_rad, route.s_m)
    columns = {"s_m": route.s_m, "x_m": route.x_m, "y_m": route.y_m, "heading_rad": heading_rad}
    columns["curvature_per_m"] = curvature_per_m
    lists = {name: values.tolist() for name, values in columns.items()}
    if closing_m > 1e-6:
        lists["s_m"].append(lists["s_m"][-1] + closing_m)
        for name in ("x_m", "y_m", "curvature_per_m"):
            lists[name].append(lists[name][0])
        turns = round((lists["heading_rad"][-1] - lists["heading_rad"][0]) / math.tau)
        lists["heading_rad"].append(lists["heading_rad"][0] + turns * math.tau)
    return Course(**lists)


class RailVehicle:
    """Stands READY until it has been sent three enabled pairs, then drives off AUTONOMOUS. Time is given."""

    def __init__(self, course: Course) -> None:
        self._course = course
        self._counters = {"POSE": 0, "VEHICLE_STATUS": 0}
        self.left_s = math.nan
        """When it drove off; not a number while it stands."""
        self._enabled = 0

    @property
    def is_autonomous(self) -> bool:
        """Whether it drives."""
        return not math.isnan(self.left_s)

    def receive(self, frame: Frame, now_s: float) -> None:
        """A command; only whether it enables counts here."""
        told = intact(frame)
        if told is None or told.name != "DRIVE_COMMAND" or self.is_autonomous:
            return
        self._enabled = self._enabled + 1 if told["ENABLE"] else 0
        if self._enabled >= PAIRS_TO_ENGAGE:
            self.left_s = now_s

    def sample(self, now_s: float) -> list[bytes]:
        """POSE, MOTION and CHASSIS of one sample, as struct can_frame."""
        course = self._course
        elapsed_s = now_s - self.left_s if self.is_autonomous else 0.0
        way_m, speed_mps = driven(elapsed_s)
        way_m %= course.s_m[-1]
        columns = (course.x_m, course.y_m, course.heading_rad, course.curvature_per_m)
        x_m, y_m, heading_rad, curvature_per_m = (float(np.interp(way_m, course.s_m, column)) for column in columns)
        yaw_radps, wheel_rad = speed_mps * curvature_per_m, math.atan(WHEELBASE_M * curvature_per_m)
        accel_mps2 = ACCEL_MPS2 if 0.0 < speed_mps < SPEED_MPS else 0.0
        heading_rad = math.remainder(heading_rad, math.tau)
        self._counters["POSE"] = counter = (self._counters["POSE"] + 1) % COUNTERS
        return [
            can_frame(*pack("POSE", counter, POSE_FRAME=MAP, POSE_VALID=1, POS_X=x_m, POS_Y=y_m)),
            can_frame(*pack("MOTION", counter, HEADING=heading_rad, SPEED=speed_mps, YAW_RATE=yaw_radps)),
            can_frame(*pack("CHASSIS", counter, ACCEL=accel_mps2, LATERAL_SPEED=0.0, FRONT_WHEEL_ANGLE=wheel_rad)),
        ]

    def status(self) -> bytes:
        """VEHICLE_STATUS."""
        self._counters["VEHICLE_STATUS"] = counter = (self._counters["VEHICLE_STATUS"] + 1) % COUNTERS
        return can_frame(*pack("VEHICLE_STATUS", counter, GEAR=DRIVE, MODE=AUTONOMOUS if self.is_autonomous else READY))


def driven(elapsed_s: float) -> tuple[float, float]:
    """Way in m and speed in m/s of a vehicle that drove off so long ago, as a vehicle can."""
    speed_mps = min(SPEED_MPS, ACCEL_MPS2 * elapsed_s)
    ramp_s = min(elapsed_s, SPEED_MPS / ACCEL_MPS2)
    return 0.5 * ACCEL_MPS2 * ramp_s**2 + (elapsed_s - ramp_s) * SPEED_MPS, speed_mps


def can_frame(can_id: int, data: bytes) -> bytes:
    """As the kernel has it."""
    return CAN_FRAME.pack(can_id, len(data), data)
