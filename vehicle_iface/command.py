"""Commands: what a controller requests, and what the gate permits."""

from math import isfinite
from typing import NamedTuple

import msgspec

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.reason import Reason
from vehicle_iface.status import Gear
from vehicle_iface.value import Value

_NUMBERS = ("accel_mps2", "front_wheel_angle_rad", "rear_wheel_angle_rad", "speed_mps")
_ALL_FLOAT = [float] * len(_NUMBERS)
_NOMINAL = Reason.NOMINAL  # enumerations are slow to read


class Command(Value, frozen=True, kw_only=True, gc=False):
    """What a controller requests: acceleration, wheel angles and speed. Only `safety.gate` may permit it on the bus.

    Raises `InvalidValueError` when a number is not finite.
    """

    stamp_ns: int
    """Stamp of the state that this was computed from, nanoseconds of the monotonic clock."""
    accel_mps2: float
    """Along the body's x axis, also when reversing: positive drives forwards, or brakes while reversing."""
    front_wheel_angle_rad: float
    """Road-wheel angle, positive to the left."""
    rear_wheel_angle_rad: float = 0.0
    """Road-wheel angle, positive to the left."""
    speed_mps: float = 0.0
    """Speed of the reference point, negative backwards; its sign is the requested direction of travel."""
    reason: Reason = Reason.NOMINAL
    """`NOMINAL`, or the cause of a stop."""

    def __post_init__(self) -> None:
        numbers = (self.accel_mps2, self.front_wheel_angle_rad, self.rear_wheel_angle_rad, self.speed_mps)
        if list(map(type, numbers)) != _ALL_FLOAT or not isfinite(sum(numbers)):  # a finite sum has finite terms
            for name, value in zip(_NUMBERS, numbers, strict=True):
                msgspec.structs.force_setattr(self, name, checks.finite(name, value))
        if type(self.stamp_ns) is not int:
            msgspec.structs.force_setattr(self, "stamp_ns", checks.integer("stamp_ns", self.stamp_ns))
        if not isinstance(self.reason, Reason):
            raise InvalidValueError(f"reason = {self.reason!r}: must be a Reason")

    @property
    def is_stop(self) -> bool:
        """Whether this command stops the vehicle."""
        return self.reason is not _NOMINAL


class SafeCommand(Value, frozen=True, kw_only=True, gc=False):
    """A permitted command, the only one that can be encoded. Only `safety.gate` builds it (`test_architecture` checks).

    The numbers are finite, within the limits, and already multiples of what the wire can express.
    """

    stamp_ns: int
    """Stamp of the state that this was computed from."""
    enable: bool
    """False releases the vehicle."""
    safe_stop: bool
    accel_mps2: float
    front_wheel_angle_rad: float
    rear_wheel_angle_rad: float
    speed_mps: float
    reason: Reason
    gear_request: Gear


class WireCommand(NamedTuple):
    """A permitted command in the form that the vehicle obeys. Only `command_forms` builds it, from a `SafeCommand`.

    The encoder takes the fields that are bound. The numbers are finite and within the ranges of their signals.
    """

    enable: bool
    safe_stop: bool
    reason: Reason
    gear_request: Gear
    accel_mps2: float
    speed_mps: float
    """The speed to be driven, or else the reference speed."""
    drive_mps2: float
    """Along the direction of travel; at most one of drive and brake is above 0."""
    brake_mps2: float
    throttle: float
    """In the signal's own unit; at most one of the pedals is above 0."""
    brake: float
    front_wheel_angle_rad: float
    rear_wheel_angle_rad: float
    curvature_per_m: float
    """Positive to the left."""
    yaw_rate_radps: float
    """Positive to the left, also when reversing."""


class Phases(NamedTuple):
    """Which values of a profile's `when` apply now; none in a run that is not armed."""

    armed: bool = False
    """From arming until the driver takes over, a fault, or the end of the run."""
    engaging: bool = False
    """The vehicle is to become autonomous: no driver acts, and it reports no fault."""
    enabled: bool = False
    """Commands are enabled, from engaging on; during stops as well."""
    released: bool = False
    """The driver took over, there was a fault, or the run has ended; until it is armed again."""
    always: bool = False
    """Whenever anything may be sent."""
