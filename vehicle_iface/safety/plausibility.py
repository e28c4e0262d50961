"""Plausibility of a sample, checked before anything is computed from it."""

import logging
import math
from dataclasses import dataclass
from enum import Enum

from vehicle_iface.profile import Plausibility
from vehicle_iface.safety.lateral import curvature_per_m
from vehicle_iface.safety.limits import LimitViolation
from vehicle_iface.standstill import STANDING_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.units import NS_PER_MS, NS_PER_S, s_from_ns, wrapped_rad

log = logging.getLogger(__name__)

PERSISTS = 3
"""Implausible samples in a row: it is no glitch."""
BAD_POINTS, PERSISTS_POINTS = 4, 9
"""An implausible sample adds points, a plausible one takes one off: three in a row persist, and so does one in four."""
ACCEPTED_AGAIN = 100
"""Samples in a row that agree with one another, though not with those before: then they are accepted."""
FORGOTTEN_S = 0.5
"""After a longer gap between samples nothing is known of what the vehicle did meanwhile."""
GROWS_S = 0.05
"""While samples are dropped, the speed may differ from the last one accepted by what this time allows."""
STRAY_SHARE = 0.15
"""While samples are dropped, the vehicle may have strayed from straight on by this share of its way."""
RESTED_NS = 500 * NS_PER_MS
"""After so long at a speed of 0 a position that stands is right, whatever the speed was before."""


class PlausibilityFault(Enum):
    """Why a sample is implausible."""

    RANGE = "out of range"
    """A value that this vehicle cannot have."""
    JUMP = "jumped"
    """Further, faster or further round than speed, acceleration and yaw rate allow since the last sample."""
    FROZEN = "frozen"
    """The position stands still while the speed is that of a moving vehicle; the counters go on."""
    DISAGREEMENT = "disagree"
    """The yaw rate is not what speed and front wheels make."""
    ORDER = "out of order"
    """Older than the newest."""


@dataclass(slots=True)
class _Anchor:
    """A sample with a valid pose, and the fastest since then."""

    state: VehicleState
    fastest_mps: float
    fastest_radps: float


class _History:
    """The newest of some samples, and the newest with a valid pose in each frame of reference.

    So one without a valid pose, or in another frame, does not make any place that comes next an accepted one.
    """

    def __init__(self) -> None:
        self.newest: VehicleState | None = None
        self.anchors: dict[str, _Anchor] = {}

    def add(self, state: VehicleState, *, pose_valid: bool) -> None:
        self.newest, frame_id = state, state.frame_id
        speed_mps, rate_radps = abs(state.speed_mps), abs(state.yaw_rate_radps)
        here = self.anchors.get(frame_id) if pose_valid else None
        for anchor in self.anchors.values():
            if anchor is not here:
                anchor.fastest_mps = max(anchor.fastest_mps, speed_mps)
                anchor.fastest_radps = max(anchor.fastest_radps, rate_radps)
        if here is not None:
            here.state, here.fastest_mps, here.fastest_radps = state, speed_mps, rate_radps
        elif pose_valid:
            self.anchors[frame_id] = _Anchor(state, speed_mps, rate_radps)


