"""The base class of all controllers: when to stop, how to stop, and progress along the trajectory."""

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from enum import StrEnum
from typing import final

from msgspec.structs import force_setattr, replace

from vehicle_iface import checks
from vehicle_iface.command import Command
from vehicle_iface.control.tracking import PathProgress
from vehicle_iface.errors import (
    FrameMismatchError,
    InvalidValueError,
    NoTrajectoryError,
    TrajectoryRejectedError,
)
from vehicle_iface.reason import Reason
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.value import Value

log = logging.getLogger(__name__)


class ControlReference(StrEnum):
    """Which trajectory point is the reference: the one at this position, or the one for this time."""

    SPATIAL = "spatial"
    TEMPORAL = "temporal"


_SPATIAL = ControlReference.SPATIAL  # enumerations are slow to read


class StopSteering(StrEnum):
    """The commanded wheel angle while the vehicle stops."""

    STRAIGHT = "straight"
    """0 rad."""
    HOLD = "hold"
    """The measured angle."""
    TRACK = "track"
    """The angle of `stop_steering_impl` while the state is good; otherwise 0 rad."""


class BehaviorConfig(Value, frozen=True, kw_only=True):
    """How a controller stops, and which point is its reference. Raises `InvalidValueError`."""

    safe_deceleration_mps2: float = 3.0
    """Greatest deceleration of a stop command; above 0."""
    time_step_s: float = 0.1
    """Longest time until the next command: a stop never brings the vehicle to rest in less. Above 0."""
    reference: ControlReference = ControlReference.SPATIAL
    stop_steering: StopSteering = StopSteering.STRAIGHT

    def __post_init__(self) -> None:
        for name in ("safe_deceleration_mps2", "time_step_s"):
            force_setattr(self, name, checks.positive(name, getattr(self, name)))
        for name, kind in (("reference", ControlReference), ("stop_steering", StopSteering)):
            if not isinstance(getattr(self, name), kind):
                raise InvalidValueError(f"{name} = {getattr(self, name)!r}: must be a {kind.__name__}")


