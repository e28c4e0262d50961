"""Range and rate limits of a command (acceleration, steering, speed): the only place that builds a `SafeCommand`."""

import math
from collections.abc import Callable, Collection
from math import atan, isfinite, tan

from vehicle_iface.command import Command, SafeCommand
from vehicle_iface.interpolation import interpolate
from vehicle_iface.profile import Limits
from vehicle_iface.reason import Reason
from vehicle_iface.safety.limits import UNBOUNDED, Channel, clamp_interval, floor_raw, limit_raw, nearest_raw, raw_range
from vehicle_iface.safety.stop import StopShape, stop_accel_raw
from vehicle_iface.standstill import CREEPING_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_S
from vehicle_iface.value import Value

LONGEST_STEP_S = 0.1
"""The longest time that one step of a rate limit counts, also after a longer pause."""
_NOMINAL = Reason.NOMINAL


class GateChannels(Value, frozen=True, kw_only=True):
    """What the gate limits. The acceleration channel is for driving forwards; backwards it is mirrored."""

    accel_mps2: Channel
    front_wheel_angle_rad: Channel
    rear_wheel_angle_rad: Channel
    speed_mps: Channel


class _Sent(Value, frozen=True, gc=False):
    """The values that were sent last, in raw counts, and when: the start of each rate limit."""

    accel_ns: int = 0
    accel_raw: int = 0
    front_ns: int = 0
    front_raw: int = 0
    rear_ns: int = 0
    rear_raw: int = 0
    turned_ns: int = 0
    """When a wheel angle last changed."""


