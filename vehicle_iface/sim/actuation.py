"""Requests to engine, brakes and steering of the simulated vehicle: from commands, driver, or its own stop."""

import math
from collections.abc import Mapping
from dataclasses import replace

from vehicle_iface.sim.model import DIRECTION, Actuation
from vehicle_iface.sim.parameters import Driver, SimulationParameters
from vehicle_iface.status import Gear, VehicleMode


def choose_actuation(
    mode: VehicleMode,
    requested: Mapping[str, float | int],
    driver: Driver,
    *,
    gear: Gear,
    speed_mps: float,
    parameters: SimulationParameters,
) -> Actuation:
    """Choose the actuation by mode; `requested` has the fields of the newest commands."""
    driver_mps2 = parameters.driver_deceleration_mps2 if driver.brake else 0.0
    if mode is VehicleMode.AUTONOMOUS:
        return _follow_commands(requested, gear)
    if mode is VehicleMode.FAULT:
        return _brake(max(parameters.fault_deceleration_mps2, driver_mps2), speed_mps, gear)
    if mode is VehicleMode.EMERGENCY_STOP:
        return _brake(max(parameters.emergency_deceleration_mps2, driver_mps2), speed_mps, gear)
    front_rad = driver.steer_torque_nm * parameters.driver_steering_rad_per_nm
    if driver.brake:
        return replace(_brake(driver_mps2, speed_mps, gear), front_wheel_angle_rad=front_rad)
    accel_mps2 = parameters.driver_acceleration_mps2 * DIRECTION[gear] if driver.throttle else None
    return Actuation(gear=gear, accel_mps2=accel_mps2, front_wheel_angle_rad=front_rad)


def find_needed_gear(requested: Mapping[str, float | int]) -> Gear:
    """Return the gear for the requested direction; NO_REQUEST where the commands request none."""
    direction = requested.get("speed_mps", 0.0)
    if direction == 0.0 and not requested.get("safe_stop", False):
        direction = requested.get("accel_mps2", 0.0)
    if direction == 0.0:
        return Gear.NO_REQUEST
    return Gear.DRIVE if direction > 0.0 else Gear.REVERSE


def _follow_commands(requested: Mapping[str, float | int], gear: Gear) -> Actuation:
    return Actuation(
        gear=gear,
        accel_mps2=requested.get("accel_mps2", 0.0),
        front_wheel_angle_rad=requested.get("front_wheel_angle_rad", 0.0),
        rear_wheel_angle_rad=requested.get("rear_wheel_angle_rad", 0.0),
        hold=bool(requested.get("safe_stop", False)),
    )


def _brake(deceleration_mps2: float, speed_mps: float, gear: Gear) -> Actuation:
    """Brake against the motion with straight wheels."""
    return Actuation(gear=gear, accel_mps2=-math.copysign(deceleration_mps2, speed_mps), hold=True)
