"""Two unsigned commands, one for drive and one for the brake: pedals by tables, or both as accelerations."""

from collections.abc import Sequence
from typing import NamedTuple

from vehicle_iface.command import SafeCommand
from vehicle_iface.command_forms.motion import LONGEST_STEP_S, MeasuredMotion, WireRange
from vehicle_iface.interpolation import interpolate
from vehicle_iface.profile import Limits
from vehicle_iface.profile.command_forms import Feedback
from vehicle_iface.standstill import STANDING_MPS
from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_S

Table = Sequence[tuple[float, float]]
"""Rows of acceleration in m/s² and command, both rising."""
CORRECTION_SHARE = 0.3
"""The feedback corrects an acceleration by at most this share of the greatest drive or braking."""


class PedalPair(NamedTuple):
    """The values to send; at most one of the two is above 0."""

    drive: float
    brake: float


RELEASED = PedalPair(0.0, 0.0)


class _Sent(NamedTuple):
    at_ns: int
    is_drive: bool
    integral_mps2: float


class PedalFormer:
    """Chooses the pedal by the direction of travel: an acceleration along it drives, one against it brakes.

    Nothing drives while the vehicle waits for the requested gear, nor backwards a vehicle that has no gear on its bus:
    it brakes instead, and what drives afterwards rises from 0 at the profile's rate. The feedback neither changes the
    pedal nor goes beyond the limits; it starts again at 0 with the other pedal, at standstill, in a stop, and while the
    vehicle does not obey.
    """

    def __init__(
        self,
        limits: Limits,
        *,
        drive: Table,
        brake: Table,
        ranges: tuple[WireRange, WireRange],
        changes_gear: bool,
        feedback: Feedback | None = None,
    ) -> None:
        """`ranges` are those of drive and brake. `changes_gear`: gears are reported and requested."""
        self._drive, self._brake = drive, brake
        self._highest_mps2 = {True: limits.accel_max_mps2, False: -limits.accel_min_mps2}
        self._highest = {
            is_drive: wire.floor(interpolate(table, self._highest_mps2[is_drive]))
            for is_drive, table, wire in ((True, drive, ranges[0]), (False, brake, ranges[1]))
        }
        self._changes_gear = changes_gear
        self._feedback = feedback
        self._rate_mps3 = limits.accel_rate_mps3
        self._waited_ns: int | None = None
        """When a vehicle that was to drive was braked instead for the last time."""
        self._last: _Sent | None = None
        self._proposed: _Sent | None = None

    def form(self, permitted: SafeCommand, motion: MeasuredMotion, now_ns: int) -> PedalPair:
        """Compute both commands in their signals' units."""
        along_mps2 = -permitted.accel_mps2 if motion.reversing else permitted.accel_mps2
        if not permitted.enable or along_mps2 == 0.0:
            self._proposed = None
            return RELEASED
        is_to_drive = along_mps2 > 0.0 and not permitted.safe_stop
        is_drive = is_to_drive and self._may_drive(permitted, motion)
        size_mps2 = abs(along_mps2)
        if is_to_drive and not is_drive:
            self._waited_ns = now_ns
        elif is_drive and self._waited_ns is not None:
            size_mps2 = min(size_mps2, self._rate_mps3 * (now_ns - self._waited_ns) / NS_PER_S)
        if self._feedback is not None:
            size_mps2 = self._correct(self._feedback, size_mps2, permitted, motion, now_ns, is_drive=is_drive)
        command = min(interpolate(self._drive if is_drive else self._brake, size_mps2), self._highest[is_drive])
        return PedalPair(command, 0.0) if is_drive else PedalPair(0.0, command)

    def commit(self) -> None:
        """Record that the proposed commands were sent."""
        self._last = self._proposed

    def _may_drive(self, permitted: SafeCommand, motion: MeasuredMotion) -> bool:
        if self._changes_gear:
            return permitted.gear_request is Gear.NO_REQUEST
        return not motion.reversing

    def _correct(
        self,
        feedback: Feedback,
        size_mps2: float,
        permitted: SafeCommand,
        motion: MeasuredMotion,
        now_ns: int,
        *,
        is_drive: bool,
    ) -> float:
        """Return the size of the acceleration after correction by its error."""
        if permitted.safe_stop or motion.engaging or abs(motion.speed_mps) < STANDING_MPS:
            self._proposed = None
            return size_mps2
        last, highest_mps2 = self._last, self._highest_mps2[is_drive]
        bound_mps2 = CORRECTION_SHARE * highest_mps2
        sign = -1.0 if is_drive is motion.reversing else 1.0
        error_mps2 = size_mps2 - sign * motion.accel_mps2
        integral_mps2 = 0.0
        if last is not None and last.is_drive is is_drive:
            dt_s = min(LONGEST_STEP_S, max(0.0, (now_ns - last.at_ns) / NS_PER_S))
            integral_mps2 = _clamp(last.integral_mps2 + feedback.ki * error_mps2 * dt_s, bound_mps2)
        self._proposed = _Sent(now_ns, is_drive, integral_mps2)
        correction_mps2 = _clamp(feedback.kp * error_mps2 + integral_mps2, bound_mps2)
        return min(highest_mps2, max(0.0, size_mps2 + correction_mps2))


def identity_table(highest: float) -> Table:
    """Return a command that is the acceleration itself."""
    return ((0.0, 0.0), (highest, highest))


def _clamp(value: float, bound: float) -> float:
    return min(bound, max(-bound, value))