class Gate:
    """Limits each command in range and rate, on the value as encoded. It never raises.

    `permit` proposes a command and `commit` confirms that it was sent. Rates are limited from the last committed value;
    before the first one, from the measured wheel angles. The deceleration of a stop is not taken from the request, see
    `stop.stop_accel_raw`.

    The front wheel angle has three more limits: lateral acceleration and jerk at the measured speed, a table over
    speed, and the distance from the measured angle. If the speed has risen, the command returns to the limit as fast as
    the wheels may turn. If the measured angle drifts off, the command neither moves further from it nor follows it: the
    sensor may be at fault. Where limits contradict each other, the lateral ones come first and the table second;
    `limits.limit_raw` has the proof that none breaks another.
    """

    _drive_mps2: float
    _front_at_speed_raw: int
    """The limits by the tables over speed, at the speed `_looked_up_mps`."""

    def __init__(self, channels: GateChannels, limits: Limits, *, wheelbase_m: float, stop: StopShape) -> None:
        self._channels = channels
        self._limits = limits
        self._stop = stop
        self._wheelbase_m = wheelbase_m
        self._backwards = _mirrored(channels.accel_mps2)
        self._looked_up_mps = math.nan
        self._last = self._proposed = _Sent()
        self.limited: dict[str, int] = dict.fromkeys(
            ("accel_mps2", "front_wheel_angle_rad", "rear_wheel_angle_rad", "speed_mps", "overspeed", "not_finite"), 0
        )
        """How often each field was limited."""

    def start_from(self, state: VehicleState, now_ns: int) -> None:
        """Start the rate limits from the measured wheel angles and an acceleration of 0."""
        front, rear = self._channels.front_wheel_angle_rad, self._channels.rear_wheel_angle_rad
        front_raw, rear_raw = (
            nearest_raw(front, state.front_wheel_angle_rad),
            nearest_raw(rear, state.rear_wheel_angle_rad),
        )
        self._last = self._proposed = _Sent(now_ns, 0, now_ns, front_raw, now_ns, rear_raw, now_ns)

    def permit(
        self,
        requested: Command,
        state: VehicleState,
        *,
        now_ns: int,
        reversing: bool,
        engaging: bool = False,
        gear_request: Gear = Gear.NO_REQUEST,
        speed_mps: float | None = None,
        speed_is_known: bool = True,
    ) -> SafeCommand:
        """The nearest command that may be sent, enabled.

        `state` is the measured one; `now_ns` is the monotonic time of sending; `reversing` is the direction of travel.
        `speed_mps` is the speed that limits are computed for, the measured one by default: at the speed limit or above,
        drive is cut to 0. Without `speed_is_known`, a stop brakes as if the vehicle were moving. While `engaging`,
        drive and steering have tighter limits, and the wheel angle stays within 0.1 s of turning of the measured one.
        """
        if speed_mps is None:
            speed_mps = state.speed_mps
        reason, channels, last = requested.reason, self._channels, self._last
        accel, front, rear, told_mps = (
            requested.accel_mps2,
            requested.front_wheel_angle_rad,
            requested.rear_wheel_angle_rad,
            requested.speed_mps,
        )
        finite = isfinite(accel) and isfinite(front) and isfinite(rear) and isfinite(told_mps)
        if not finite:
            reason, front, rear, told_mps = Reason.CONTROLLER_ERROR, 0.0, 0.0, 0.0
            self.limited["not_finite"] += 1
        if abs(speed_mps) != self._looked_up_mps:
            self._look_up_limits(abs(speed_mps))
        accel_s = _step_s(now_ns, last.accel_ns)
        is_stop = reason is not _NOMINAL
        if is_stop:
            braked_mps = speed_mps if speed_is_known else -math.inf if reversing else math.inf
            accel_raw = stop_accel_raw(
                self._stop, self._backwards, last.accel_raw, braked_mps, accel_s, reversing=reversing
            )
        else:
            accel_raw = self._accel_raw(accel, speed_mps, accel_s, reversing, engaging)
        rear_raw = self._rear_raw(rear, now_ns)
        front_raw = self._front_raw(front, rear_raw, state.front_wheel_angle_rad, speed_mps, now_ns, engaging)
        speed_raw = nearest_raw(channels.speed_mps, told_mps)
        self._count_if_limited(channels.speed_mps, told_mps, speed_raw)
        turned = front_raw != last.front_raw or rear_raw != last.rear_raw
        turned_ns = now_ns if turned else last.turned_ns
        self._proposed = _Sent(now_ns, accel_raw, now_ns, front_raw, now_ns, rear_raw, turned_ns)
        return SafeCommand(
            stamp_ns=requested.stamp_ns,
            enable=True,
            safe_stop=is_stop,
            accel_mps2=accel_raw * channels.accel_mps2.lsb,
            front_wheel_angle_rad=front_raw * channels.front_wheel_angle_rad.lsb,
            rear_wheel_angle_rad=rear_raw * channels.rear_wheel_angle_rad.lsb,
            speed_mps=speed_raw * channels.speed_mps.lsb,
            reason=reason,
            gear_request=gear_request,
        )

    def commit(self) -> None:
        """Confirm that the last permitted command was sent: rates are limited from it."""
        self._last = self._proposed

    def commit_fields(self, fields: Collection[str]) -> None:
        """Confirm that only these fields were sent: the rates of the others are limited from the command before."""
        sent, before = self._proposed, self._last
        accel = sent if "accel_mps2" in fields else before
        front = sent if "front_wheel_angle_rad" in fields else before
        rear = sent if "rear_wheel_angle_rad" in fields else before
        turned = front.front_raw != before.front_raw or rear.rear_raw != before.rear_raw
        self._last = _Sent(
            accel.accel_ns,
            accel.accel_raw,
            front.front_ns,
            front.front_raw,
            rear.rear_ns,
            rear.rear_raw,
            sent.turned_ns if turned else before.turned_ns,
        )

    def release(self, *, stamp_ns: int, reason: Reason) -> SafeCommand:
        """The command that releases the vehicle: ENABLE = 0, all values 0. A later `commit` changes nothing."""
        self._proposed = self._last
        return SafeCommand(
            stamp_ns=stamp_ns,
            enable=False,
            safe_stop=False,
            accel_mps2=0.0,
            front_wheel_angle_rad=0.0,
            rear_wheel_angle_rad=0.0,
            speed_mps=0.0,
            reason=reason,
            gear_request=Gear.NO_REQUEST,
        )

    def _look_up_limits(self, fast_mps: float) -> None:
        """The limits of drive and of the front wheel angle at a speed; they are kept until there is another speed."""
        limits = self._limits
        front_rad = interpolate(limits.front_wheel_angle_by_speed, fast_mps)
        self._front_at_speed_raw = floor_raw(self._channels.front_wheel_angle_rad, front_rad)
        self._drive_mps2 = interpolate(limits.accel_max_by_speed, fast_mps)
        self._looked_up_mps = fast_mps

    def _accel_raw(self, accel: float, speed_mps: float, dt_s: float, reversing: bool, engaging: bool) -> int:
        channels, limits, drive = self._channels, self._limits, self._drive_mps2
        if abs(speed_mps) >= channels.speed_mps.highest and accel * speed_mps > 0.0:
            self.limited["overspeed"] += 1
            accel = 0.0
        if engaging:
            drive = min(drive, limits.while_engaging.accel_max_mps2)
        drive_raw = floor_raw(channels.accel_mps2, drive)
        within = (-drive_raw, UNBOUNDED) if reversing else (-UNBOUNDED, drive_raw)
        channel = self._backwards if reversing else channels.accel_mps2
        raw = limit_raw(channel, accel, self._last.accel_raw, dt_s, math.inf, within)
        self._count_if_limited(channel, accel, raw)
        return raw

    def _rear_raw(self, requested: float, now_ns: int) -> int:
        channel, last, raw = self._channels.rear_wheel_angle_rad, self._last, 0
        if channel.lowest_raw < channel.highest_raw:  # otherwise the rear wheels do not steer
            raw = limit_raw(channel, requested, last.rear_raw, _step_s(now_ns, last.rear_ns))
        self._count_if_limited(channel, requested, raw)
        return raw

    def _front_raw(
        self,
        requested: float,
        rear_raw: int,
        measured: float,
        speed_mps: float,
        now_ns: int,
        engaging: bool,
    ) -> int:
        channel, limits, last = self._channels.front_wheel_angle_rad, self._limits, self._last
        last_raw = last.front_raw
        at_speed_raw = self._front_at_speed_raw
        within = -at_speed_raw, at_speed_raw
        apart = limits.front_wheel_deviation_rad
        if math.isfinite(measured) and apart < math.inf:
            if engaging:  # a vehicle that begins to obey must not find a step in the commanded angle
                apart = min(apart, limits.while_engaging.front_wheel_rate_radps * LONGEST_STEP_S)
            nearest, farthest = raw_range(channel, measured - apart, measured + apart)
            if nearest > last_raw:
                nearest = last_raw
            if farthest < last_raw:
                farthest = last_raw
            within = clamp_interval((nearest, farthest), within)
        if abs(speed_mps) >= CREEPING_MPS:
            within = clamp_interval(within, self._lateral_raw(rear_raw, speed_mps, now_ns))
        rate_per_s = limits.while_engaging.front_wheel_rate_radps if engaging else math.inf
        raw = limit_raw(channel, requested, last_raw, _step_s(now_ns, last.front_ns), rate_per_s, within)
        self._count_if_limited(channel, requested, raw)
        return raw

    def _lateral_raw(self, rear_raw: int, speed_mps: float, now_ns: int) -> tuple[int, int]:
        """Lowest and highest front wheel angle, in counts, with lateral acceleration and jerk within their limits.

        The jerk limit allows a change for one step of time, or for as long as the wheels were not turned up to one
        count. So the limit holds from one change to the next, and a coarse signal can still change.
        """
        channels, limits, last, wheelbase_m = self._channels, self._limits, self._last, self._wheelbase_m
        front_lsb, rear_lsb = channels.front_wheel_angle_rad.lsb, channels.rear_wheel_angle_rad.lsb
        most = limits.lateral_accel_mps2 / (speed_mps * speed_mps)
        per_s = limits.lateral_jerk_mps3 / (speed_mps * speed_mps)
        by_step = per_s * _step_s(now_ns, last.front_ns if last.front_ns > last.rear_ns else last.rear_ns)
        by_hold = per_s * ((now_ns - last.turned_ns) / NS_PER_S)
        # The curvature (1/m) of the angles sent last, and with the front wheels one count further right or left.
        was_rad, rear_tan = last.front_raw * front_lsb, tan(last.rear_raw * rear_lsb)
        now = (tan(was_rad) - rear_tan) / wheelbase_m
        one_right = now - (tan(was_rad - front_lsb) - rear_tan) / wheelbase_m
        one_left = (tan(was_rad + front_lsb) - rear_tan) / wheelbase_m - now
        # Conditions in the place of min and max, which take a microsecond more in all.
        held_right = by_hold if by_hold < one_right else one_right
        held_left = by_hold if by_hold < one_left else one_left
        low = now - (by_step if by_step > held_right else held_right)
        high = now + (by_step if by_step > held_left else held_left)
        if now > most:  # the speed has risen: return to the limit at the wheels' rate, then further by the jerk
            low, high = min(low, most - one_left), most
        elif now < -most:
            low, high = -most, max(high, one_right - most)
        else:
            low, high = low if low > -most else -most, high if high < most else most
        # The front wheels that make a curvature with the rear wheels where they are.
        rear_tan = tan(rear_raw * rear_lsb)
        return raw_range(
            channels.front_wheel_angle_rad, atan(rear_tan + low * wheelbase_m), atan(rear_tan + high * wheelbase_m)
        )

    def _count_if_limited(self, channel: Channel, requested: float, raw: int) -> None:
        if abs(raw * channel.lsb - requested) > channel.lsb:
            self.limited[channel.name] += 1


