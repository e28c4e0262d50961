"""Deviation of the vehicle from its path: distance, heading, speed and direction."""

import logging
import math
from collections.abc import Iterator
from enum import Enum

from vehicle_iface.profile import Deviation
from vehicle_iface.safety.limits import LimitViolation
from vehicle_iface.safety.path_distance import Boxes, PathLocator, PathPlace, compute_boxes
from vehicle_iface.standstill import STANDING_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import FloatArray, Trajectory

log = logging.getLogger(__name__)


class DeviationKind(Enum):
    """Kinds of deviation; all but the first stop the vehicle."""

    BESIDE = "beside the path"
    """Further from it than the warning, to the side or along it; the vehicle may still come back."""
    OFF_PATH = "off the path"
    HEADING = "heading away from the path"
    OVERSPEED = "faster than the vehicle may go"
    ROLLING_BACK = "rolling against the direction of travel"


class DeviationMonitor:
    """Compares each state with the trajectory.

    The distance is the distance to the path, along it as well as beside it (see `path_distance`). The heading is
    compared with the path's there. The whole path is searched before a stop is begun.

    A deviation that stops holds until the vehicle stands and has another trajectory. That alone is no reason to drive
    on: a planner makes one ten times a second.
    """

    def __init__(self, limits: Deviation, *, speed_max_mps: float) -> None:
        self._limits = limits
        self._greatest_mps = speed_max_mps + limits.overspeed_mps
        self._path: PathLocator | None = None
        self._boxes: Boxes
        self._boxes_of: FloatArray | None = None
        """The locked array `x_m` of the trajectory that they belong to."""
        self._left: Trajectory | None = None
        """The one that the vehicle was last found off, while that stops it."""
        self.counts = dict.fromkeys((finding.value for finding in DeviationKind), 0)
        """How often each was seen."""

    def prepare(self, trajectory: Trajectory) -> Iterator[None]:
        """Compute, in pieces, what a search of this trajectory's whole path needs."""
        boxes = yield from compute_boxes(trajectory.x_m, trajectory.y_m)
        self._boxes, self._boxes_of = boxes, trajectory.x_m

    def update(
        self,
        state: VehicleState,
        trajectory: Trajectory,
        index: int,
        direction_mps: float,
        *,
        greatest_mps: float | None = None,
    ) -> bool:
        """Compare this state; whether the vehicle has to be stopped.

        `trajectory` is in the state's frame and has points. `index` is the point of it that the controller has the
        vehicle past: the place where it is looked for first, and no more. The sign of `direction_mps` is the direction
        of travel that is wanted, 0 for none. `greatest_mps` is the greatest speed of all sources, without sign;
        the speed signal's by default.
        """
        if greatest_mps is None:
            greatest_mps = abs(state.speed_mps)
        path = self._path
        if path is None or path.trajectory is not trajectory:
            boxes = self._boxes if trajectory.x_m is self._boxes_of else None
            path = self._path = PathLocator(trajectory, self._limits, index=index, boxes=boxes)
        speed_mps = state.speed_mps
        is_near = path.is_near(index, state.x_m, state.y_m, state.heading_rad)
        if is_near and self._left is None and greatest_mps <= self._greatest_mps and speed_mps * direction_mps >= 0.0:
            return False  # what a call at the loop's rate nearly always finds
        findings = [] if is_near else self._off_path(path.locate(state, may_begin_stop=self._left is None))
        findings += self._too_fast(greatest_mps, speed_mps, direction_mps)
        for finding in findings:
            self.counts[finding.kind.value] += 1
        stopping = [finding for finding in findings if finding.kind is not DeviationKind.BESIDE]
        if stopping:
            if self._left is None:
                log.warning("deviation at point %d: %s", path.segment, "; ".join(map(str, stopping)))
            self._left = trajectory
        elif trajectory is not self._left and abs(speed_mps) <= STANDING_MPS:
            self._left = None
        return self._left is not None

    def reset(self) -> None:
        """Clear an earlier deviation: from now on the vehicle is driven."""
        self._left = None

    def _off_path(self, place: PathPlace) -> list[LimitViolation]:
        limits, found = self._limits, []
        if place.distance_m > limits.lateral_stop_m:
            found.append(LimitViolation(DeviationKind.OFF_PATH, "distance_m", place.distance_m, limits.lateral_stop_m))
        elif place.distance_m > limits.lateral_warn_m:
            found.append(LimitViolation(DeviationKind.BESIDE, "distance_m", place.distance_m, limits.lateral_warn_m))
        if place.heading_error_rad > limits.heading_stop_rad:
            found.append(
                LimitViolation(DeviationKind.HEADING, "heading_rad", place.heading_error_rad, limits.heading_stop_rad)
            )
        return found

    def _too_fast(self, greatest_mps: float, speed_mps: float, direction_mps: float) -> list[LimitViolation]:
        """Faster than the vehicle may go, and in the wrong direction."""
        found = []
        if greatest_mps > self._greatest_mps:
            found.append(LimitViolation(DeviationKind.OVERSPEED, "speed_mps", greatest_mps, self._greatest_mps))
        back_mps = -speed_mps * math.copysign(1.0, direction_mps)
        if back_mps > self._limits.rollback_mps and direction_mps != 0.0:
            found.append(
                LimitViolation(DeviationKind.ROLLING_BACK, "rollback_mps", back_mps, self._limits.rollback_mps)
            )
        return found
