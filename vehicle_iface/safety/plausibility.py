"""Whether a sample can be true: checked before anything is computed from it."""

import math
from enum import Enum

from vehicle_iface.profile import Plausibility
from vehicle_iface.safety.lateral import curvature_per_m
from vehicle_iface.state import VehicleState
from vehicle_iface.units import NS_PER_S, s_from_ns, wrapped_rad

PERSISTS = 3
"""Implausible samples in a row: it is no glitch."""
BELIEVED_AGAIN = 100
"""Samples in a row that agree with one another, though not with what was before: the vehicle is where they say."""
FORGOTTEN_S = 0.5
"""After a longer gap between samples nothing is known of what the vehicle did meanwhile."""
STANDING_MPS = 0.05
"""Up to here a speed may be a sensor's offset at rest, and makes no way."""


class Doubt(Enum):
    """What is wrong with a sample."""

    RANGE = "out of range"
    """A value that this vehicle cannot have."""
    JUMP = "jumped"
    """Further, faster or further round than speed, acceleration and yaw rate allow since the last sample."""
    FROZEN = "frozen"
    """The position stands still while the speed says that the vehicle moves; the counters live."""
    DISAGREEMENT = "disagree"
    """The yaw rate is not what speed and front wheels make."""
    ORDER = "out of order"
    """Older than the newest."""


class PlausibilityCheck:
    """Compares each sample with the last one that was believed."""

    def __init__(self, limits: Plausibility, *, wheelbase_m: float) -> None:
        self._limits, self._wheelbase_m = limits, wheelbase_m
        self._believed: VehicleState | None = None
        self._doubted: VehicleState | None = None
        self._agreeing = 0
        self._stands: VehicleState | None = None
        """The newest sample with the position of the one before it …"""
        self._way_nm, self._fast_ns = 0.0, 0
        """… and how far, and how long fast, the vehicle went by its speeds since the position changed."""
        self._in_a_row = 0
        self._newest_ns: int | None = None
        self.found = dict.fromkeys((doubt.value for doubt in Doubt), 0)
        """How often each was the reason to drop a sample."""

    @property
    def persists(self) -> bool:
        """Whether sample after sample is implausible."""
        return self._in_a_row >= PERSISTS

    def believes(self, state: VehicleState, *, pose_valid: bool) -> bool:
        """Whether this sample is to be used. Without a valid pose, positions and headings are not looked at."""
        if self._newest_ns is not None and s_from_ns(state.stamp_ns - self._newest_ns) > FORGOTTEN_S:
            self.forget()
        if self._newest_ns is None or state.stamp_ns > self._newest_ns:
            self._newest_ns = state.stamp_ns
        doubt = self._doubt(state, self._believed, pose_valid=pose_valid)
        if doubt in (Doubt.JUMP, Doubt.FROZEN) and self._agree(state, pose_valid=pose_valid):
            doubt = None
        if doubt is not None:
            self.found[doubt.value] += 1
            self._in_a_row += 1
            self._doubted = state
            return False
        self._in_a_row = self._agreeing = 0
        self._believed, self._doubted = state, None
        return True

    def forget(self) -> None:
        """Start anew, as after the link was lost."""
        self._believed = self._doubted = self._stands = None
        self._in_a_row = self._agreeing = 0

    def _agree(self, state: VehicleState, *, pose_valid: bool) -> bool:
        """Whether enough samples have told the same story by now."""
        agrees = self._doubted is not None and self._doubt(state, self._doubted, pose_valid=pose_valid) is None
        self._agreeing = self._agreeing + 1 if agrees else 0
        return self._agreeing >= BELIEVED_AGAIN

    def _doubt(self, state: VehicleState, before: VehicleState | None, *, pose_valid: bool) -> Doubt | None:
        limits = self._limits
        if abs(state.speed_mps) > limits.speed_mps or abs(state.accel_mps2) > limits.accel_mps2:
            return Doubt.RANGE
        if abs(state.yaw_rate_radps) > limits.yaw_rate_radps:
            return Doubt.RANGE
        curvature = curvature_per_m(state.front_wheel_angle_rad, state.rear_wheel_angle_rad, self._wheelbase_m)
        by_wheels_radps = state.speed_mps * curvature
        if abs(state.yaw_rate_radps - by_wheels_radps) > limits.yaw_rate_apart_radps:
            return Doubt.DISAGREEMENT
        if before is None:
            return None
        dt_s = s_from_ns(state.stamp_ns - before.stamp_ns)
        if dt_s < 0.0:
            return Doubt.ORDER
        if before.frame_id != state.frame_id:
            return None
        if abs(state.speed_mps - before.speed_mps) > limits.accel_mps2 * dt_s + limits.speed_apart_mps:
            return Doubt.JUMP
        if not pose_valid:
            return None
        return self._doubt_of_pose(state, before, dt_s)

    def _doubt_of_pose(self, state: VehicleState, before: VehicleState, dt_s: float) -> Doubt | None:
        limits = self._limits
        moved_m = math.hypot(state.x_m - before.x_m, state.y_m - before.y_m)
        fastest_mps = max(abs(state.speed_mps), abs(before.speed_mps))
        if moved_m > fastest_mps * dt_s + limits.position_apart_m:
            return Doubt.JUMP
        turned_rad = abs(wrapped_rad(state.heading_rad - before.heading_rad))
        fastest_radps = max(abs(state.yaw_rate_radps), abs(before.yaw_rate_radps))
        if turned_rad > fastest_radps * dt_s + limits.heading_apart_rad:
            return Doubt.JUMP
        return Doubt.FROZEN if self._is_frozen(state) else None

    def _is_frozen(self, state: VehicleState) -> bool:
        """Whether the vehicle should have come further by its speeds since its position last changed."""
        since, limits = self._stands, self._limits
        if since is None or (state.x_m, state.y_m) != (since.x_m, since.y_m) or state.frame_id != since.frame_id:
            self._stands, self._way_nm, self._fast_ns = state, 0.0, 0
            return False
        dt_ns, speed_mps = state.stamp_ns - since.stamp_ns, abs(state.speed_mps)
        self._stands = state
        self._way_nm += speed_mps * dt_ns if speed_mps > STANDING_MPS else 0.0
        self._fast_ns = self._fast_ns + dt_ns if speed_mps > limits.frozen_above_mps else 0
        return s_from_ns(self._fast_ns) >= limits.frozen_s or self._way_nm > limits.frozen_m * NS_PER_S