def gate_channels(limits: Limits, lsb: Callable[[str], float]) -> GateChannels:
    """The gate's channels from a profile's limits; `lsb(field)` is the size of one raw count, in SI units."""

    def symmetric(name: str, limit: float, rate_per_s: float) -> Channel:
        return Channel(name=name, lsb=lsb(name), lowest=-limit, highest=limit, rate_per_s=rate_per_s)

    return GateChannels(
        accel_mps2=Channel(
            name="accel_mps2",
            lsb=lsb("accel_mps2"),
            lowest=limits.accel_min_mps2,
            highest=limits.accel_max_mps2,
            rate_per_s=limits.accel_rate_mps3,
        ),
        front_wheel_angle_rad=symmetric(
            "front_wheel_angle_rad", limits.front_wheel_angle_rad, limits.front_wheel_rate_radps
        ),
        rear_wheel_angle_rad=symmetric(
            "rear_wheel_angle_rad", limits.rear_wheel_angle_rad, limits.rear_wheel_rate_radps
        ),
        speed_mps=symmetric("speed_mps", limits.speed_max_mps, math.inf),
    )


def _step_s(now_ns: int, since_ns: int) -> float:
    """The time step of a rate limit, at most `LONGEST_STEP_S`. Nothing changes in one that is not positive."""
    step_s = (now_ns - since_ns) / NS_PER_S
    return step_s if step_s < LONGEST_STEP_S else LONGEST_STEP_S


def _mirrored(channel: Channel) -> Channel:
    return Channel(
        name=channel.name,
        lsb=channel.lsb,
        lowest=-channel.highest,
        highest=-channel.lowest,
        rate_per_s=channel.rate_per_s,
    )
