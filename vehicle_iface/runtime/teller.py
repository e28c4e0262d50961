"""What leaves the loop by the one-way door: a snapshot per sample, the trajectory, the counters."""

import logging
from collections.abc import Callable
from typing import Any

from vehicle_iface import checks
from vehicle_iface.control.base import ControllerBase
from vehicle_iface.control.tracking import plain_values, turned_back
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.runtime.pilot import Answer
from vehicle_iface.runtime.rate import Grid
from vehicle_iface.runtime.telemetry import Snapshot, TelemetryWriter
from vehicle_iface.state import VehicleState
from vehicle_iface.status import ControllerState, Gear, VehicleStatus
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import NS_PER_MS, wrapped_rad

log = logging.getLogger(__name__)

QUIET_NS = 100 * NS_PER_MS
"""Without samples a snapshot is published this often, so that a viewer sees the loop alive."""
DETAILS_NS = 500 * NS_PER_MS


def _unknown(first: str, last: str) -> tuple[Any, ...]:
    """What a snapshot says in a group of fields of which nothing is known."""
    names = Snapshot._fields
    group = names[names.index(first) : names.index(last) + 1]
    return tuple(Snapshot._field_defaults[name] for name in group)


# The groups of a snapshot, in its order: it is a plain tuple, put together of theirs.
_NO_STATE = _unknown("has_state", "rear_wheel_angle_rad")
_NO_STATUS = _unknown("has_status", "gear")
_NO_REFERENCE = _unknown("trajectory_version", "heading_error_rad")
_NO_LOOKAHEAD = _unknown("has_lookahead", "lookahead_y_m")


class Teller:
    """Builds and publishes; without a writer it does nothing."""

    def __init__(self, writer: TelemetryWriter | None, controller: ControllerBase, counts: Counts) -> None:
        self._writer = writer
        self._controller = controller
        self._counts = counts
        self._trajectory_version = 0
        self._last_ns = 0
        self._details_grid: Grid | None = None
        self._path: _Path | None = None
        self._lookahead_failed = False

    def tell(
        self,
        now_ns: int,
        *,
        controller_state: ControllerState,
        reason: Reason,
        state: VehicleState | None,
        status: VehicleStatus | None,
        answer: Answer | None,
        sent: bool = False,
        latency_ns: int = 0,
        drops: int = 0,
        hands_over: bool = False,
        handover_ns: int = 0,
    ) -> None:
        """Publish what is known now."""
        if self._writer is None:
            return
        self._last_ns = now_ns
        reference, lookahead, frame_id = _NO_REFERENCE, _NO_LOOKAHEAD, "map"
        if state is not None:
            frame_id = state.frame_id
            reference, lookahead = self._reference(state)
        wish, safe = (answer.wish, answer.safe) if answer is not None else (None, None)
        counts = self._counts
        snapshot = (
            now_ns,
            controller_state,
            reason,
            *(_of_state(state) if state is not None else _NO_STATE),
            *(_of_status(status) if status is not None else _NO_STATUS),
            *reference,
            *lookahead,
            answer is not None,
            wish.accel_mps2 if wish is not None else 0.0,
            wish.front_wheel_angle_rad if wish is not None else 0.0,
            sent,
            safe.accel_mps2 if safe is not None else 0.0,
            safe.front_wheel_angle_rad if safe is not None else 0.0,
            latency_ns,
            counts.samples,
            counts.commands,
            drops,
            counts.deadline_misses,
            hands_over,
            handover_ns,
            frame_id,
            0,
        )
        self._writer.publish(Snapshot._make(snapshot))

    def is_quiet(self, now_ns: int) -> bool:
        """Whether nothing was published for a while."""
        return now_ns - self._last_ns >= QUIET_NS

    @property
    def indices(self) -> tuple[int, int]:
        """The spatial and the temporal reference index; 0, 0 without a trajectory."""
        trajectory = self._controller.trajectory
        if trajectory is None or not len(trajectory):
            return 0, 0
        return self._controller.spatial_index, self._controller.temporal_index

    def tell_trajectory(self) -> None:
        """Publish the controller's trajectory for drawing."""
        if self._writer is not None:
            self._trajectory_version = self._writer.publish_trajectory(self._controller.trajectory)

    def tell_details(self, now_ns: int, details: Callable[[], dict[str, Any]]) -> None:
        """Publish all counters, twice a second."""
        if self._writer is None:
            return
        if self._details_grid is None:
            self._details_grid = Grid(DETAILS_NS, now_ns)
        if self._details_grid.due(now_ns):
            self._writer.publish_details(details())

    def _reference(self, state: VehicleState) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """The groups of the reference points and of the look-ahead."""
        trajectory = self._controller.trajectory
        if trajectory is None or not len(trajectory) or trajectory.frame_id != state.frame_id:
            return _NO_REFERENCE, _NO_LOOKAHEAD
        if self._path is None or self._path.trajectory is not trajectory:
            self._path = _Path(trajectory)
        path, spatial, temporal = self._path, self._controller.spatial_index, self._controller.temporal_index
        x_m, y_m, heading_rad = path.xs_m[spatial], path.ys_m[spatial], path.headings_rad[spatial]
        _, lateral_m = turned_back(state.x_m - x_m, state.y_m - y_m, heading_rad)
        reference = (
            self._trajectory_version,
            True,
            spatial,
            temporal,
            x_m,
            y_m,
            path.xs_m[temporal],
            path.ys_m[temporal],
            path.speeds_mps[spatial],
            lateral_m,
            wrapped_rad(state.heading_rad - heading_rad),
        )
        return reference, self._lookahead()

    def _lookahead(self) -> tuple[Any, ...]:
        """Where the controller says that it looks ahead to, if it does."""
        try:
            point = getattr(self._controller, "lookahead_point", None)
            if point is None:
                return _NO_LOOKAHEAD
            x_m, y_m = point
            return True, checks.finite("x_m", x_m), checks.finite("y_m", y_m)
        except KeyboardInterrupt:
            raise
        except BaseException:  # a controller is the user's code: it may raise anything, and say what is no place
            if not self._lookahead_failed:
                self._lookahead_failed = True
                log.exception("lookahead_point is no place; none is drawn (said once)")
            return _NO_LOOKAHEAD


class _Path:
    """A trajectory's numbers, quick to read."""

    __slots__ = ("headings_rad", "speeds_mps", "trajectory", "xs_m", "ys_m")

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self.xs_m, self.ys_m = plain_values(trajectory.x_m), plain_values(trajectory.y_m)
        self.headings_rad, self.speeds_mps = plain_values(trajectory.heading_rad), plain_values(trajectory.speed_mps)


def _of_state(state: VehicleState) -> tuple[Any, ...]:
    return (
        True,
        state.stamp_ns,
        state.x_m,
        state.y_m,
        state.heading_rad,
        state.speed_mps,
        state.accel_mps2,
        state.yaw_rate_radps,
        state.lateral_speed_mps,
        state.front_wheel_angle_rad,
        state.rear_wheel_angle_rad,
    )


def _of_status(status: VehicleStatus) -> tuple[Any, ...]:
    return True, status.mode, Gear.NO_REQUEST if status.gear is None else status.gear
