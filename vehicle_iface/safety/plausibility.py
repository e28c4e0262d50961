"""Whether a sample can be true: checked before anything is computed from it."""

import logging
import math
from dataclasses import dataclass
from enum import Enum

from vehicle_iface.profile import Plausibility
from vehicle_iface.safety.excess import Excess
from vehicle_iface.safety.lateral import curvature_per_m
from vehicle_iface.state import VehicleState
from vehicle_iface.units import NS_PER_S, s_from_ns, wrapped_rad

log = logging.getLogger(__name__)

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


@dataclass(slots=True)
class _Place:
    """A sample with a valid pose, and the fastest since then."""

    state: VehicleState
    fastest_mps: float
    fastest_radps: float


class _Story:
    """The newest of some samples, and the newest with a valid pose in each frame of reference.

    So one without a valid pose, or in another frame, does not make any place that comes next a believed one.
    """

    def __init__(self) -> None:
        self.newest: VehicleState | None = None
        self.places: dict[str, _Place] = {}

    def add(self, state: VehicleState, *, pose_valid: bool) -> None:
        speed_mps, rate_radps = abs(state.speed_mps), abs(state.yaw_rate_radps)
        for place in self.places.values():
            place.fastest_mps = max(place.fastest_mps, speed_mps)
            place.fastest_radps = max(place.fastest_radps, rate_radps)
        if pose_valid:
            self.places[state.frame_id] = _Place(state, speed_mps, rate_radps)
        self.newest = state


