"""The target of a vehicle that is commanded by speed: the permitted acceleration, integrated from the measured speed.

A target that is only measured speed plus acceleration times a constant makes a vehicle accelerate less than permitted
unless the constant happens to be the lag of its speed controller. An integrator does not need to know the lag: once
the vehicle follows, it accelerates as permitted. It is bounded, so that a vehicle that does not follow (uphill or
blocked) does not find a distant target when it does.

- The target is within `HORIZON_S` of the greatest drive or braking from the measured speed. A vehicle that
  becomes faster than commanded (downhill or pushed) never raises its target.
- It has the sign of the direction of travel, or is 0; it turns over only where the vehicle stands.
- It is never above the speed limit, and never above the measured speed while the vehicle waits for a gear or is
  stopped. While the vehicle does not obey yet it is the measured speed.
- A stop ramps the target down by the stop's own deceleration, whatever the measured speed does: to 0 also from a state
  that grows old. At 0 it stays.
"""

from typing import NamedTuple

from vehicle_iface.command import SafeCommand
from vehicle_iface.command_forms.motion import LONGEST_STEP_S, MeasuredMotion, WireRange
from vehicle_iface.profile import Limits
from vehicle_iface.standstill import STANDING_MPS
from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_S

HORIZON_S = 0.5
"""The target leads the vehicle by at most this much time of the greatest acceleration: lags of speed controllers are
below it."""


class _Sent(NamedTuple):
    at_ns: int
    target_mps: float


class SpeedTarget:
    """Keeps the target that was sent last; `form` proposes the next one and `commit` says that it was sent."""

    fields = frozenset({"speed_mps"})

    def __init__(self, limits: Limits, wire: WireRange, *, changes_gear: bool) -> None:
        """`changes_gear`: the vehicle reports its gear and takes requests for another one."""
        self._highest_mps = wire.floor(limits.speed_max_mps)
        self._ahead_mps = limits.accel_max_mps2 * HORIZON_S
        self._behind_mps = -limits.accel_min_mps2 * HORIZON_S
        self._changes_gear = changes_gear
        self._is_unsigned = wire.low >= 0.0
        self._last: _Sent | None = None
        self._proposed: _Sent | None = None

    def form(self, permitted: SafeCommand, motion: MeasuredMotion, now_ns: int) -> float:
        """Compute the speed to send in m/s: signed, or its magnitude where the signal is unsigned (sign by gear)."""
        if not permitted.enable:
            self._proposed = None
            return 0.0
        sign = -1.0 if motion.reversing else 1.0
        measured_mps, last = sign * motion.speed_mps, self._last
        dt_s, before_mps = 0.0, measured_mps
        if last is not None and not motion.engaging:
            dt_s = min(LONGEST_STEP_S, max(0.0, (now_ns - last.at_ns) / NS_PER_S))
            before_mps = sign * last.target_mps
        along_mps2 = sign * permitted.accel_mps2
        waits = self._changes_gear and permitted.gear_request is not Gear.NO_REQUEST
        if permitted.safe_stop:
            target_mps = min(before_mps, measured_mps) - abs(along_mps2) * dt_s
            if measured_mps < STANDING_MPS:
                target_mps = 0.0
        else:
            target_mps = max(0.0, before_mps) + along_mps2 * dt_s
            ahead_mps = 0.0 if waits else self._ahead_mps
            behind_mps = min(measured_mps - self._behind_mps, before_mps)
            target_mps = min(max(target_mps, behind_mps), measured_mps + ahead_mps)
        target_mps = min(self._highest_mps, max(0.0, target_mps))
        if self._is_unsigned and motion.reversing and not self._changes_gear:
            target_mps = 0.0  # it can be told to drive forwards only
        self._proposed = _Sent(now_ns, sign * target_mps)
        return target_mps if self._is_unsigned else sign * target_mps

    def commit(self) -> None:
        """Record that the proposed target was sent."""
        self._last = self._proposed
