"""Single-track vehicle model with first-order actuators.

Kinematic bicycle about the rear axle's centre (Rajamani, Vehicle Dynamics and Control, 2nd ed., section 2.2;
both axles steered): neither wheel slips, so each axle's centre moves where its wheel points. With v the speed
along the body's x axis, L the wheelbase, δf and δr the road-wheel angles, positive to the left:

    lateral speed at the rear axle   v_y = v · tan δr
    yaw rate                         r   = v · (tan δf − tan δr) / L

Both hold backwards as well. Each inner step is an arc: the exact motion for a constant (v, v_y, r).
"""

import math

from msgspec.structs import fields, force_setattr

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.status import Gear
from vehicle_iface.units import wrapped_rad
from vehicle_iface.value import Value

INNER_STEP_S = 0.001
"""No inner step is longer than this."""

DIRECTION = {Gear.DRIVE: 1.0, Gear.REVERSE: -1.0, Gear.NEUTRAL: 0.0, Gear.PARK: 0.0}
"""Direction of the drive force in each gear."""


class BicycleParameters(Value, frozen=True, kw_only=True):
    """Parameters of the vehicle. Raises `InvalidValueError` for an impossible value."""

    wheelbase_m: float = 2.7
    front_wheel_angle_limit_rad: float = 0.7
    """Below π/2."""
    rear_wheel_angle_limit_rad: float = 0.2
    """Below π/2; 0 for a car whose rear wheels do not steer."""
    wheel_rate_limit_radps: float = 1.0
    wheel_lag_s: float = 0.1
    """Time constant of the first-order lag between request and wheel."""
    accel_lag_s: float = 0.1
    """Time constant of the first-order lag between request and acceleration, engine and brakes alike."""
    drive_limit_mps2: float = 4.0
    brake_limit_mps2: float = 8.0
    speed_limit_mps: float = 40.0
    """Maximum speed that the engine reaches, in either direction."""
    rolling_resistance_mps2: float = 0.1
    """Deceleration of a coasting vehicle (about 1 % of g: a passenger car's tyres on asphalt)."""
    park_deceleration_mps2: float = 4.0
    """Deceleration by the pawl, when PARK is selected before standstill."""
    hold_speed_mps: float = 0.05
    """A held vehicle slower than this is braked to standstill, whatever the request."""
    hold_deceleration_mps2: float = 1.0
    """Minimum deceleration below the hold speed."""

    def __post_init__(self) -> None:
        for field in fields(self):
            check = checks.non_negative if field.name in _MAY_BE_ZERO else checks.positive
            force_setattr(self, field.name, check(field.name, getattr(self, field.name)))
        for name in ("front_wheel_angle_limit_rad", "rear_wheel_angle_limit_rad"):
            if getattr(self, name) >= math.pi / 2:
                raise InvalidValueError(f"{name} = {getattr(self, name)}: must be below π/2")


_MAY_BE_ZERO = frozenset({"rear_wheel_angle_limit_rad", "rolling_resistance_mps2"})


