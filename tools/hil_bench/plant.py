"""The car behind the bench's vehicle: a bicycle model with actuator lags.

Kinematic single-track model about the rear axle's centre (Rajamani, Vehicle Dynamics and Control, 2nd ed., 2.2),
signs by ISO 8855: yaw rate r = v · tan δ / L. Wheels and acceleration follow their requests with a first-order lag,
the wheels no faster than their rate. `tests/hil_bench/test_plant.py` checks it against commonroad-vehicle-models.
"""

import math
from dataclasses import dataclass

INNER_STEP_S = 0.001


@dataclass(slots=True, kw_only=True)
class Plant:
    """The car's state. `step` moves it; every attribute may also be set."""

    wheelbase_m: float
    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    """In [−π, π]."""
    speed_mps: float = 0.0
    """Along the body's x axis; negative when reversing."""
    accel_mps2: float = 0.0
    """Of the body along its x axis; 0 at standstill."""
    wheel_rad: float = 0.0
    """Front road wheels, positive to the left."""

    wheel_limit_rad: float = 0.7
    wheel_rate_limit_radps: float = 1.0
    wheel_lag_s: float = 0.08
    accel_lag_s: float = 0.08
    drive_limit_mps2: float = 4.0
    brake_limit_mps2: float = 8.0
    push_mps2: float = 0.0
    """Acceleration by a slope or a tow, along +x of the body, in addition to the pedals."""
    drift_mps: float = 0.0
    """Sideways speed to the left, by wind, ice or a tow."""
    force_mps2: float = 0.0
    """Acceleration by engine and brakes."""

    @property
    def yaw_rate_radps(self) -> float:
        """Positive to the left."""
        return self.speed_mps * math.tan(self.wheel_rad) / self.wheelbase_m

    def step(self, dt_s: float, *, accel_mps2: float, wheel_rad: float, gear: int, only_brake: bool) -> None:
        """Move by `dt_s`, with the requested acceleration (m/s² along +x) and wheel angle.

        `gear`: the engine pushes forward (1), backward (−1) or not (0). Brakes act against the motion and hold at
        standstill; they never move the car.
        """
        left_s = dt_s
        while left_s > 1e-9:
            inner_s = min(INNER_STEP_S, left_s)
            left_s -= inner_s
            self._steer(inner_s, wheel_rad)
            self._accelerate(inner_s, accel_mps2, gear, only_brake)

    def _steer(self, dt_s: float, wheel_rad: float) -> None:
        rate = (wheel_rad - self.wheel_rad) / self.wheel_lag_s
        rate = max(-self.wheel_rate_limit_radps, min(self.wheel_rate_limit_radps, rate))
        wheel = self.wheel_rad + rate * dt_s
        self.wheel_rad = max(-self.wheel_limit_rad, min(self.wheel_limit_rad, wheel))

    def _accelerate(self, dt_s: float, accel_mps2: float, gear: int, only_brake: bool) -> None:
        speed = self.speed_mps
        brakes = accel_mps2 * speed < 0.0 or (speed == 0.0 and accel_mps2 * gear <= 0.0)
        if brakes:
            requested = math.copysign(min(abs(accel_mps2), self.brake_limit_mps2), accel_mps2)
        elif only_brake or accel_mps2 * gear <= 0.0:
            requested = 0.0
        else:
            requested = math.copysign(min(abs(accel_mps2), self.drive_limit_mps2), accel_mps2)
        self.force_mps2 += (requested - self.force_mps2) * min(1.0, dt_s / self.accel_lag_s)
        force = self.force_mps2
        if speed == 0.0 and (only_brake or force * gear <= 0.0):
            force = 0.0  # the brake holds
        after = speed + (force + self.push_mps2) * dt_s
        stops = speed != 0.0 and after * speed <= 0.0
        if stops and not self.push_mps2 and (only_brake or force * speed < 0.0):
            after = 0.0
        self.accel_mps2 = (after - speed) / dt_s if after else 0.0
        self._move(dt_s, (speed + after) / 2.0)
        self.speed_mps = after

    def _move(self, dt_s: float, speed_mps: float) -> None:
        turn = speed_mps * math.tan(self.wheel_rad) / self.wheelbase_m * dt_s
        middle = self.heading_rad + turn / 2.0
        self.x_m += (speed_mps * math.cos(middle) - self.drift_mps * math.sin(middle)) * dt_s
        self.y_m += (speed_mps * math.sin(middle) + self.drift_mps * math.cos(middle)) * dt_s
        self.heading_rad = math.remainder(self.heading_rad + turn, math.tau)
