"""What every controller keeps to. A controller's test class inherits `ControllerContract` and says how to
make one."""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.narrowing import at_present
from vehicle_iface.command import Command
from vehicle_iface.control import BehaviorConfig, ControllerBase, ControlReference, StopSteering
from vehicle_iface.errors import (
    FrameMismatchError,
    InvalidValueError,
    NoTrajectoryError,
    TrajectoryRejectedError,
)
from vehicle_iface.reason import Reason
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import NS_PER_S

from . import strategies


def along_x(n: int = 11, *, stamp_ns: int = 0, frame_id: str = "map", speed_mps: float = 1.0) -> Trajectory:
    """n points 1 m and 1 s apart."""
    return Trajectory(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        time_from_start_ns=np.array([i * NS_PER_S for i in range(n)], dtype=np.int64),
        x_m=np.array([float(i) for i in range(n)]),
        y_m=np.array([0.0] * n),
        heading_rad=np.array([0.0] * n),
        speed_mps=np.array([speed_mps] * n),
    )


def at(x_m: float, y_m: float = 0.0, *, stamp_ns: int = 0, speed_mps: float = 1.0, **more: Any) -> VehicleState:
    return VehicleState(stamp_ns=stamp_ns, x_m=x_m, y_m=y_m, heading_rad=0.0, speed_mps=speed_mps, **more)


def assert_plain(command: Command) -> None:
    numbers = (
        command.accel_mps2,
        command.front_wheel_angle_rad,
        command.rear_wheel_angle_rad,
        command.speed_mps,
    )
    assert all(type(number) is float and math.isfinite(number) for number in numbers)
    assert type(command.stamp_ns) is int


inherited = settings(suppress_health_check=[HealthCheck.differing_executors])
"""For laws in the class: each class that inherits one runs it on controllers of its own."""


