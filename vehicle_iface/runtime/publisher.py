"""Publishes telemetry: a snapshot for each sample, the trajectory, the counters."""

import logging
from collections.abc import Callable
from math import isfinite

from vehicle_iface import checks
from vehicle_iface.control.base import ControllerBase
from vehicle_iface.control.tracking import as_numbers, to_body_axes
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import Decision
from vehicle_iface.runtime.timer import PeriodicTimer
from vehicle_iface.runtime.tracking_stats import TrackingStats
from vehicle_iface.state import VehicleState
from vehicle_iface.status import ControllerState, Gear, VehicleMode, VehicleStatus
from vehicle_iface.telemetry import TelemetryWriter
from vehicle_iface.telemetry.details import LiveDetails
from vehicle_iface.telemetry.snapshot import make_snapshot
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import NS_PER_MS, wrapped_rad

log = logging.getLogger(__name__)

QUIET_NS = 100 * NS_PER_MS
"""Period of snapshots without samples, so that a viewer sees that the loop runs."""
DETAILS_NS = 500 * NS_PER_MS


# What a snapshot says where nothing is known; its flags say that it is not.
_NO_STATE = VehicleState(stamp_ns=0, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0)
_NO_STATUS = VehicleStatus(stamp_ns=0, mode=VehicleMode.MANUAL, gear=None)


class TelemetryPublisher:
    """Builds and publishes telemetry; without a writer it does nothing."""

    def __init__(
        self,
        writer: TelemetryWriter | None,
        controller: ControllerBase,
        counters: Counters,
        *,
        lap: Callable[[], int | None] = lambda: None,
    ) -> None:
        """`lap` returns the number of the lap on a closed route, otherwise None."""
        self._writer = writer
        self._controller = controller
        self._counters = counters
        self._trajectory_version = 0
        self._last_ns = 0
        self._details_timer: PeriodicTimer | None = None
        self._path: _Path | None = None
        self._lookahead_failed = False
        self.tracking, self._lap, self._tracked_ns = TrackingStats(), lap, 0

    def publish_snapshot(
        self,
        now_ns: int,
        *,
        controller_state: ControllerState,
        reason: Reason,
        state: VehicleState | None,
        status: VehicleStatus | None,
        decision: Decision | None,
        sent: bool = False,
        latency_ns: int = 0,
        drops: int = 0,
        handover_pending: bool = False,
        handover_in_ns: int = 0,
    ) -> None:
        """Publish the newest values."""
        if self._writer is None:
            return
        self._last_ns = now_ns
        counters, shown, report = self._counters, state or _NO_STATE, status or _NO_STATUS
        path = self._path_in(state.frame_id) if state is not None else None
        spatial = temporal = 0
        spatial_x_m = spatial_y_m = temporal_x_m = temporal_y_m = reference_mps = lateral_m = heading_error_rad = 0.0
        lookahead = None
        if path is not None:
            spatial, temporal = self._controller.spatial_index, self._controller.temporal_index
            spatial_x_m, spatial_y_m = path.xs_m[spatial], path.ys_m[spatial]
            temporal_x_m, temporal_y_m = path.xs_m[temporal], path.ys_m[temporal]
            reference_mps, heading_rad = path.speeds_mps[spatial], path.headings_rad[spatial]
            _, lateral_m = to_body_axes(shown.x_m - spatial_x_m, shown.y_m - spatial_y_m, heading_rad)
            heading_error_rad = wrapped_rad(shown.heading_rad - heading_rad)
            lookahead = self._lookahead_m()
        lookahead_x_m, lookahead_y_m = lookahead or (0.0, 0.0)
        requested_accel_mps2 = requested_rad = sent_accel_mps2 = sent_rad = 0.0
        if decision is not None:
            requested, permitted = decision.requested, decision.permitted
            requested_accel_mps2, requested_rad = requested.accel_mps2, requested.front_wheel_angle_rad
            sent_accel_mps2, sent_rad = permitted.accel_mps2, permitted.front_wheel_angle_rad
            drives = sent and permitted.enable and not permitted.safe_stop
            if drives and path is not None and shown.stamp_ns != self._tracked_ns:
                self._tracked_ns = shown.stamp_ns
                self.tracking.add(lateral_m, heading_error_rad, lap=self._lap())
        # By position: by keyword, so many values cost 8 µs more. A test compares each with its name.
        # fmt: off
        self._writer.publish(make_snapshot(
            now_ns, controller_state, reason,
            state is not None, shown.stamp_ns, shown.x_m, shown.y_m, shown.heading_rad, shown.speed_mps,
            shown.accel_mps2, shown.yaw_rate_radps, shown.lateral_speed_mps,
            shown.front_wheel_angle_rad, shown.rear_wheel_angle_rad,
            status is not None, report.mode, Gear.NO_REQUEST if report.gear is None else report.gear,
            self._trajectory_version if path is not None else 0,
            path is not None, spatial, temporal, spatial_x_m, spatial_y_m, temporal_x_m, temporal_y_m,
            reference_mps, lateral_m, heading_error_rad,
            lookahead is not None, lookahead_x_m, lookahead_y_m,
            decision is not None, requested_accel_mps2, requested_rad,
            sent, sent_accel_mps2, sent_rad, latency_ns,
            counters.samples, counters.commands, drops, counters.deadline_misses,
            handover_pending, handover_in_ns,
            shown.frame_id, 0,
        ))
        # fmt: on

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

    def publish_trajectory(self) -> None:
        """Publish the controller's trajectory for drawing."""
        if self._writer is not None:
            self._trajectory_version = self._writer.publish_trajectory(self._controller.trajectory)

    def publish_details(self, now_ns: int, details: Callable[[], LiveDetails]) -> None:
        """Publish all counters, twice a second."""
        if self._writer is None:
            return
        if self._details_timer is None:
            self._details_timer = PeriodicTimer(DETAILS_NS, now_ns)
        if self._details_timer.is_due(now_ns):
            self._writer.publish_details(details())

    def _path_in(self, frame_id: str) -> "_Path | None":
        """The trajectory's numbers, where it has points in this frame of reference."""
        trajectory, path = self._controller.trajectory, self._path
        if path is None or path.trajectory is not trajectory:
            if trajectory is None or not len(trajectory):
                return None
            path = self._path = _Path(trajectory)
        return path if path.trajectory.frame_id == frame_id else None

    def _lookahead_m(self) -> tuple[float, float] | None:
        """The controller's look-ahead point, x and y in m; None if it has none."""
        try:
            point = getattr(self._controller, "lookahead_point", None)
            if point is None:
                return None
            x_m, y_m = point
            if type(x_m) is type(y_m) is float and isfinite(x_m + y_m):
                return x_m, y_m
            return checks.finite("x_m", x_m), checks.finite("y_m", y_m)
        except KeyboardInterrupt:
            raise
        except BaseException:  # a controller is the user's code: it may raise or return anything
            if not self._lookahead_failed:
                self._lookahead_failed = True
                log.exception("lookahead_point is not a pair of finite numbers; not drawn (logged once)")
            return None


class _Path:
    """A trajectory's numbers, quick to read."""

    __slots__ = ("headings_rad", "speeds_mps", "trajectory", "xs_m", "ys_m")

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self.xs_m, self.ys_m = as_numbers(trajectory.x_m), as_numbers(trajectory.y_m)
        self.headings_rad, self.speeds_mps = as_numbers(trajectory.heading_rad), as_numbers(trajectory.speed_mps)
