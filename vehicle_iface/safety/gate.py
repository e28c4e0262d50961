"""From a wish to a permission: the one place where a `SafeCommand` is made."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from vehicle_iface.command import Command, SafeCommand
from vehicle_iface.profile import Limits
from vehicle_iface.reason import Reason
from vehicle_iface.safety.limits import Channel, limited_raw
from vehicle_iface.state import VehicleState
from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_S

LONGEST_STEP_S = 0.1
"""After a longer silence the rate limits grant no more than this much at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GateChannels:
    """What the gate limits. Acceleration is that of driving forwards; backwards it is mirrored."""

    accel_mps2: Channel
    front_wheel_angle_rad: Channel
    rear_wheel_angle_rad: Channel
    speed_mps: Channel


class Gate:
    """Limits each command in range and rate, on the value as encoded. It always answers and never raises.

    Rates are taken from the last value that was sent; before the first one, from what was measured. Only the drive
    is dropped at once by a stop; from there the brake is ramped up like everything else.
    """

    def __init__(self, channels: GateChannels) -> None:
        self._channels = channels
        self._backwards = _mirrored(channels.accel_mps2)
        self._last_ns = 0
        self._accel_raw = 0
        self._front_raw = 0
        self._rear_raw = 0
        self.limited: dict[str, int] = dict.fromkeys(
            ("accel_mps2", "front_wheel_angle_rad", "rear_wheel_angle_rad", "speed_mps", "overspeed", "not_finite"), 0
        )
        """How often each wish had to be cut."""

    def start_from(self, state: VehicleState, now_ns: int) -> None:
        """Take the vehicle over as it is: the first step is counted from the measured wheel angles."""
        self._last_ns = now_ns
        self._accel_raw = 0
        self._front_raw = _nearest_raw(self._channels.front_wheel_angle_rad, state.front_wheel_angle_rad)
        self._rear_raw = _nearest_raw(self._channels.rear_wheel_angle_rad, state.rear_wheel_angle_rad)

    def permit(
        self,
        wish: Command,
        *,
        now_ns: int,
        reversing: bool,
        measured_mps: float = 0.0,
        gear_request: Gear = Gear.NO_REQUEST,
    ) -> SafeCommand:
        """The nearest command that may be sent, enabled.

        `now_ns` is the monotonic time of sending; `reversing` tells which way drive and brake point; at a measured
        speed of the limit or above nothing is added to it.
        """
        numbers = (wish.accel_mps2, wish.front_wheel_angle_rad, wish.rear_wheel_angle_rad, wish.speed_mps)
        finite = all(map(math.isfinite, numbers))
        reason = wish.reason if finite else Reason.CONTROLLER_ERROR
        accel, front, rear, speed = numbers if finite else (0.0, 0.0, 0.0, 0.0)
        self.limited["not_finite"] += not finite
        dt_s = min(LONGEST_STEP_S, max(0.0, (now_ns - self._last_ns) / NS_PER_S))
        self._last_ns = now_ns
        channels = self._channels
        accel_channel = self._backwards if reversing else channels.accel_mps2
        if abs(measured_mps) >= channels.speed_mps.highest and accel * measured_mps > 0.0:
            self.limited["overspeed"] += 1
            accel = 0.0
        if reason is not Reason.NOMINAL and (self._accel_raw < 0 if reversing else self._accel_raw > 0):
            self._accel_raw = 0  # a stop does not go on driving while the rate limit ramps it down
        self._accel_raw = self._limit(accel_channel, accel, self._accel_raw, dt_s)
        self._front_raw = self._limit(channels.front_wheel_angle_rad, front, self._front_raw, dt_s)
        self._rear_raw = self._limit(channels.rear_wheel_angle_rad, rear, self._rear_raw, dt_s)
        speed_raw = self._limit(channels.speed_mps, speed, 0, dt_s)
        return SafeCommand(
            stamp_ns=wish.stamp_ns,
            enable=True,
            safe_stop=reason is not Reason.NOMINAL,
            accel_mps2=self._accel_raw * channels.accel_mps2.lsb,
            front_wheel_angle_rad=self._front_raw * channels.front_wheel_angle_rad.lsb,
            rear_wheel_angle_rad=self._rear_raw * channels.rear_wheel_angle_rad.lsb,
            speed_mps=speed_raw * channels.speed_mps.lsb,
            reason=reason,
            gear_request=gear_request,
        )

    def release(self, *, stamp_ns: int, reason: Reason) -> SafeCommand:
        """Let the vehicle go: nothing is asked of it."""
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

    def _limit(self, channel: Channel, wanted: float, last_raw: int, dt_s: float) -> int:
        raw = limited_raw(channel, wanted, last_raw, dt_s)
        self.limited[channel.name] += abs(raw * channel.lsb - wanted) > channel.lsb
        return raw


def gate_channels(limits: Limits, lsb: Callable[[str], float]) -> GateChannels:
    """The gate's channels from a profile's limits; `lsb(field)` is what the wire can tell apart, in SI units."""

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


def _mirrored(channel: Channel) -> Channel:
    return Channel(
        name=channel.name,
        lsb=channel.lsb,
        lowest=-channel.highest,
        highest=-channel.lowest,
        rate_per_s=channel.rate_per_s,
    )


def _nearest_raw(channel: Channel, value: float) -> int:
    return min(channel.highest_raw, max(channel.lowest_raw, round(value / channel.lsb)))
