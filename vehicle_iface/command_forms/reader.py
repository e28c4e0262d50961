"""The reverse of forming a command: the acceleration and the road wheel angle that a vehicle's command requests."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from vehicle_iface.command_forms.pedals import Table
from vehicle_iface.interpolation import interpolate
from vehicle_iface.profile import Profile
from vehicle_iface.standstill import STANDING_MPS

Fields = Mapping[str, float | int]


class RequestedMotion(NamedTuple):
    """The motion that a command requests; None where the command does not determine it."""

    accel_mps2: float | None
    """Along the body's x axis. None where a speed is commanded."""
    front_wheel_angle_rad: float | None
    """None where a yaw rate is commanded at standstill."""


class CommandReader:
    """Reads the commands of one profile."""

    def __init__(self, profile: Profile) -> None:
        command = profile.command
        pedals = command.pedals
        self._longitudinal, self._lateral = command.longitudinal, command.lateral
        self._throttle, self._brake = (_inverse(pedals.throttle), _inverse(pedals.brake)) if pedals else ((), ())
        self._wheelbase_m = profile.geometry.wheelbase_m

    def read(self, fields: Fields, *, speed_mps: float, direction: float) -> RequestedMotion:
        """`direction` is where drive points: 1 forwards, -1 backwards, 0 nowhere. The brake is against the speed."""
        return RequestedMotion(self._accel_mps2(fields, speed_mps, direction), self._angle_rad(fields, speed_mps))

    def _accel_mps2(self, fields: Fields, speed_mps: float, direction: float) -> float | None:
        if self._longitudinal == "acceleration":
            return fields.get("accel_mps2")
        if self._longitudinal == "speed":
            return None
        if self._longitudinal == "drive_and_brake":
            drive_mps2, brake_mps2 = fields.get("drive_mps2", 0.0), fields.get("brake_mps2", 0.0)
        else:
            drive_mps2 = interpolate(self._throttle, fields.get("throttle", 0.0))
            brake_mps2 = interpolate(self._brake, fields.get("brake", 0.0))
        travel = direction if abs(speed_mps) < STANDING_MPS else math.copysign(1.0, speed_mps)
        return direction * drive_mps2 - travel * brake_mps2

    def _angle_rad(self, fields: Fields, speed_mps: float) -> float | None:
        if self._lateral == "wheel_angle":
            return fields.get("front_wheel_angle_rad")
        if self._lateral == "curvature":
            curvature_per_m = fields.get("curvature_per_m")
        elif abs(speed_mps) < STANDING_MPS:
            return None
        else:
            yaw_rate_radps = fields.get("yaw_rate_radps")
            curvature_per_m = yaw_rate_radps / speed_mps if yaw_rate_radps is not None else None
        return math.atan(curvature_per_m * self._wheelbase_m) if curvature_per_m is not None else None


def _inverse(table: Table) -> Table:
    return tuple((command, accel_mps2) for accel_mps2, command in table)