class BicycleState(Value, frozen=True, kw_only=True):
    """State of the vehicle; ISO 8855 signs, reference point at the rear axle's centre."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    """In [−π, π]."""
    speed_mps: float = 0.0
    """Along the body's x axis; negative when reversing."""
    accel_mps2: float = 0.0
    """Along the body's x axis, also when reversing; exactly 0 at standstill."""
    front_wheel_angle_rad: float = 0.0
    rear_wheel_angle_rad: float = 0.0
    yaw_rate_radps: float = 0.0
    """Positive to the left."""
    lateral_speed_mps: float = 0.0
    """At the rear axle's centre, along the body's y axis."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            force_setattr(self, name, checks.finite(name, getattr(self, name)))


class Actuation(Value, frozen=True, kw_only=True):
    """Requests to engine, brakes and steering."""

    gear: Gear = Gear.PARK
    accel_mps2: float | None = None
    """Along the body's x axis, also when reversing; None: no pedal is pressed, the vehicle coasts.

    Against the motion it brakes, along the gear it drives, and otherwise it does nothing.
    """
    front_wheel_angle_rad: float = 0.0
    rear_wheel_angle_rad: float = 0.0
    hold: bool = False
    """Brake only, and stay at standstill once there."""

    def __post_init__(self) -> None:
        if self.gear not in DIRECTION:
            raise InvalidValueError(f"gear = {self.gear!r}: must be PARK, REVERSE, NEUTRAL or DRIVE")
        if self.accel_mps2 is not None:
            checks.finite("accel_mps2", self.accel_mps2)
        checks.finite("front_wheel_angle_rad", self.front_wheel_angle_rad)
        checks.finite("rear_wheel_angle_rad", self.rear_wheel_angle_rad)


class Bicycle:
    """The vehicle: call `step` with the requests to its actuators, then read `state`."""

    def __init__(self, parameters: BicycleParameters | None = None, state: BicycleState | None = None) -> None:
        self.parameters = parameters if parameters is not None else BicycleParameters()
        self.state = state if state is not None else BicycleState()
        self._actuator_mps2 = self.state.accel_mps2

    def step(self, dt_s: float, actuation: Actuation) -> BicycleState:
        """Advance by `dt_s` in equal inner steps of at most a millisecond; return the new state."""
        s = self.state
        x_m, y_m, heading_rad = s.x_m, s.y_m, s.heading_rad
        speed_mps, front_rad, rear_rad = s.speed_mps, s.front_wheel_angle_rad, s.rear_wheel_angle_rad
        accel_mps2 = s.accel_mps2
        p = self.parameters
        front_goal_rad = _clamp(actuation.front_wheel_angle_rad, p.front_wheel_angle_limit_rad)
        rear_goal_rad = _clamp(actuation.rear_wheel_angle_rad, p.rear_wheel_angle_limit_rad)
        count, h_s = _divide_step(dt_s)
        wheel_share, accel_share = 1.0 - math.exp(-h_s / p.wheel_lag_s), 1.0 - math.exp(-h_s / p.accel_lag_s)
        largest_rad = p.wheel_rate_limit_radps * h_s
        for _ in range(count):
            new_front_rad = front_rad + _clamp((front_goal_rad - front_rad) * wheel_share, largest_rad)
            new_rear_rad = rear_rad + _clamp((rear_goal_rad - rear_rad) * wheel_share, largest_rad)
            new_speed_mps = self._integrate_speed(speed_mps, actuation, h_s, accel_share)
            accel_mps2 = (new_speed_mps - speed_mps) / h_s if new_speed_mps != 0.0 else 0.0
            lateral_mps, yaw_radps = self._compute_turning(
                (speed_mps + new_speed_mps) / 2,
                (front_rad + new_front_rad) / 2,
                (rear_rad + new_rear_rad) / 2,
            )
            forward_m, left_m = _integrate_arc((speed_mps + new_speed_mps) / 2, lateral_mps, yaw_radps, h_s)
            cos, sin = math.cos(heading_rad), math.sin(heading_rad)
            x_m += forward_m * cos - left_m * sin
            y_m += forward_m * sin + left_m * cos
            heading_rad += yaw_radps * h_s
            speed_mps, front_rad, rear_rad = new_speed_mps, new_front_rad, new_rear_rad
        lateral_mps, yaw_radps = self._compute_turning(speed_mps, front_rad, rear_rad)
        self.state = BicycleState(
            x_m=x_m,
            y_m=y_m,
            heading_rad=wrapped_rad(heading_rad),
            speed_mps=speed_mps,
            accel_mps2=accel_mps2,
            front_wheel_angle_rad=front_rad,
            rear_wheel_angle_rad=rear_rad,
            yaw_rate_radps=yaw_radps,
            lateral_speed_mps=lateral_mps,
        )
        return self.state

    def _compute_turning(self, speed_mps: float, front_rad: float, rear_rad: float) -> tuple[float, float]:
        """Return lateral speed and yaw rate without wheel slip."""
        tan_rear = math.tan(rear_rad)
        return speed_mps * tan_rear, speed_mps * (math.tan(front_rad) - tan_rear) / self.parameters.wheelbase_m

    def _integrate_speed(self, speed_mps: float, actuation: Actuation, h_s: float, share: float) -> float:
        """Return the speed after `h_s`, in which the actuator closes `share` of its gap; resistance ends at 0 m/s."""
        goal_mps2 = self._target_mps2(speed_mps, actuation)
        actuator_mps2 = self._actuator_mps2
        actuator_mps2 += (goal_mps2 - actuator_mps2) * share
        direction = DIRECTION[actuation.gear]
        brakes = _are_opposite(actuator_mps2, speed_mps)
        drives = actuator_mps2 * direction > 0.0 and not actuation.hold
        self._actuator_mps2 = actuator_mps2 if brakes or drives else 0.0
        resistance_mps2 = self._resistance_mps2(actuation)
        new_mps = speed_mps + self._actuator_mps2 * h_s
        if speed_mps != 0.0:
            new_mps -= math.copysign(resistance_mps2, speed_mps) * h_s
        if not _are_opposite(speed_mps, new_mps):
            return new_mps
        self._actuator_mps2 = 0.0
        return 0.0

    def _target_mps2(self, speed_mps: float, actuation: Actuation) -> float:
        """Return the target acceleration: a brake acts against the motion, an engine along the gear."""
        p = self.parameters
        wish_mps2 = actuation.accel_mps2 if actuation.accel_mps2 is not None else 0.0
        if actuation.hold and abs(speed_mps) < p.hold_speed_mps:
            return -math.copysign(max(abs(wish_mps2), p.hold_deceleration_mps2), speed_mps)
        if _are_opposite(wish_mps2, speed_mps):
            return _clamp(wish_mps2, p.brake_limit_mps2)
        too_fast = abs(speed_mps) >= p.speed_limit_mps
        if wish_mps2 * DIRECTION[actuation.gear] > 0.0 and not actuation.hold and not too_fast:
            return _clamp(wish_mps2, p.drive_limit_mps2)
        return 0.0

    def _resistance_mps2(self, actuation: Actuation) -> float:
        """Return the deceleration without brakes; a driving power train compensates it."""
        if actuation.gear is Gear.PARK:
            return self.parameters.park_deceleration_mps2
        if actuation.accel_mps2 is None or actuation.gear is Gear.NEUTRAL:
            return self.parameters.rolling_resistance_mps2
        return 0.0


def _divide_step(dt_s: float) -> tuple[int, float]:
    """Return number and length of the equal steps of at most `INNER_STEP_S` that make up `dt_s`."""
    count = math.ceil(checks.non_negative("dt_s", dt_s) / INNER_STEP_S - 1e-9)
    return count, dt_s / count if count else 0.0


def _integrate_arc(forward_mps: float, left_mps: float, yaw_radps: float, h_s: float) -> tuple[float, float]:
    """Return the displacement at constant velocities, in the body's axes at the start (SE(2) exponential)."""
    turn_rad = yaw_radps * h_s
    if abs(turn_rad) < 1e-6:
        along, across = 1.0, turn_rad / 2  # next terms are below 1e-12
    else:
        along, across = math.sin(turn_rad) / turn_rad, (1.0 - math.cos(turn_rad)) / turn_rad
    return (
        (forward_mps * along - left_mps * across) * h_s,
        (forward_mps * across + left_mps * along) * h_s,
    )


def _clamp(value: float, limit: float) -> float:
    """Clamp a finite `value` to ±`limit`."""
    return -limit if value < -limit else limit if value > limit else value


def _are_opposite(a: float, b: float) -> bool:
    """Return whether one is above 0 and the other below; their product may underflow."""
    return a < 0.0 < b or b < 0.0 < a