class ControllerBase(ABC):
    """Follows a trajectory, or stops.

    A subclass implements `compute_command_impl`, and may override the hooks `prepare_new_trajectory`,
    `check_new_trajectory`, `handle_new_trajectory` and `stop_steering_impl`. On every `compute_command(state)`, in this
    order:

    1. No trajectory, or one without points: stop command, in any frame.
    2. State and trajectory in different frames: `FrameMismatchError`; the indices do not change.
    3. Both indices advance to the last point that the state is past or level with (see `tracking`).
    4. Past the end in time, or else in space: stop command.
    5. Otherwise the subclass's command, with the state's stamp.

    A stop command has the acceleration −sign(v) · min(|v| / time step, safe deceleration): 0 at standstill, and
    never so much that the vehicle would move the other way one time step later.
    """

    def __init__(self, behavior: BehaviorConfig | None = None) -> None:
        self.behavior = BehaviorConfig() if behavior is None else behavior
        self._progress: PathProgress | None = None
        self._is_stopping = True
        self._stop_steering_failed = False

    @final
    def set_trajectory(self, trajectory: Trajectory) -> None:
        """Follow `trajectory` from now on; one without points means stop. Resets both indices to 0.

        Calls `check_new_trajectory`, then `handle_new_trajectory`, and follows the trajectory that this returns. Raises
        `TrajectoryRejectedError` when the check returns false, `InvalidValueError` when the value or the result is not
        a `Trajectory`, and any exception of the two hooks. After an exception the old trajectory and the indices stay.
        """
        _require_trajectory("trajectory", trajectory)
        if not self.check_new_trajectory(trajectory):
            raise TrajectoryRejectedError(
                f"{type(self).__name__} rejected a trajectory of {len(trajectory)} points, stamp {trajectory.stamp_ns}"
            )
        handled = self.handle_new_trajectory(trajectory)
        _require_trajectory("result of handle_new_trajectory", handled)
        self._progress = PathProgress(handled)

    @final
    def clear_trajectory(self) -> None:
        """Remove the trajectory, so that the next command is a stop."""
        self._progress = None

    @final
    def compute_command(self, state: VehicleState) -> Command:
        """The command for `state`, by the steps that the class lists.

        Raises `FrameMismatchError`, and any exception of `compute_command_impl` (after the indices have advanced).
        """
        progress = self._progress
        if progress is None:
            return self.compute_stop_command(state, Reason.NO_TRAJECTORY)
        if progress.last < 0:
            return self.compute_stop_command(state, Reason.EMPTY_TRAJECTORY)
        if state.frame_id != progress.trajectory.frame_id:
            raise FrameMismatchError(
                f"state in frame {state.frame_id!r}, trajectory in {progress.trajectory.frame_id!r}"
            )
        progress.advance(state.stamp_ns, state.x_m, state.y_m)
        if progress.is_past_end_in_time(state.stamp_ns):
            return self.compute_stop_command(state, Reason.PAST_END_TIME)
        if progress.is_past_end_in_space(state.x_m, state.y_m):
            return self.compute_stop_command(state, Reason.PAST_END_SPACE)
        return self._stamp(self.compute_command_impl(state), state.stamp_ns)

    @final
    def compute_stop_command(
        self, state: VehicleState, reason: Reason | None = None, *, may_track: bool = True
    ) -> Command:
        """The command that stops the vehicle, with wheel angles by `BehaviorConfig.stop_steering`. Never raises.

        Works without a trajectory and in any frame. `reason` is sent on the bus; without one (or with `NOMINAL`, which
        no stop can have) it is `NO_TRAJECTORY`, `EMPTY_TRAJECTORY` or else `SHUTDOWN`. `may_track` false replaces
        `StopSteering.TRACK` by straight wheels: the state is not good enough to steer.
        """
        if reason is None or reason is Reason.NOMINAL:
            reason = self._reason_to_stop()
        front_rad, rear_rad = self._stop_steering(state, may_track=may_track)
        self._is_stopping = True
        return Command(
            stamp_ns=state.stamp_ns,
            accel_mps2=self.stop_acceleration(state.speed_mps),
            front_wheel_angle_rad=front_rad,
            rear_wheel_angle_rad=rear_rad,
            speed_mps=0.0,
            reason=reason,
        )

    @final
    @property
    def trajectory(self) -> Trajectory | None:
        """The trajectory in force, as `handle_new_trajectory` returned it; None if there is none."""
        return None if self._progress is None else self._progress.trajectory

    @final
    @property
    def spatial_index(self) -> int:
        """Index of the last point that the vehicle is past or level with; starts at 0, and is 0 without points.

        Raises `NoTrajectoryError` before the first trajectory, and after `clear_trajectory`.
        """
        return (self._progress or self._progress_in_force()).spatial_index

    @final
    @property
    def temporal_index(self) -> int:
        """Index of the last point whose time has come; starts and raises as `spatial_index` does."""
        return (self._progress or self._progress_in_force()).temporal_index

    @final
    @property
    def reference_index(self) -> int:
        """The spatial or the temporal index, by `BehaviorConfig.reference`. Raises as `spatial_index`
        does."""
        progress = self._progress_in_force()
        in_space = self.behavior.reference is _SPATIAL
        return progress.spatial_index if in_space else progress.temporal_index

    @final
    @property
    def is_stopping(self) -> bool:
        """Whether the last command was a stop; true before the first one."""
        return self._is_stopping

    @final
    def stop_acceleration(self, speed_mps: float) -> float:
        """The acceleration of a stop at this speed, in m/s² along the body's x axis: opposite in sign to the speed."""
        if speed_mps == 0.0:
            return 0.0
        deceleration_mps2 = min(abs(speed_mps) / self.behavior.time_step_s, self.behavior.safe_deceleration_mps2)
        return math.copysign(deceleration_mps2, -speed_mps)

    @abstractmethod
    def compute_command_impl(self, state: VehicleState) -> Command:
        """The command for a state that is on the trajectory. A controller must implement this method.

        It is called only with a trajectory that has points, in the state's frame, with `spatial_index` and
        `temporal_index` up to date and neither past the end. The returned command gets the state's stamp. To stop,
        return `self.compute_stop_command(state, reason)`. An exception stops the vehicle (`CONTROLLER_ERROR`).
        """

    def check_new_trajectory(self, trajectory: Trajectory) -> bool:  # noqa: ARG002  # a hook: the default takes all
        """Whether this controller can follow `trajectory`. Must not change the controller."""
        return True

    def handle_new_trajectory(self, trajectory: Trajectory) -> Trajectory:
        """The trajectory to follow instead of the given one, after the check has passed; the same by default."""
        return trajectory

    def prepare_new_trajectory(self, trajectory: Trajectory) -> Iterator[None]:  # noqa: ARG002  # a hook
        """Compute what following `trajectory` needs, in pieces; nothing by default.

        The loop calls this before `set_trajectory`. It goes on with the iterator by one piece or a few a pass, and
        drives meanwhile: no piece should take longer than 0.3 ms. The work may be cut short when a newer trajectory
        comes. `set_trajectory` does not call this, so a controller must do without.
        """
        return iter(())

    def stop_steering_impl(self, state: VehicleState) -> tuple[float, float]:  # noqa: ARG002  # a hook
        """Front and rear road-wheel angle (rad, positive to the left) of a stop with `StopSteering.TRACK`.

        Called at any time, also without a trajectory, but not with one in another frame. (0, 0) by default, and also
        when this method raises or returns a value that is not finite (logged once).
        """
        return 0.0, 0.0

    def _stop_steering(self, state: VehicleState, *, may_track: bool) -> tuple[float, float]:
        policy, trajectory = self.behavior.stop_steering, self.trajectory
        if policy is StopSteering.HOLD:
            return state.front_wheel_angle_rad, state.rear_wheel_angle_rad
        in_frame = trajectory is None or trajectory.frame_id == state.frame_id
        if policy is StopSteering.STRAIGHT or not (may_track and in_frame):
            return 0.0, 0.0
        try:
            front_rad, rear_rad = self.stop_steering_impl(state)
            return checks.finite("front_wheel_angle_rad", front_rad), checks.finite("rear_wheel_angle_rad", rear_rad)
        except KeyboardInterrupt:
            raise
        except BaseException:  # a subclass's hook may raise anything, and a stop must always have an answer
            if not self._stop_steering_failed:
                self._stop_steering_failed = True
                log.exception("stop_steering_impl failed; such stops steer straight (logged once)")
            return 0.0, 0.0

    def _stamp(self, command: Command, stamp_ns: int) -> Command:
        if not isinstance(command, Command):
            raise InvalidValueError(f"compute_command_impl returned {command!r}: must be a Command")
        self._is_stopping = command.is_stop
        return command if command.stamp_ns == stamp_ns else replace(command, stamp_ns=stamp_ns)

    def _reason_to_stop(self) -> Reason:
        if self._progress is None:
            return Reason.NO_TRAJECTORY
        return Reason.EMPTY_TRAJECTORY if self._progress.last < 0 else Reason.SHUTDOWN

    def _progress_in_force(self) -> PathProgress:
        if self._progress is None:
            raise NoTrajectoryError("no trajectory is set, so there is no index in it")
        return self._progress


def _require_trajectory(what: str, value: object) -> None:
    if not isinstance(value, Trajectory):
        raise InvalidValueError(f"{what} = {value!r}: must be a Trajectory")
