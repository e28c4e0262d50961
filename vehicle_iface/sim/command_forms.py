"""The simulated vehicle's side of commands in other forms than acceleration and wheel angle."""

import math
from collections.abc import Callable, Mapping

from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.command_forms import CommandReader, build_former
from vehicle_iface.sim.model import DIRECTION, BicycleState
from vehicle_iface.status import Gear

SPEED_LAG_S = 0.3
"""A commanded speed is approached exponentially with this time constant …"""
SPEED_DRIVE_MPS2, SPEED_BRAKE_MPS2 = 2.5, 4.0
"""… and within these accelerations."""
SPEED_HOLD_MPS2 = 0.3
"""Minimum deceleration at a commanded speed of 0, so that standstill is reached and not only approached."""

Fields = Mapping[str, float | int]
Interpret = Callable[[Fields, BicycleState, Gear], Fields]
"""(newest fields, vehicle state, gear) → the fields with acceleration and front wheel angle."""


def build_interpreter(database: VehicleDatabase) -> Interpret | None:
    """Build the conversion of a profile's commands; None where they are acceleration and wheel angle already."""
    if build_former(database.profile, database.command_ranges) is None:
        return None
    reader, speed = CommandReader(database.profile), database.command_ranges.get("speed_mps")
    has_sign = speed is None or speed.low < 0.0

    def interpret(fields: Fields, state: BicycleState, gear: Gear) -> Fields:
        requested = reader.read(fields, speed_mps=state.speed_mps, direction=DIRECTION[gear])
        accel_mps2, angle_rad = requested
        if accel_mps2 is None:
            goal_mps = fields.get("speed_mps", 0.0) * (1.0 if has_sign else DIRECTION[gear])
            accel_mps2 = track_speed_mps2(goal_mps, state.speed_mps)
        if angle_rad is None:
            angle_rad = state.front_wheel_angle_rad
        return {**fields, "accel_mps2": accel_mps2, "front_wheel_angle_rad": angle_rad}

    return interpret


def track_speed_mps2(goal_mps: float, speed_mps: float) -> float:
    """Return the acceleration in m/s² by which the speed controller approaches its target."""
    wanted_mps2 = (goal_mps - speed_mps) / SPEED_LAG_S
    if goal_mps == 0.0 and speed_mps != 0.0:
        wanted_mps2 = math.copysign(max(abs(wanted_mps2), SPEED_HOLD_MPS2), wanted_mps2)
    most_mps2 = SPEED_DRIVE_MPS2 if wanted_mps2 * speed_mps >= 0.0 else SPEED_BRAKE_MPS2
    return min(most_mps2, max(-most_mps2, wanted_mps2))
