"""The base by itself, under a controller that does as little as possible."""

import asyncio
import math
from dataclasses import replace

import numpy as np
import pytest

from vehicle_iface.command import Command
from vehicle_iface.control import BehaviorConfig, ControllerBase, StopSteering
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.reason import Reason
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory

from .contract import ControllerContract, along_x, at


class Coasting(ControllerBase):
    """Asks for nothing, under a stamp of its own; has a constructor of its own."""

    def __init__(self, behavior: BehaviorConfig | None = None) -> None:
        super().__init__(behavior)
        self.seen: list[VehicleState] = []

    def compute_command_impl(self, state: VehicleState) -> Command:
        self.seen.append(state)
        return Command(stamp_ns=-1, accel_mps2=0.0, front_wheel_angle_rad=0.0)


class TestCoasting(ControllerContract):
    def controller(self, behavior: BehaviorConfig | None = None) -> ControllerBase:
        return Coasting(behavior)


class Steering(Coasting):
    answer: object = (0.3, -0.1)

    def stop_steering_impl(self, state: VehicleState) -> tuple[float, float]:  # noqa: ARG002
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer  # type: ignore[return-value]


def test_the_child_is_not_asked_while_the_vehicle_stops() -> None:
    controller = Coasting()
    controller.compute_command(at(0.0))
    controller.set_trajectory(along_x())
    controller.compute_command(at(10.5))
    assert controller.seen == []


def test_a_tracking_stop_steers_the_angle_of_the_subclass() -> None:
    command = Steering(BehaviorConfig(stop_steering=StopSteering.TRACK)).compute_stop_command(at(0.0))
    assert (command.front_wheel_angle_rad, command.rear_wheel_angle_rad) == (0.3, -0.1)


@pytest.mark.parametrize(
    ("frame_id", "may_track", "front_rad"),
    [(None, True, 0.3), ("map", True, 0.3), ("odom", True, 0.0), (None, False, 0.0), ("map", False, 0.0)],
)
def test_a_tracking_stop_steers_by_a_good_state_in_the_trajectorys_frame_and_is_straight_otherwise(
    frame_id: str | None, may_track: bool, front_rad: float
) -> None:
    controller = Steering(BehaviorConfig(stop_steering=StopSteering.TRACK))
    if frame_id is not None:
        controller.set_trajectory(along_x(frame_id=frame_id))
    command = controller.compute_stop_command(at(0.0), may_track=may_track)
    assert command.front_wheel_angle_rad == front_rad


@pytest.mark.parametrize("answer", [ConfigError("x"), ZeroDivisionError(), (math.nan, 0.0), (0.0, math.inf)], ids=repr)
def test_a_tracking_stop_is_straight_when_the_subclass_has_no_angle(answer: object) -> None:
    controller = Steering(BehaviorConfig(stop_steering=StopSteering.TRACK))
    controller.answer = answer
    command = controller.compute_stop_command(at(0.0))
    assert (command.front_wheel_angle_rad, command.rear_wheel_angle_rad) == (0.0, 0.0)


def test_the_trajectory_that_the_handler_returns_is_followed() -> None:
    asked: list[str] = []

    class Shortening(Coasting):
        def check_new_trajectory(self, trajectory: Trajectory) -> bool:  # noqa: ARG002
            asked.append("check")
            return True

        def handle_new_trajectory(self, trajectory: Trajectory) -> Trajectory:  # noqa: ARG002
            asked.append("handle")
            return along_x(3)

    controller = Shortening()
    controller.set_trajectory(along_x(11))
    assert asked == ["check", "handle"]
    assert controller.trajectory is not None
    assert len(controller.trajectory) == 3
    assert controller.compute_command(at(2.5)).reason is Reason.PAST_END_SPACE


def test_an_object_that_is_not_a_command_is_refused() -> None:
    class Silent(Coasting):
        def compute_command_impl(self, state: VehicleState) -> Command:  # noqa: ARG002
            return None  # type: ignore[return-value]

    controller = Silent()
    controller.set_trajectory(along_x())
    with pytest.raises(InvalidValueError, match="must be a Command"):
        controller.compute_command(at(0.5))


def test_a_base_without_a_child_cannot_be_made() -> None:
    with pytest.raises(TypeError, match="compute_command_impl"):
        ControllerBase()  # type: ignore[abstract]


def test_the_plane_at_the_end_is_square_to_the_last_points_heading() -> None:
    controller = Coasting()
    controller.set_trajectory(replace(along_x(), heading_rad=np.array([0.0] * 10 + [math.pi / 4])))
    assert controller.compute_command(at(10.5, -0.6)).reason is Reason.NOMINAL
    assert controller.spatial_index == 10
    assert controller.compute_command(at(10.5, -0.4)).reason is Reason.PAST_END_SPACE


@pytest.mark.parametrize("name", ["safe_deceleration_mps2", "time_step_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, "3", True, None])
def test_behaviour_that_is_not_finite_and_positive_is_refused(name: str, value: object) -> None:
    with pytest.raises(InvalidValueError, match=name):
        BehaviorConfig(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["reference", "stop_steering"])
def test_behaviour_of_another_kind_is_refused(name: str) -> None:
    with pytest.raises(InvalidValueError, match=name):
        BehaviorConfig(**{name: "sideways"})  # type: ignore[arg-type]


def test_by_default_a_stop_brakes_with_three_metres_per_second_squared_and_a_tenth_of_a_second_ahead() -> None:
    controller = Coasting()
    assert controller.stop_acceleration(10.0) == -3.0
    assert controller.stop_acceleration(-1.0) == 3.0
    assert controller.stop_acceleration(1.0) == -3.0
    assert controller.stop_acceleration(0.2) == pytest.approx(-2.0)
    assert math.copysign(1.0, controller.stop_acceleration(0.0)) == 1.0
    assert controller.compute_stop_command(at(0.0)).speed_mps == 0.0


def test_a_straight_stop_does_not_call_the_subclass_for_its_steering() -> None:
    command = Steering().compute_stop_command(at(0.0))
    assert (command.front_wheel_angle_rad, command.rear_wheel_angle_rad) == (0.0, 0.0)


def test_a_subclass_without_a_stop_steering_stops_straight_and_a_failing_one_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    quiet = Coasting(BehaviorConfig(stop_steering=StopSteering.TRACK))
    command = quiet.compute_stop_command(at(0.0))
    assert (command.front_wheel_angle_rad, command.rear_wheel_angle_rad) == (0.0, 0.0)
    assert caplog.records == []
    failing = Steering(BehaviorConfig(stop_steering=StopSteering.TRACK))
    for error in (ZeroDivisionError(), SystemExit(1), asyncio.CancelledError()):
        failing.answer = error
        command = failing.compute_stop_command(at(0.0))
        assert (command.front_wheel_angle_rad, command.rear_wheel_angle_rad) == (0.0, 0.0)
    assert len(caplog.records) == 1
    failing.answer = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        failing.compute_stop_command(at(0.0))


def test_an_object_that_is_no_trajectory_is_refused_before_the_subclass_receives_it() -> None:
    with pytest.raises(InvalidValueError, match=r"^trajectory = "):
        Coasting().set_trajectory("straight on")  # type: ignore[arg-type]


def test_one_point_is_a_trajectory_that_has_points() -> None:
    controller = Coasting()
    controller.set_trajectory(along_x(1))
    assert controller.compute_command(at(-5.0)).reason is not Reason.EMPTY_TRAJECTORY
    assert controller.compute_stop_command(at(-5.0)).reason is Reason.SHUTDOWN