class PlausibilityCheck:
    """Compares each sample with those that were believed."""

    def __init__(self, limits: Plausibility, *, wheelbase_m: float) -> None:
        self._limits, self._wheelbase_m = limits, wheelbase_m
        self._believed = _Story()
        self._doubted = _Story()
        self._agreeing = 0
        self._stands: VehicleState | None = None
        """The newest sample with the position of the one before it …"""
        self._way_nm, self._fast_ns = 0.0, 0
        """… and how far, and how long fast, the vehicle went by its speeds since the position changed."""
        self._in_a_row = 0
        self._newest_ns: int | None = None
        self._doubted_ns = 0
        self.found = dict.fromkeys((doubt.value for doubt in Doubt), 0)
        """How often each was the reason to drop a sample."""

    def persists(self, *, since_ns: int) -> bool:
        """Whether sample after sample is implausible, and the last of them is not from before `since_ns`."""
        return self._in_a_row >= PERSISTS and self._doubted_ns >= since_ns

    def believes(self, state: VehicleState, *, pose_valid: bool) -> bool:
        """Whether this sample is to be used. Without a valid pose, positions and headings are not looked at."""
        if self._newest_ns is not None and s_from_ns(state.stamp_ns - self._newest_ns) > FORGOTTEN_S:
            self.forget()
        if self._newest_ns is None or state.stamp_ns > self._newest_ns:
            self._newest_ns = state.stamp_ns
        doubt = self._doubt(state, self._believed, pose_valid=pose_valid)
        if doubt is not None and doubt.kind in (Doubt.JUMP, Doubt.FROZEN) and self._agree(state, pose_valid=pose_valid):
            self._believed, doubt = _Story(), None
        if doubt is not None:
            self._note(doubt, state, pose_valid=pose_valid)
            return False
        self._in_a_row = self._agreeing = 0
        self._believed.add(state, pose_valid=pose_valid)
        return True

    def forget(self) -> None:
        """Start anew, as after the link was lost."""
        self._believed = _Story()
        self._stands = None
        self._in_a_row = self._agreeing = 0

    def _note(self, doubt: Excess, state: VehicleState, *, pose_valid: bool) -> None:
        self.found[doubt.kind.value] += 1
        self._in_a_row += 1
        if self._in_a_row == PERSISTS:
            place = f"x_m = {state.x_m:.4g}, y_m = {state.y_m:.4g}"
            log.warning("%d implausible samples in a row; the last one, at %s: %s", PERSISTS, place, doubt)
        self._doubted.add(state, pose_valid=pose_valid)
        self._doubted_ns = state.stamp_ns

    def _agree(self, state: VehicleState, *, pose_valid: bool) -> bool:
        """Whether enough samples have told the same story by now."""
        agrees = self._in_a_row > 0 and self._doubt(state, self._doubted, pose_valid=pose_valid) is None
        self._agreeing = self._agreeing + 1 if agrees else 0
        return self._agreeing >= BELIEVED_AGAIN

    def _doubt(self, state: VehicleState, story: _Story, *, pose_valid: bool) -> Excess | None:
        limits, before = self._limits, story.newest
        for name in ("speed_mps", "accel_mps2", "yaw_rate_radps"):
            value, limit = abs(getattr(state, name)), getattr(limits, name)
            if value > limit:
                return Excess(Doubt.RANGE, name, value, limit)
        curvature = curvature_per_m(state.front_wheel_angle_rad, state.rear_wheel_angle_rad, self._wheelbase_m)
        by_wheels_radps = state.speed_mps * curvature
        apart_radps = abs(state.yaw_rate_radps - by_wheels_radps)
        if apart_radps > limits.yaw_rate_apart_radps:
            return Excess(Doubt.DISAGREEMENT, "yaw_rate_apart_radps", apart_radps, limits.yaw_rate_apart_radps)
        if before is None:
            return None
        dt_s = s_from_ns(state.stamp_ns - before.stamp_ns)
        if dt_s < 0.0:
            return Excess(Doubt.ORDER, "older_s", -dt_s, 0.0)
        changed_mps = abs(state.speed_mps - before.speed_mps)
        most_mps = limits.accel_mps2 * dt_s + limits.speed_apart_mps
        if changed_mps > most_mps:
            return Excess(Doubt.JUMP, "speed_change_mps", changed_mps, most_mps)
        place = story.places.get(state.frame_id)
        return self._doubt_of_pose(state, place) if pose_valid and place is not None else None

    def _doubt_of_pose(self, state: VehicleState, place: _Place) -> Excess | None:
        limits, before = self._limits, place.state
        dt_s = s_from_ns(state.stamp_ns - before.stamp_ns)
        moved_m = math.hypot(state.x_m - before.x_m, state.y_m - before.y_m)
        farthest_m = max(abs(state.speed_mps), place.fastest_mps) * dt_s + limits.position_apart_m
        if moved_m > farthest_m:
            return Excess(Doubt.JUMP, "moved_m", moved_m, farthest_m)
        turned_rad = abs(wrapped_rad(state.heading_rad - before.heading_rad))
        most_rad = max(abs(state.yaw_rate_radps), place.fastest_radps) * dt_s + limits.heading_apart_rad
        if turned_rad > most_rad:
            return Excess(Doubt.JUMP, "turned_rad", turned_rad, most_rad)
        return self._frozen(state)

    def _frozen(self, state: VehicleState) -> Excess | None:
        """When the vehicle should have come further by its speeds since its position last changed."""
        since, limits = self._stands, self._limits
        if since is None or (state.x_m, state.y_m) != (since.x_m, since.y_m) or state.frame_id != since.frame_id:
            self._stands, self._way_nm, self._fast_ns = state, 0.0, 0
            return None
        dt_ns, speed_mps = state.stamp_ns - since.stamp_ns, abs(state.speed_mps)
        self._stands = state
        self._way_nm += speed_mps * dt_ns if speed_mps > STANDING_MPS else 0.0
        self._fast_ns = self._fast_ns + dt_ns if speed_mps > limits.frozen_above_mps else 0
        if s_from_ns(self._fast_ns) >= limits.frozen_s:
            return Excess(Doubt.FROZEN, "still_s", s_from_ns(self._fast_ns), limits.frozen_s)
        if self._way_nm > limits.frozen_m * NS_PER_S:
            return Excess(Doubt.FROZEN, "still_m", self._way_nm / NS_PER_S, limits.frozen_m)
        return None
