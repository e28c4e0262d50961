"""What leaves the loop by the one-way door: a snapshot per sample, the trajectory, the counters."""

from collections.abc import Callable
from typing import Any

from vehicle_iface.control.base import ControllerBase
from vehicle_iface.control.tracking import point_at, tracking_error
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.runtime.pilot import Answer
from vehicle_iface.runtime.rate import Grid
from vehicle_iface.runtime.telemetry import Snapshot, TelemetryWriter
from vehicle_iface.state import VehicleState
from vehicle_iface.status import ControllerState, Gear, VehicleStatus
from vehicle_iface.units import NS_PER_MS

QUIET_NS = 100 * NS_PER_MS
"""Without samples a snapshot is published this often, so that a viewer sees the loop alive."""
DETAILS_NS = 500 * NS_PER_MS


class Teller:
    """Builds and publishes; without a writer it does nothing."""

    def __init__(self, writer: TelemetryWriter | None, controller: ControllerBase, counts: Counts) -> None:
        self._writer = writer
        self._controller = controller
        self._counts = counts
        self._trajectory_version = 0
        self._last_ns = 0
        self._details_grid: Grid | None = None

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
    ) -> None:
        """Publish what is known now."""
        if self._writer is None:
            return
        self._last_ns = now_ns
        known: dict[str, Any] = {}
        if state is not None:
            known |= _of_state(state) | self._of_reference(state)
        if status is not None:
            gear = Gear.NO_REQUEST if status.gear is None else status.gear
            known |= {"has_status": True, "vehicle_mode": status.mode, "gear": gear}
        if answer is not None:
            known |= _of_answer(answer)
        self._writer.publish(
            Snapshot(
                published_ns=now_ns,
                controller_state=controller_state,
                reason=reason,
                sent=sent,
                latency_ns=latency_ns,
                samples=self._counts.samples,
                commands=self._counts.commands,
                drops=drops,
                deadline_misses=self._counts.deadline_misses,
                **known,
            )
        )

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

    def _of_reference(self, state: VehicleState) -> dict[str, Any]:
        trajectory = self._controller.trajectory
        if trajectory is None or not len(trajectory) or trajectory.frame_id != state.frame_id:
            return {}
        spatial_index, temporal_index = self.indices
        spatial = point_at(trajectory, spatial_index)
        temporal = point_at(trajectory, temporal_index)
        error = tracking_error(state, spatial)
        lookahead = getattr(self._controller, "lookahead_point", None)
        return {
            "has_reference": True,
            "trajectory_version": self._trajectory_version,
            "spatial_index": spatial_index,
            "temporal_index": temporal_index,
            "spatial_reference_x_m": spatial.x_m,
            "spatial_reference_y_m": spatial.y_m,
            "temporal_reference_x_m": temporal.x_m,
            "temporal_reference_y_m": temporal.y_m,
            "reference_speed_mps": spatial.speed_mps,
            "lateral_error_m": error.lateral_m,
            "heading_error_rad": error.heading_rad,
            "has_lookahead": lookahead is not None,
            "lookahead_x_m": lookahead[0] if lookahead else 0.0,
            "lookahead_y_m": lookahead[1] if lookahead else 0.0,
        }


def _of_state(state: VehicleState) -> dict[str, Any]:
    return {
        "has_state": True,
        "stamp_ns": state.stamp_ns,
        "frame_id": state.frame_id,
        "x_m": state.x_m,
        "y_m": state.y_m,
        "heading_rad": state.heading_rad,
        "speed_mps": state.speed_mps,
        "accel_mps2": state.accel_mps2,
        "yaw_rate_radps": state.yaw_rate_radps,
        "lateral_speed_mps": state.lateral_speed_mps,
        "front_wheel_angle_rad": state.front_wheel_angle_rad,
        "rear_wheel_angle_rad": state.rear_wheel_angle_rad,
    }


def _of_answer(answer: Answer) -> dict[str, Any]:
    return {
        "has_wanted": True,
        "wanted_accel_mps2": answer.wish.accel_mps2,
        "wanted_front_wheel_angle_rad": answer.wish.front_wheel_angle_rad,
        "sent_accel_mps2": answer.safe.accel_mps2,
        "sent_front_wheel_angle_rad": answer.safe.front_wheel_angle_rad,
    }