class PlausibilityCheck:
    """Compares each sample with those that were accepted."""

    def __init__(self, limits: Plausibility, *, wheelbase_m: float) -> None:
        self._limits, self._wheelbase_m = limits, wheelbase_m
        self._accepted = _History()
        self._rejected = _History()
        self._agreeing = 0
        self._stands: VehicleState | None = None
        """The newest sample with the position of the one before it …"""
        self._distance_nm, self._fast_ns = 0.0, 0
        """… and how far, and how long fast, the vehicle went by its speeds since the position changed."""
        self._rest_ns: int
        """For how long its speed has been that of a standing vehicle."""
        self._in_a_row = self._points = 0
        self._newest_ns: int | None = None
        self._rejected_ns = 0
        self.counts = dict.fromkeys((fault.value for fault in PlausibilityFault), 0)
        """How often each was the reason to drop a sample."""

    def is_persistent(self, *, since_ns: int) -> bool:
        """Whether too many samples are implausible, and the last of them is not from before `since_ns`."""
        return self._points >= PERSISTS_POINTS and self._rejected_ns >= since_ns

    def is_plausible(self, state: VehicleState, *, pose_valid: bool) -> bool:
        """Whether this sample is to be used. Without a valid pose, positions and headings are not looked at."""
        if self._newest_ns is not None and s_from_ns(state.stamp_ns - self._newest_ns) > FORGOTTEN_S:
            self.reset()
        if self._newest_ns is None or state.stamp_ns > self._newest_ns:
            self._newest_ns = state.stamp_ns
        fault = self._find_fault(state, self._accepted, pose_valid=pose_valid)
        if (
            fault is not None
            and fault.kind in (PlausibilityFault.JUMP, PlausibilityFault.FROZEN)
            and self._is_confirmed(state, pose_valid=pose_valid)
        ):
            self._accepted, fault, self._points = _History(), None, 0
        if fault is not None:
            self._record(fault, state, pose_valid=pose_valid)
            return False
        self._in_a_row = self._agreeing = 0
        self._points -= self._points > 0
        self._accepted.add(state, pose_valid=pose_valid)
        return True

    def reset(self) -> None:
        """Reset the history, as after a loss of the link."""
        self._accepted = _History()
        self._stands = None
        self._in_a_row = self._agreeing = self._points = 0

    def _record(self, fault: LimitViolation, state: VehicleState, *, pose_valid: bool) -> None:
        self.counts[fault.kind.value] += 1
        self._in_a_row += 1
        self._points = min(self._points + BAD_POINTS, PERSISTS * BAD_POINTS)
        if self._in_a_row == PERSISTS:
            place = f"x_m = {state.x_m:.4g}, y_m = {state.y_m:.4g}"
            log.warning("%d implausible samples in a row; the last one, at %s: %s", PERSISTS, place, fault)
        self._rejected.add(state, pose_valid=pose_valid)
        self._rejected_ns = state.stamp_ns

    def _is_confirmed(self, state: VehicleState, *, pose_valid: bool) -> bool:
        """Whether enough samples have agreed with one another by now."""
        agrees = self._in_a_row > 0 and self._find_fault(state, self._rejected, pose_valid=pose_valid) is None
        self._agreeing = self._agreeing + 1 if agrees else 0
        return self._agreeing >= ACCEPTED_AGAIN

    def _find_fault(self, state: VehicleState, history: _History, *, pose_valid: bool) -> LimitViolation | None:
        limits, before = self._limits, history.newest
        speed_mps, yaw_radps = state.speed_mps, state.yaw_rate_radps
        if abs(speed_mps) > limits.speed_mps:
            return LimitViolation(PlausibilityFault.RANGE, "speed_mps", abs(speed_mps), limits.speed_mps)
        if abs(state.accel_mps2) > limits.accel_mps2:
            return LimitViolation(PlausibilityFault.RANGE, "accel_mps2", abs(state.accel_mps2), limits.accel_mps2)
        if abs(yaw_radps) > limits.yaw_rate_radps:
            return LimitViolation(PlausibilityFault.RANGE, "yaw_rate_radps", abs(yaw_radps), limits.yaw_rate_radps)
        curvature = curvature_per_m(state.front_wheel_angle_rad, state.rear_wheel_angle_rad, self._wheelbase_m)
        apart_radps = abs(yaw_radps - speed_mps * curvature)
        if apart_radps > limits.yaw_rate_tolerance_radps:
            return LimitViolation(
                PlausibilityFault.DISAGREEMENT,
                "yaw_rate_difference_radps",
                apart_radps,
                limits.yaw_rate_tolerance_radps,
            )
        if before is None:
            return None
        dt_s = (state.stamp_ns - before.stamp_ns) / NS_PER_S
        if dt_s < 0.0:
            return LimitViolation(PlausibilityFault.ORDER, "older_s", -dt_s, 0.0)
        changed_mps = abs(speed_mps - before.speed_mps)
        # The longer samples are dropped, the more a change of speed could be true. It is not waited for.
        grows_s = min(dt_s, GROWS_S) if self._in_a_row else dt_s
        most_mps = limits.accel_mps2 * grows_s + limits.speed_tolerance_mps
        if changed_mps > most_mps:
            return LimitViolation(PlausibilityFault.JUMP, "speed_change_mps", changed_mps, most_mps)
        anchor = history.anchors.get(state.frame_id)
        return self._find_pose_fault(state, anchor) if pose_valid and anchor is not None else None

    def _find_pose_fault(self, state: VehicleState, anchor: _Anchor) -> LimitViolation | None:
        limits, before = self._limits, anchor.state
        dt_s = (state.stamp_ns - before.stamp_ns) / NS_PER_S
        moved_m = math.hypot(state.x_m - before.x_m, state.y_m - before.y_m)
        fastest_mps, fastest_radps = abs(state.speed_mps), abs(state.yaw_rate_radps)
        if fastest_mps < anchor.fastest_mps:
            fastest_mps = anchor.fastest_mps
        if fastest_radps < anchor.fastest_radps:
            fastest_radps = anchor.fastest_radps
        distance_m = fastest_mps * dt_s
        if moved_m > distance_m + limits.position_tolerance_m:
            return LimitViolation(PlausibilityFault.JUMP, "moved_m", moved_m, distance_m + limits.position_tolerance_m)
        turned_rad = abs(wrapped_rad(state.heading_rad - before.heading_rad))
        most_rad = fastest_radps * dt_s + limits.heading_tolerance_rad
        if turned_rad > most_rad:
            return LimitViolation(PlausibilityFault.JUMP, "turned_rad", turned_rad, most_rad)
        frozen = self._find_freeze(state)
        if frozen is not None or not self._in_a_row or anchor is not self._accepted.anchors.get(state.frame_id):
            return frozen
        # The longer samples are dropped, the more places could have been reached. They are not waited for.
        ahead_m = before.speed_mps * dt_s
        dx_m = state.x_m - before.x_m - ahead_m * math.cos(before.heading_rad)
        dy_m = state.y_m - before.y_m - ahead_m * math.sin(before.heading_rad)
        strayed_m, most_m = math.hypot(dx_m, dy_m), STRAY_SHARE * distance_m + limits.position_tolerance_m
        return LimitViolation(PlausibilityFault.JUMP, "strayed_m", strayed_m, most_m) if strayed_m > most_m else None

    def _find_freeze(self, state: VehicleState) -> LimitViolation | None:
        """When the vehicle should have come further by its speeds since its position last changed."""
        since, limits = self._stands, self._limits
        if since is None or (state.x_m, state.y_m) != (since.x_m, since.y_m) or state.frame_id != since.frame_id:
            self._stands, self._distance_nm, self._fast_ns, self._rest_ns = state, 0.0, 0, 0
            return None
        dt_ns, speed_mps = state.stamp_ns - since.stamp_ns, abs(state.speed_mps)
        self._stands = state
        is_at_rest = speed_mps <= STANDING_MPS
        self._rest_ns = self._rest_ns + dt_ns if is_at_rest else 0
        if self._rest_ns >= RESTED_NS:  # by now the speed says the same as the position
            self._distance_nm = 0.0
        elif not is_at_rest:
            self._distance_nm += speed_mps * dt_ns
        self._fast_ns = self._fast_ns + dt_ns if speed_mps > limits.frozen_min_speed_mps else 0
        if s_from_ns(self._fast_ns) >= limits.frozen_time_s:
            return LimitViolation(PlausibilityFault.FROZEN, "still_s", s_from_ns(self._fast_ns), limits.frozen_time_s)
        if self._distance_nm > limits.frozen_distance_m * NS_PER_S:
            return LimitViolation(
                PlausibilityFault.FROZEN, "still_m", self._distance_nm / NS_PER_S, limits.frozen_distance_m
            )
        return None
