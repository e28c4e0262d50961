"""Compares the sources of motion with each other: position, speed, acceleration, heading, yaw rate, wheels.

One sample shows little of a sensor that is slightly wrong. Each pair of sources is therefore integrated over the
samples (trapezoidal rule) and compared over two windows: half a second shows gross errors soon, two seconds show small
ones. With v the speed along the body, v_y the lateral speed, a the acceleration, ψ the heading, r the yaw rate, κ the
curvature of the wheels (`lateral.curvature_per_m`) and Δp the change of position:

    forward way    Σ Δp · (cos ψ, sin ψ)     against   ∫ v dt       position and speed
    lateral way    Σ Δp · (−sin ψ, cos ψ)    against   ∫ v_y dt     position and heading
    speed change   Δv                        against   ∫ a dt       speed and acceleration
    turn           Σ Δψ                      against   ∫ r dt       heading and yaw rate
    turn           ∫ r dt                    against   ∫ v·κ dt     yaw rate and wheels

A pair disagrees when its difference over a window exceeds noise + drift · window + share · way (or turn). The noise is
the profile's tolerance between two samples (`[plausibility]`); drift and share are the constants below.
"""

import logging
import math
from collections import deque
from enum import Enum
from typing import NamedTuple

from vehicle_iface.motion_sources import MotionSources
from vehicle_iface.profile import Plausibility
from vehicle_iface.safety.lateral import curvature_per_m
from vehicle_iface.safety.limits import LimitViolation
from vehicle_iface.standstill import STANDING_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_MS, NS_PER_S, ns_from_s, wrapped_rad

log = logging.getLogger(__name__)

SHORT_WINDOW_NS = 500 * NS_PER_MS
LONG_WINDOW_NS = 2000 * NS_PER_MS
NODE_NS = 50 * NS_PER_MS
"""The integrals are compared this often."""
SPEED_DRIFT_MPS, SPEED_SHARE = 0.05, 0.03
"""Speed against position: an offset, and a scale error such as that of a worn tyre."""
SLIP_SHARE = 0.06
"""Position against heading: a sensor that is mounted askew, and a rear axle that slips sideways."""
ACCEL_DRIFT_MPS2 = 0.7
"""Acceleration against speed: a bias, and gravity on a slope of 7 %."""
YAW_RATE_DRIFT_RADPS, YAW_RATE_SHARE = 0.03, 0.05
"""Yaw rate against heading: bias and scale error."""
WHEEL_NOISE_RAD, WHEEL_OFFSET_RAD, UNDERSTEER_SHARE = 0.05, 0.03, 0.3
"""Wheels against yaw rate: noise, an offset of the wheel angle, and a vehicle that turns less than its wheels."""
POSITION_SPEED_NOISE_MPS = 0.15
"""A speed by position that differs from the speed signal by less is noise."""
DIRECTION_NOISE_M = 0.05
"""A position that moved by less over the last comparisons does not tell a direction."""
_DIRECTION: dict[Gear | None, int] = {Gear.DRIVE: 1, Gear.REVERSE: -1}


class Disagreement(Enum):
    """Which two sources disagree."""

    POSITION_SPEED = "position and speed disagree"
    POSITION_HEADING = "position and heading disagree"
    SPEED_ACCELERATION = "speed and acceleration disagree"
    HEADING_YAW_RATE = "heading and yaw rate disagree"
    YAW_RATE_WHEELS = "yaw rate and wheel angle disagree"


class _Node(NamedTuple):
    """The integrals at one time: what each pair differs by since the start, and the way and turn that they share."""

    at_ns: int
    along_m: float
    """The way by position, signed."""
    forward_m: float
    lateral_m: float
    speed_mps: float
    heading_rad: float
    wheels_rad: float
    way_m: float
    turn_rad: float