class ControllerContract(ABC):
    @abstractmethod
    def controller(self, behavior: BehaviorConfig | None = None) -> ControllerBase: ...

    # ── stopping ──

    def test_without_a_trajectory_it_stops_in_any_frame(self) -> None:
        command = self.controller().compute_command(replace(at(0.0), frame_id="nowhere"))
        assert command.reason is Reason.NO_TRAJECTORY

    def test_an_empty_trajectory_stops_it_before_any_look_at_the_frame(self) -> None:
        controller = self.controller()
        controller.set_trajectory(Trajectory.empty(stamp_ns=0, frame_id="odom"))
        assert controller.compute_command(at(0.0)).reason is Reason.EMPTY_TRAJECTORY

    def test_after_clearing_it_stops(self) -> None:
        controller = self.controller()
        controller.set_trajectory(along_x())
        controller.clear_trajectory()
        assert controller.trajectory is None
        assert controller.compute_command(at(0.5)).reason is Reason.NO_TRAJECTORY

    @pytest.mark.parametrize(("late_ns", "reason"), [(-1, Reason.NOMINAL), (0, Reason.PAST_END_TIME)])
    def test_it_stops_exactly_at_the_last_points_nanosecond(self, late_ns: int, reason: Reason) -> None:
        start_ns = 2**62 + 1  # floats cannot tell neighbours apart here
        controller = self.controller()
        controller.set_trajectory(along_x(stamp_ns=start_ns))
        state = at(3.5, stamp_ns=start_ns + 10 * NS_PER_S + late_ns)
        assert controller.compute_command(state).reason is reason

    def test_it_stops_past_the_plane_through_the_last_point(self) -> None:
        controller = self.controller()
        controller.set_trajectory(along_x())
        assert controller.compute_command(at(9.9)).reason is Reason.NOMINAL
        assert controller.compute_command(at(10.0, 2.0)).reason is Reason.PAST_END_SPACE

    def test_time_is_what_ends_a_trajectory_that_is_past_its_end_in_both(self) -> None:
        controller = self.controller()
        controller.set_trajectory(along_x())
        assert controller.compute_command(at(20.0, stamp_ns=20 * NS_PER_S)).reason is Reason.PAST_END_TIME

    @inherited
    @given(state=strategies.states(), step_s=st.floats(1e-3, 2.0), deceleration=st.floats(0.1, 10.0))
    def test_a_stop_opposes_the_motion_and_never_turns_it_round(
        self, state: VehicleState, step_s: float, deceleration: float
    ) -> None:
        behavior = BehaviorConfig(safe_deceleration_mps2=deceleration, time_step_s=step_s)
        command = self.controller(behavior).compute_stop_command(state)
        assert_plain(command)
        assert command.is_stop
        assert command.accel_mps2 * state.speed_mps <= 0.0
        assert abs(command.accel_mps2) == min(abs(state.speed_mps) / step_s, deceleration)
        later_mps = state.speed_mps + command.accel_mps2 * step_s
        assert later_mps * math.copysign(1.0, state.speed_mps) >= -1e-12
        assert (command.front_wheel_angle_rad, command.rear_wheel_angle_rad) == (0.0, 0.0)

    def test_a_stop_at_standstill_requests_no_acceleration(self) -> None:
        command = self.controller().compute_stop_command(at(0.0, speed_mps=-0.0))
        assert math.copysign(1.0, command.accel_mps2) == 1.0
        assert command.accel_mps2 == 0.0

    @pytest.mark.parametrize("speed_mps", [5e-324, -5e-324, 1.7e308, -1.7e308])
    def test_a_stop_is_finite_at_the_edges_of_the_floats(self, speed_mps: float) -> None:
        assert_plain(
            self.controller(BehaviorConfig(time_step_s=1e-300)).compute_stop_command(at(0.0, speed_mps=speed_mps))
        )

    def test_a_stop_can_hold_the_wheels(self) -> None:
        state = at(0.0, front_wheel_angle_rad=0.2, rear_wheel_angle_rad=-0.1)
        command = self.controller(BehaviorConfig(stop_steering=StopSteering.HOLD)).compute_stop_command(state)
        assert (command.front_wheel_angle_rad, command.rear_wheel_angle_rad) == (0.2, -0.1)

    def test_a_tracking_stop_is_straight_where_there_is_nothing_to_track(self) -> None:
        controller = self.controller(BehaviorConfig(stop_steering=StopSteering.TRACK))
        assert controller.compute_stop_command(at(0.0)).front_wheel_angle_rad == 0.0
        controller.set_trajectory(along_x(frame_id="odom"))
        assert controller.compute_stop_command(at(0.0, 1.0)).front_wheel_angle_rad == 0.0

    def test_a_stop_reports_its_reason(self) -> None:
        assert self.controller().compute_stop_command(at(0.0), Reason.STATE_STALE).reason is Reason.STATE_STALE

    def test_a_stop_without_a_reason_finds_one(self) -> None:
        controller = self.controller()
        assert controller.compute_stop_command(at(0.0)).reason is Reason.NO_TRAJECTORY
        controller.set_trajectory(Trajectory.empty(stamp_ns=0))
        assert controller.compute_stop_command(at(0.0)).reason is Reason.EMPTY_TRAJECTORY
        controller.set_trajectory(along_x())
        assert controller.compute_stop_command(at(0.0), Reason.NOMINAL).reason is Reason.SHUTDOWN

    def test_it_reports_whether_it_is_stopping(self) -> None:
        controller = self.controller()
        assert at_present(controller.is_stopping)
        controller.set_trajectory(along_x())
        controller.compute_command(at(0.5))
        assert not at_present(controller.is_stopping)
        controller.compute_stop_command(at(0.5))
        assert controller.is_stopping

    # ── where it is ──

    def test_a_state_in_another_frame_is_refused_and_moves_no_index(self) -> None:
        controller = self.controller()
        controller.set_trajectory(along_x())
        controller.compute_command(at(2.5, stamp_ns=NS_PER_S))
        with pytest.raises(FrameMismatchError, match=r"'odom'.*'map'"):
            controller.compute_command(replace(at(6.5, stamp_ns=4 * NS_PER_S), frame_id="odom"))
        assert (controller.spatial_index, controller.temporal_index) == (2, 1)

    def test_there_is_no_index_without_a_trajectory(self) -> None:
        controller = self.controller()
        for _ in range(2):
            for name in ("spatial_index", "temporal_index", "reference_index"):
                with pytest.raises(NoTrajectoryError):
                    getattr(controller, name)
            controller.set_trajectory(along_x())
            controller.clear_trajectory()

    def test_the_indices_are_0_after_a_trajectory_without_points(self) -> None:
        controller = self.controller()
        controller.set_trajectory(along_x())
        controller.compute_command(at(2.5, stamp_ns=NS_PER_S))
        controller.set_trajectory(Trajectory.empty(stamp_ns=0))
        for _ in range(2):
            assert (controller.spatial_index, controller.temporal_index, controller.reference_index) == (0, 0, 0)
            controller.compute_command(at(2.5, stamp_ns=NS_PER_S))

    @pytest.mark.parametrize(("reference", "index"), [(ControlReference.SPATIAL, 3), (ControlReference.TEMPORAL, 5)])
    def test_the_reference_is_by_place_or_by_time(self, reference: ControlReference, index: int) -> None:
        controller = self.controller(BehaviorConfig(reference=reference))
        controller.set_trajectory(along_x())
        controller.compute_command(at(3.5, stamp_ns=5 * NS_PER_S))
        assert controller.reference_index == index

    @inherited
    @given(trajectory=strategies.trajectories(least=1), states=st.lists(strategies.states(), max_size=8))
    def test_the_indices_never_decrease_and_skip_no_point_that_is_not_passed(
        self, trajectory: Trajectory, states: list[VehicleState]
    ) -> None:
        controller = self.controller()
        controller.set_trajectory(trajectory)
        place = time = 0
        for state in states:
            command = controller.compute_command(state)
            assert_plain(command)
            assert command.stamp_ns == state.stamp_ns
            place, time = _walked_in_space(trajectory, place, state), _walked_in_time(trajectory, time, state)
            assert (controller.spatial_index, controller.temporal_index) == (place, time)
            assert type(controller.spatial_index) is type(controller.temporal_index) is int
        controller.set_trajectory(trajectory)
        assert (controller.spatial_index, controller.temporal_index) == (0, 0)

    # ── new trajectories ──

    @inherited
    @given(trajectory=strategies.trajectories(), how=st.sampled_from(["no", "check", "handle", "nonsense"]))
    def test_a_trajectory_that_is_not_taken_changes_nothing(self, trajectory: Trajectory, how: str) -> None:
        controller, old = self.controller(), along_x()
        controller.set_trajectory(old)
        before = controller.compute_command(at(2.5, stamp_ns=NS_PER_S))
        trouble = RuntimeError("no")

        def refuse(_: Trajectory) -> bool:
            return False

        def fail(_: Trajectory) -> Trajectory:
            raise trouble

        def nonsense(_: Trajectory) -> object:
            return "trajectory"

        name, hook, error = {
            "no": ("check_new_trajectory", refuse, TrajectoryRejectedError),
            "check": ("check_new_trajectory", fail, RuntimeError),
            "handle": ("handle_new_trajectory", fail, RuntimeError),
            "nonsense": ("handle_new_trajectory", nonsense, InvalidValueError),
        }[how]
        setattr(controller, name, hook)
        with pytest.raises(error):
            controller.set_trajectory(trajectory)
        assert controller.trajectory is old
        assert (controller.spatial_index, controller.temporal_index) == (2, 1)
        assert controller.compute_command(at(2.5, stamp_ns=NS_PER_S)) == before

    def test_an_object_that_is_not_a_trajectory_is_refused(self) -> None:
        with pytest.raises(InvalidValueError, match="must be a Trajectory"):
            self.controller().set_trajectory(None)  # type: ignore[arg-type]


def _walked_in_space(trajectory: Trajectory, index: int, state: VehicleState) -> int:
    """The law, word for word."""
    xs, ys = trajectory.x_m.tolist(), trajectory.y_m.tolist()
    while index + 1 < len(xs):
        way = (xs[index + 1] - xs[index], ys[index + 1] - ys[index])
        if way[0] * (state.x_m - xs[index + 1]) + way[1] * (state.y_m - ys[index + 1]) < -1e-7:
            break
        index += 1
    return index


def _walked_in_time(trajectory: Trajectory, index: int, state: VehicleState) -> int:
    times = trajectory.time_from_start_ns.tolist()
    while index + 1 < len(times) and state.stamp_ns >= trajectory.stamp_ns + times[index + 1]:
        index += 1
    return index
