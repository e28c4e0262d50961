"""The stop manoeuvre: drive is removed, the brake ramps up at a jerk, is released before standstill, then holds.

The brake is an acceleration against the motion, in m/s², positive. Only this module decides how hard a stop brakes;
from the command that stops, the gate takes the steering and the reason.
"""

from msgspec.structs import fields, force_setattr

from vehicle_iface import checks
from vehicle_iface.safety.limits import Channel, floor_raw
from vehicle_iface.value import Value


class StopShape(Value, frozen=True, kw_only=True):
    """Deceleration and jerk of a stop. Raises `InvalidValueError` for a number that is out of range."""

    deceleration_mps2: float
    """The safe deceleration: a stop never brakes harder."""
    time_step_s: float
    """Longest time until the next command: the brake never brings the vehicle to rest in less."""
    jerk_mps3: float
    """The brake ramps up and down at this rate."""
    release_time_constant_s: float
    """Speed / brake just before standstill: the brake is released with the speed, so that there is no jolt."""
    hold_mps2: float
    """The brake at standstill; 0 where SAFE_STOP alone holds the vehicle."""

    def __post_init__(self) -> None:
        for field in fields(self):
            check = checks.non_negative if field.name == "hold_mps2" else checks.positive
            force_setattr(self, field.name, check(field.name, getattr(self, field.name)))


def stop_accel_raw(
    shape: StopShape, brake: Channel, last_raw: int, speed_mps: float, dt_s: float, *, reversing: bool
) -> int:
    """The raw value of a stop's acceleration, `dt_s` after `last_raw` was sent. Defined for every input.

    `brake` is the acceleration channel for driving forwards, mirrored: braking is positive. `reversing` is the
    direction that a vehicle at standstill is held against. A speed that is NaN counts as fast.

    most = min(safe deceleration, |v| / time step); wanted = min(most, |v| / release time constant); at standstill both
    are hold_mps2. b = the brake sent last, clamped to 0 … most: drive is removed at once, and so is a brake that is
    harder than a stop's or would reverse the motion. The result is wanted, clamped to [b − step, b + step], with the
    sign against v. So it is never along v, never above most, in range as b and wanted are, and within one step of b.
    """
    backwards = speed_mps < 0.0 or (reversing and not speed_mps > 0.0)
    sign, fast_mps = 1 if backwards else -1, abs(speed_mps)
    if fast_mps == 0.0:
        most_mps2 = wanted_mps2 = min(shape.deceleration_mps2, shape.hold_mps2)
    else:
        most_mps2 = min(shape.deceleration_mps2, fast_mps / shape.time_step_s)
        wanted_mps2 = min(most_mps2, fast_mps / shape.release_time_constant_s)
    last = min(floor_raw(brake, most_mps2), max(0, sign * last_raw))
    # At least one count, so that a signal with coarse counts ramps up as well.
    step = max(1, brake.step_raw(dt_s, shape.jerk_mps3)) if dt_s > 0.0 else 0
    return sign * min(last + step, max(last - step, floor_raw(brake, wanted_mps2)))
