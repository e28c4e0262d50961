"""Whether the vehicle does what it is told: on the path, along it, and not faster than it may go."""

import logging
import math
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from vehicle_iface.profile import Deviation
from vehicle_iface.safety.excess import Excess
from vehicle_iface.safety.plausibility import STANDING_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import wrapped_rad

log = logging.getLogger(__name__)


class Finding(Enum):
    """What is wrong; each but the first stops the vehicle."""

    BESIDE = "beside the path"
    """Further than the warning; it may still come back."""
    OFF_PATH = "off the path"
    HEADING = "heading away from the path"
    OVERSPEED = "faster than the vehicle may go"
    ROLLING_BACK = "rolling against the direction of travel"


class _Path(NamedTuple):
    trajectory: Trajectory
    xs_m: Sequence[float]
    ys_m: Sequence[float]
    headings_rad: Sequence[float]


class DeviationMonitor:
    """Compares each state with the trajectory.

    A deviation that stops holds until the vehicle stands and has another trajectory. That alone is no reason to drive
    on: a planner makes one ten times a second.
    """

    def __init__(self, limits: Deviation, *, speed_max_mps: float) -> None:
        self._limits = limits
        self._greatest_mps = speed_max_mps + limits.overspeed_mps
        self._path: _Path | None = None
        self._left: Trajectory | None = None
        """The one that the vehicle was last found off, while that stops it."""
        self.found = dict.fromkeys((finding.value for finding in Finding), 0)
        """How often each was seen."""

    def stops(self, state: VehicleState, trajectory: Trajectory, index: int, direction_mps: float) -> bool:
        """Whether the vehicle has to be stopped.

        `trajectory` is in the state's frame and has points, the vehicle is past point `index` of it; the sign of
        `direction_mps` is the direction of travel that is wanted, 0 for none.
        """
        if self._path is None or self._path.trajectory is not trajectory:
            views = (memoryview(array) for array in (trajectory.x_m, trajectory.y_m, trajectory.heading_rad))  # type: ignore[arg-type]
            self._path = _Path(trajectory, *views)
        findings = self._findings(state, self._path, index, direction_mps)
        for finding in findings:
            self.found[finding.kind.value] += 1
        stopping = [finding for finding in findings if finding.kind is not Finding.BESIDE]
        if stopping:
            if self._left is None:
                log.warning("deviation at point %d: %s", index, "; ".join(map(str, stopping)))
            self._left = trajectory
        elif trajectory is not self._left and abs(state.speed_mps) <= STANDING_MPS:
            self._left = None
        return self._left is not None

    def forget(self) -> None:
        """Start anew: from now on the vehicle is driven."""
        self._left = None

    def _findings(self, state: VehicleState, path: _Path, index: int, direction_mps: float) -> list[Excess]:
        limits, found = self._limits, []
        following = min(index + 1, len(path.xs_m) - 1)
        lateral_m = _distance_m(state, path, index, following)
        if lateral_m > limits.lateral_stop_m:
            found.append(Excess(Finding.OFF_PATH, "lateral_m", lateral_m, limits.lateral_stop_m))
        elif lateral_m > limits.lateral_warn_m:
            found.append(Excess(Finding.BESIDE, "lateral_m", lateral_m, limits.lateral_warn_m))
        # Between two points the heading is that of either: a path that is drawn coarsely turns in its points.
        off_rad = min(abs(wrapped_rad(state.heading_rad - path.headings_rad[i])) for i in (index, following))
        if off_rad > limits.heading_stop_rad:
            found.append(Excess(Finding.HEADING, "heading_rad", off_rad, limits.heading_stop_rad))
        if abs(state.speed_mps) > self._greatest_mps:
            found.append(Excess(Finding.OVERSPEED, "speed_mps", abs(state.speed_mps), self._greatest_mps))
        back_mps = -state.speed_mps * math.copysign(1.0, direction_mps)
        if back_mps > limits.rollback_mps and direction_mps != 0.0:
            found.append(Excess(Finding.ROLLING_BACK, "rollback_mps", back_mps, limits.rollback_mps))
        return found


def _distance_m(state: VehicleState, path: _Path, index: int, following: int) -> float:
    """From the line through a point and the next one, across it; at the last point, across its heading.

    Beyond the ends of the line, as on the way to the first point, what is along it does not count.
    """
    dx_m, dy_m = state.x_m - path.xs_m[index], state.y_m - path.ys_m[index]
    ex_m, ey_m = path.xs_m[following] - path.xs_m[index], path.ys_m[following] - path.ys_m[index]
    length_m = math.hypot(ex_m, ey_m)
    if length_m < 1e-6:  # the last point, or two at one place
        ex_m, ey_m, length_m = math.cos(path.headings_rad[index]), math.sin(path.headings_rad[index]), 1.0
    return abs(ex_m * dy_m - ey_m * dx_m) / length_m
