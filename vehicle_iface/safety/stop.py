"""The stop as a manoeuvre: nothing drives any more, the brake comes on by a jerk, is let up before standstill, holds.

What is asked for is a brake: the size of an acceleration against the motion. Of a stop nobody but this module decides
how hard it brakes; from the command that stops, the gate takes the steering and the reason.
"""

from dataclasses import dataclass, fields

from vehicle_iface import checks
from vehicle_iface.safety.limits import Channel, floor_raw


@dataclass(frozen=True, slots=True, kw_only=True)
class StopShape:
    """How hard and how smoothly a stop brakes. Raises `InvalidValueError` for a number that no stop has."""

    deceleration_mps2: float
    """The safe deceleration: a stop never brakes harder."""
    time_step_s: float
    """Until the next command, at most: the brake would not bring the vehicle to rest in less."""
    jerk_mps3: float
    """The brake comes on, and is eased, at this rate."""
    release_time_constant_s: float
    """Speed over brake, in the end: the brake is let up with the speed, so that no jolt is felt at standstill."""
    hold_mps2: float
    """The brake at standstill; 0 where SAFE_STOP alone holds the vehicle."""

    def __post_init__(self) -> None:
        for field in fields(self):
            check = checks.non_negative if field.name == "hold_mps2" else checks.positive
            object.__setattr__(self, field.name, check(field.name, getattr(self, field.name)))


def stop_accel_raw(
    shape: StopShape, brake: Channel, last_raw: int, speed_mps: float, dt_s: float, *, reversing: bool
) -> int:
    """The wire value of a stop's acceleration, `dt_s` after `last_raw` was sent. Total: an answer to every number.

    `brake` is the channel of acceleration driven forwards, turned round: what brakes is positive. `reversing` tells
    against what a standing vehicle is held. A speed that is no number counts as fast.

    Let most be the hold at standstill, or else |v| / time step, and never above the safe deceleration; wanted the same
    with the ease in place of the time step, and never above most. Let b be the brake that was sent last, cut to
    0 … most: what drove is dropped at once, and so is a brake that is harder than a stop's or would turn the motion
    round. The result is wanted cut to [b − step, b + step], so it lies between b and wanted; its sign is against v. So
    it is never along v, never above most, in range as b and wanted are, and within one step of b.
    """
    backwards = speed_mps < 0.0 or (reversing and not speed_mps > 0.0)
    sign, fast_mps = 1 if backwards else -1, abs(speed_mps)
    if fast_mps == 0.0:
        most_mps2 = wanted_mps2 = min(shape.deceleration_mps2, shape.hold_mps2)
    else:
        most_mps2 = min(shape.deceleration_mps2, fast_mps / shape.time_step_s)
        wanted_mps2 = min(most_mps2, fast_mps / shape.release_time_constant_s)
    last = min(floor_raw(brake, most_mps2), max(0, sign * last_raw))
    # A signal whose counts are coarse against the jerk comes on all the same.
    step = max(1, brake.step_raw(dt_s, shape.jerk_mps3)) if dt_s > 0.0 else 0
    return sign * min(last + step, max(last - step, floor_raw(brake, wanted_mps2)))