class MotionCheck:
    """Integrates the accepted samples and compares each pair of sources. Time is that of the samples."""

    disagreement: LimitViolation | None
    """The present disagreement; None while all sources agree."""
    _disagreed_ns: int
    """The time of the last comparison that found a disagreement; set together with `disagreement`."""
    _due_ns: int
    """The time of the next comparison; set with each node, so with the first sample."""
    _moved: bool
    """Whether the position has changed since the newest node; set with it."""

    def __init__(
        self,
        limits: Plausibility,
        *,
        sources: MotionSources,
        wheelbase_m: float,
        gap_s: float,
        agree_s: float,
    ) -> None:
        """Samples more than `gap_s` apart say nothing about what lay between them.

        A disagreement ends once every pair has agreed for `agree_s`.
        """
        self._noise_m, self._noise_mps, self._noise_rad = (
            limits.position_tolerance_m,
            limits.speed_tolerance_mps,
            limits.heading_tolerance_rad,
        )
        self._slow_mps = limits.frozen_min_speed_mps
        self._sources, self._wheelbase_m = sources, wheelbase_m
        self._gap_s, self._agree_ns = gap_s, ns_from_s(agree_s)
        self.counts = dict.fromkeys((kind.value for kind in Disagreement), 0)
        """How often each disagreement began."""
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a lost link."""
        self.disagreement = None
        self._offsets_mps: tuple[float, ...] = ()
        self._previous: tuple[VehicleState, bool, float, float] | None = None
        """The sample before, whether its pose was valid, and the yaw rate and lateral speed that its wheels make."""
        self._along_m = self._forward_m = self._side_m = self._speed_mps = self._heading_rad = self._wheels_rad = 0.0
        self._way_m = self._turn_rad = 0.0
        self._windows: tuple[tuple[int, deque[_Node]], ...] = ((SHORT_WINDOW_NS, deque()), (LONG_WINDOW_NS, deque()))

    def update(self, state: VehicleState, *, pose_valid: bool) -> None:
        """Add the next accepted sample. Without a valid pose the position and the heading are not compared."""
        previous, sources = self._previous, self._sources
        speed_mps, rear_rad = state.speed_mps, state.rear_wheel_angle_rad
        wheels_radps = speed_mps * curvature_per_m(state.front_wheel_angle_rad, rear_rad, self._wheelbase_m)
        lateral_mps = state.lateral_speed_mps if sources.lateral_speed else speed_mps * math.tan(rear_rad)
        self._previous = state, pose_valid, wheels_radps, lateral_mps
        if previous is None:
            self._remember(state.stamp_ns)
            return
        before, was_valid, wheels_before_radps, lateral_before_mps = previous
        dt_s = (state.stamp_ns - before.stamp_ns) / NS_PER_S
        if not 0.0 < dt_s <= self._gap_s:
            return
        half_s = 0.5 * dt_s
        way_m = half_s * (before.speed_mps + speed_mps)
        wheels_rad = half_s * (wheels_before_radps + wheels_radps)
        turn_rad = half_s * (before.yaw_rate_radps + state.yaw_rate_radps) if sources.yaw_rate else wheels_rad
        if pose_valid and was_valid and state.frame_id == before.frame_id:
            turned_rad = wrapped_rad(state.heading_rad - before.heading_rad)
            middle_rad = before.heading_rad + 0.5 * turned_rad
            cos, sin = math.cos(middle_rad), math.sin(middle_rad)
            dx_m, dy_m = state.x_m - before.x_m, state.y_m - before.y_m
            along_m = dx_m * cos + dy_m * sin
            self._along_m += along_m
            self._forward_m += along_m - way_m
            self._side_m += dy_m * cos - dx_m * sin - half_s * (lateral_before_mps + lateral_mps)
            self._heading_rad += turned_rad - turn_rad
            if dx_m != 0.0 or dy_m != 0.0:
                self._moved = True
        if sources.accel:
            self._speed_mps += speed_mps - before.speed_mps - half_s * (before.accel_mps2 + state.accel_mps2)
        self._wheels_rad += turn_rad - wheels_rad
        self._way_m += abs(way_m)
        self._turn_rad += abs(turn_rad)
        at_ns = state.stamp_ns
        # Between two updates of a slow position sensor the position lags behind.
        if at_ns >= self._due_ns and (self._moved or abs(speed_mps) <= self._slow_mps):
            self._compare(state, at_ns)

    def limit_speed_mps(self, speed_mps: float) -> float:
        """The speed that limits go by: the greatest of speed signal, position and acceleration.

        `speed_mps` is the speed signal; the result has the sign of the greatest one.
        """
        if not self._offsets_mps:
            return speed_mps
        return max((speed_mps, *(speed_mps + offset_mps for offset_mps in self._offsets_mps)), key=abs)

    def is_backwards(self, speed_mps: float, gear: Gear | None) -> bool:
        """Which way the vehicle moves, or else would move: by the speed signal, or at standstill by the gear.

        `gear` is DRIVE or REVERSE where the direction is known in which the vehicle was driven last. While sources
        disagree the speed's sign may be what is wrong: then it is what most of speed signal, position and gear say, and
        of two that contradict each other what the gear says.
        """
        if self.disagreement is None:
            return speed_mps < 0.0 if abs(speed_mps) > STANDING_MPS else gear is Gear.REVERSE
        by_speed = _sign(speed_mps, STANDING_MPS)
        by_gear = _DIRECTION.get(gear, 0)
        _, short = self._windows[0]
        by_position = _sign(self._along_m - short[0].along_m, DIRECTION_NOISE_M)
        return (by_speed + by_position + by_gear or by_gear or by_speed) < 0

    def _remember(self, at_ns: int) -> None:
        node = _Node(
            at_ns,
            self._along_m,
            self._forward_m,
            self._side_m,
            self._speed_mps,
            self._heading_rad,
            self._wheels_rad,
            self._way_m,
            self._turn_rad,
        )
        for _, window in self._windows:
            window.append(node)
        self._due_ns, self._moved = at_ns + NODE_NS, False

    def _compare(self, state: VehicleState, at_ns: int) -> None:
        for length_ns, window in self._windows:
            while len(window) > 1 and window[1].at_ns <= at_ns - length_ns:
                window.popleft()
        (_, short), (_, long) = self._windows
        found = self._difference(short[0], at_ns) or self._difference(long[0], at_ns)
        self._offsets_mps = self._speed_offsets_mps(long[0], at_ns)
        self._remember(at_ns)
        if found is not None:
            self._disagreed_ns = at_ns
            if self.disagreement is None:
                self._begin(found, state)
        elif self.disagreement is not None and at_ns - self._disagreed_ns >= self._agree_ns:
            self.disagreement = None
            log.info("all sources of motion agree again")

    def _begin(self, found: LimitViolation, state: VehicleState) -> None:
        self.disagreement = found
        self.counts[found.kind.value] += 1
        log.warning("%s, at x_m = %.4g, y_m = %.4g", found, state.x_m, state.y_m)

    def _speed_offsets_mps(self, since: _Node, at_ns: int) -> tuple[float, ...]:
        """How far the speeds by position and by acceleration are from the speed signal, without what is noise."""
        window_s = max(at_ns - since.at_ns, SHORT_WINDOW_NS) / NS_PER_S
        by_position_mps = (self._forward_m - since.forward_m) / window_s
        by_accel_mps = since.speed_mps - self._speed_mps
        accel_noise_mps = self._noise_mps + ACCEL_DRIFT_MPS2 * window_s
        offsets_mps = _beyond(by_position_mps, POSITION_SPEED_NOISE_MPS), _beyond(by_accel_mps, accel_noise_mps)
        return tuple(filter(None, offsets_mps))

    def _difference(self, since: _Node, at_ns: int) -> LimitViolation | None:
        """The first pair that differs too much since that node."""
        window_s = (at_ns - since.at_ns) / NS_PER_S
        way_m, turn_rad = self._way_m - since.way_m, self._turn_rad - since.turn_rad
        sources = self._sources
        apart_m = abs(self._forward_m - since.forward_m)
        limit_m = self._noise_m + SPEED_DRIFT_MPS * window_s + SPEED_SHARE * way_m
        if apart_m > limit_m:
            return LimitViolation(Disagreement.POSITION_SPEED, "forward_m", apart_m, limit_m)
        apart_m = abs(self._side_m - since.lateral_m)
        limit_m = self._noise_m + SLIP_SHARE * way_m
        if apart_m > limit_m:
            return LimitViolation(Disagreement.POSITION_HEADING, "sideways_m", apart_m, limit_m)
        apart_mps = abs(self._speed_mps - since.speed_mps)
        limit_mps = self._noise_mps + ACCEL_DRIFT_MPS2 * window_s
        if apart_mps > limit_mps:
            return LimitViolation(Disagreement.SPEED_ACCELERATION, "speed_change_mps", apart_mps, limit_mps)
        by_wheels_rad = WHEEL_NOISE_RAD + WHEEL_OFFSET_RAD * way_m / self._wheelbase_m + UNDERSTEER_SHARE * turn_rad
        apart_rad = abs(self._heading_rad - since.heading_rad)
        limit_rad = self._noise_rad + YAW_RATE_DRIFT_RADPS * window_s + YAW_RATE_SHARE * turn_rad
        if not sources.yaw_rate:  # then the turn is that of the wheels
            limit_rad += by_wheels_rad
        if apart_rad > limit_rad and (sources.yaw_rate or sources.front_wheels):
            return LimitViolation(Disagreement.HEADING_YAW_RATE, "turned_rad", apart_rad, limit_rad)
        apart_rad = abs(self._wheels_rad - since.wheels_rad)
        if apart_rad > by_wheels_rad and sources.front_wheels:
            return LimitViolation(Disagreement.YAW_RATE_WHEELS, "turned_rad", apart_rad, by_wheels_rad)
        return None


def _sign(value: float, noise: float) -> int:
    return (value > noise) - (value < -noise)


def _beyond(value: float, noise: float) -> float:
    """The part of a value beyond its noise."""
    return math.copysign(max(0.0, abs(value) - noise), value)
