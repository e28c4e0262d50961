"""What is answered to one sample: the reason that decides, the gear, and the gate's permission."""

import asyncio
import math
from typing import Any

import pytest

from tests.harness import ms, pure_pursuit, reference, straight
from vehicle_iface import Command, ControllerBase, Reason, VehicleState
from vehicle_iface.compose import stop_shape
from vehicle_iface.motion_sources import MotionSources
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import ControlCycle, Decision
from vehicle_iface.safety.deviation import DeviationMonitor
from vehicle_iface.safety.engagement import Engagement, EngagementTiming
from vehicle_iface.safety.gate import Gate, gate_channels
from vehicle_iface.safety.gear import GearCheck
from vehicle_iface.safety.modes import Mode
from vehicle_iface.safety.motion import MotionCheck
from vehicle_iface.safety.stop_hold import StopHold
from vehicle_iface.state_assembler import Sample
from vehicle_iface.status import Gear, VehicleMode, VehicleStatus

NOW_NS = 10**9
TIMING = EngagementTiming(
    settle_ns=ms(500),
    stale_ns=ms(50),
    lost_ns=ms(500),
    status_stale_ns=ms(100),
    engage_timeout_ns=ms(3000),
    end_ns=ms(10_000),
    steer_torque_nm=3.0,
)


class Always(ControllerBase):
    """A controller that always does one thing."""

    def __init__(self, **requested: Any) -> None:
        super().__init__()
        self.requested = {"accel_mps2": 1.0, "front_wheel_angle_rad": 0.0} | requested
        self.set_trajectory(straight())

    def compute_command_impl(self, state: VehicleState) -> Command:
        return Command(stamp_ns=state.stamp_ns, **self.requested)


class Raises(Always):
    """A controller with an error."""

    def __init__(self, error: BaseException) -> None:
        super().__init__()
        self.error = error

    def compute_command_impl(self, state: VehicleState) -> Command:  # noqa: ARG002
        raise self.error


class Cabin:
    """A control cycle at work."""

    def __init__(self, controller: ControllerBase, mode: Mode = Mode.ENGAGED) -> None:
        self.engagement = Engagement(TIMING, armed=True)
        self.engagement.mode = mode
        self.engagement.reason = Reason.SHUTDOWN if mode.ends else Reason.NOMINAL
        self.counters = Counters()
        self.motion = MotionCheck(
            reference().profile.plausibility,
            sources=MotionSources(),
            wheelbase_m=2.7,
            gap_s=0.05,
            agree_s=0.5,
        )
        self.now_ns = NOW_NS
        self.cycle = ControlCycle(
            controller,
            Gate(
                gate_channels(reference().profile.limits, lambda field: reference().resolutions[field]),
                reference().profile.limits,
                wheelbase_m=2.7,
                stop=stop_shape(reference().profile, controller.behavior),
            ),
            self.engagement,
            deviation=DeviationMonitor(reference().profile.deviation, speed_max_mps=20.0),
            motion=self.motion,
            gear_check=GearCheck(0.5),
            stop_hold=StopHold(reference().profile.recovery),
            gear_change_speed_mps=0.5,
            status_stale_ns=ms(200),
            budget_ns=ms(50),
            max_command_age_ns=ms(100),
            counters=self.counters,
            now_ns=lambda: self.now_ns,
        )

    def decide(
        self,
        *,
        speed_mps: float = 2.0,
        gear: Gear | None = Gear.DRIVE,
        status_age_ns: int = 0,
        pose_valid: bool = True,
        others_fresh: bool = True,
        frame_id: str = "map",
    ) -> Decision:
        state = VehicleState(stamp_ns=NOW_NS, frame_id=frame_id, x_m=5.0, y_m=0.0, heading_rad=0.0, speed_mps=speed_mps)
        self.cycle.controller.set_trajectory(straight(time_s=1e6))
        sample = Sample(
            state=state,
            pose_valid=pose_valid,
            others_fresh=others_fresh,
            counter=1,
            completed_ns=NOW_NS,
            is_lost=False,
        )
        status = None
        if gear is not None:
            status = VehicleStatus(stamp_ns=NOW_NS - status_age_ns, mode=VehicleMode.AUTONOMOUS, gear=gear)
        return self.cycle.decide(sample, status, self.now_ns)


def test_a_sample_without_complete_knowledge_of_the_vehicle_is_answered_by_a_stop() -> None:
    safe = Cabin(Always(speed_mps=3.0)).decide(others_fresh=False).permitted
    assert (safe.enable, safe.safe_stop, safe.reason) == (True, True, Reason.STATE_STALE)


@pytest.mark.parametrize("gear", [Gear.PARK, Gear.REVERSE, Gear.NEUTRAL, Gear.DRIVE])
@pytest.mark.parametrize("speed_mps", [0.0, 0.2, 0.495, 0.499, 0.5, 0.505, 2.0, -0.495, -0.5, -2.0])
@pytest.mark.parametrize(("requested_mps", "requested"), [(3.0, Gear.DRIVE), (-3.0, Gear.REVERSE)])
def test_a_gear_is_asked_for_only_below_half_a_metre_per_second_and_only_for_a_change(
    gear: Gear, speed_mps: float, requested_mps: float, requested: Gear
) -> None:
    request = Cabin(Always(speed_mps=requested_mps)).decide(speed_mps=speed_mps, gear=gear).permitted.gear_request
    changes = abs(speed_mps) < 0.5 and gear is not requested
    assert request is (requested if changes else Gear.NO_REQUEST)


@pytest.mark.parametrize(("accel_mps2", "requested"), [(0.5, Gear.DRIVE), (-0.5, Gear.REVERSE), (0.0, Gear.NO_REQUEST)])
def test_at_a_standing_start_the_direction_is_that_of_the_acceleration(accel_mps2: float, requested: Gear) -> None:
    decision = Cabin(Always(speed_mps=0.0, accel_mps2=accel_mps2)).decide(speed_mps=0.0, gear=Gear.PARK)
    assert decision.permitted.gear_request is requested


def test_braking_to_a_stop_while_rolling_requests_no_other_gear() -> None:
    decision = Cabin(Always(speed_mps=0.0, accel_mps2=-1.0)).decide(speed_mps=0.3, gear=Gear.DRIVE)
    assert decision.permitted.gear_request is Gear.NO_REQUEST


@pytest.mark.parametrize("gear", [Gear.PARK, Gear.REVERSE, Gear.NEUTRAL, Gear.DRIVE])
def test_a_stop_requests_no_gear(gear: Gear) -> None:
    decision = Cabin(Always(speed_mps=-3.0, reason=Reason.DEVIATION)).decide(speed_mps=0.0, gear=gear)
    assert decision.permitted.gear_request is Gear.NO_REQUEST


def test_without_a_status_the_gear_is_asked_for() -> None:
    assert Cabin(Always(speed_mps=3.0)).decide(speed_mps=0.0, gear=None).permitted.gear_request is Gear.DRIVE


@pytest.mark.parametrize(
    "error",
    [
        *(ValueError("x"), ZeroDivisionError(), KeyError(1), RecursionError(), AssertionError(), MemoryError()),
        *(OSError(5), SystemExit(1), asyncio.CancelledError(), GeneratorExit()),
    ],
    ids=lambda error: type(error).__name__,
)
def test_any_exception_of_a_controller_is_a_stop_with_its_reason_and_is_logged_once(
    error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    cabin = Cabin(Raises(error))
    safe = cabin.decide(speed_mps=2.0).permitted
    assert (safe.enable, safe.safe_stop, safe.reason) == (True, True, Reason.CONTROLLER_ERROR)
    assert cabin.counters.controller_errors == 1
    assert cabin.decide(speed_mps=2.0).permitted.reason is Reason.CONTROLLER_ERROR
    assert cabin.counters.controller_errors == 2
    assert len(caplog.messages) == 1
    assert "raise self.error" in caplog.text


def test_a_keyboard_interrupt_in_a_controller_ends_the_program() -> None:
    with pytest.raises(KeyboardInterrupt):
        Cabin(Raises(KeyboardInterrupt())).decide()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, None, "fast"])
@pytest.mark.parametrize("name", ["accel_mps2", "front_wheel_angle_rad", "speed_mps", "rear_wheel_angle_rad"])
def test_a_number_that_is_none_is_a_controller_error(name: str, value: Any) -> None:
    safe = Cabin(Always(**{name: value})).decide().permitted
    assert (safe.safe_stop, safe.reason) == (True, Reason.CONTROLLER_ERROR)


def test_an_answer_that_is_no_command_is_a_controller_error() -> None:
    class Odd(Always):
        def compute_command_impl(self, state: VehicleState) -> Command:  # noqa: ARG002
            return None  # type: ignore[return-value]

    assert Cabin(Odd()).decide().permitted.reason is Reason.CONTROLLER_ERROR


def test_a_pose_that_the_vehicle_does_not_trust_is_a_stop() -> None:
    assert Cabin(Always()).decide(pose_valid=False).permitted.reason is Reason.STATE_INVALID


def test_another_frame_of_reference_is_a_stop() -> None:
    assert Cabin(Always()).decide(frame_id="odom").permitted.reason is Reason.FRAME_MISMATCH


@pytest.mark.parametrize(
    ("age_ns", "reason"), [(ms(200), Reason.NOMINAL), (ms(200) + 1, Reason.STATE_STALE), (ms(9000), Reason.STATE_STALE)]
)
def test_a_status_older_than_200_ms_is_a_stop(age_ns: int, reason: Reason) -> None:
    assert Cabin(Always()).decide(status_age_ns=age_ns).permitted.reason is reason


@pytest.mark.parametrize("speed_mps", [-8.0, -0.1, 0.0, 0.1, 0.299, 0.3, 0.301, 8.0])
def test_every_stop_brakes_against_the_motion_and_no_harder_than_safe(speed_mps: float) -> None:
    requested = Cabin(Always()).decide(speed_mps=speed_mps, pose_valid=False).requested
    assert requested.accel_mps2 == pytest.approx(-math.copysign(min(abs(speed_mps) / 0.1, 3.0), speed_mps))


def test_a_stop_for_good_outranks_every_other_reason() -> None:
    decision = Cabin(Raises(ValueError()), Mode.ENDING).decide(pose_valid=False, frame_id="odom")
    assert decision.permitted.reason is Reason.SHUTDOWN


@pytest.mark.parametrize("mode", [Mode.STARTING, Mode.STANDBY, Mode.OVERRIDDEN, Mode.FAULT, Mode.RELEASED])
def test_a_loop_that_does_not_drive_releases(mode: Mode) -> None:
    cabin = Cabin(pure_pursuit(), mode)
    cabin.engagement.reason = Reason.DRIVER_OVERRIDE
    safe = cabin.decide().permitted
    assert (safe.enable, safe.safe_stop, safe.reason) == (False, False, Reason.DRIVER_OVERRIDE)


def test_when_driving_begins_the_first_angle_is_the_measured_one() -> None:
    cabin = Cabin(Always(front_wheel_angle_rad=0.5), Mode.STANDBY)
    cabin.decide()
    cabin.engagement.mode = Mode.ENGAGING
    assert cabin.decide().permitted.front_wheel_angle_rad == 0.0


class Slow(Always):
    """Takes its time."""

    cabin: "Cabin"
    takes_ns = 0

    def compute_command_impl(self, state: VehicleState) -> Command:
        self.cabin.now_ns += self.takes_ns
        return super().compute_command_impl(state)


@pytest.mark.parametrize(("takes_ms", "reason"), [(50, Reason.NOMINAL), (50.001, Reason.DEADLINE_MISSED)])
def test_a_controller_that_takes_longer_than_its_budget_stops_the_vehicle(takes_ms: float, reason: Reason) -> None:
    controller = Slow()
    controller.cabin = cabin = Cabin(controller)
    controller.takes_ns = ms(takes_ms)
    assert cabin.decide().permitted.reason is reason
    assert cabin.counters.controller_too_slow == (reason is not Reason.NOMINAL)


def test_a_slow_controller_is_logged_once_with_its_time(caplog: pytest.LogCaptureFixture) -> None:
    controller = Slow()
    controller.cabin = cabin = Cabin(controller)
    for takes_ms in (62, 62, 1, 70):
        controller.takes_ns = ms(takes_ms)
        cabin.now_ns = NOW_NS
        cabin.decide()
    assert caplog.messages == [f"the controller took {took} ms, its budget is 50 ms" for took in (62, 70)]


@pytest.mark.parametrize(("age_ms", "reason"), [(100, Reason.NOMINAL), (100.001, Reason.STATE_STALE)])
def test_a_sample_that_grows_too_old_while_the_controller_thinks_is_answered_by_a_stop(
    age_ms: float, reason: Reason
) -> None:
    controller = Slow()
    controller.cabin = cabin = Cabin(controller)
    controller.takes_ns = ms(40)
    cabin.now_ns = NOW_NS + ms(age_ms) - ms(40)
    safe = cabin.decide().permitted
    assert (safe.reason, safe.safe_stop) == (reason, reason is not Reason.NOMINAL)
    assert cabin.counters.controller_too_slow == 0


def test_the_gate_grants_the_time_until_the_command_is_sent() -> None:
    """Wheels may turn for as long as the controller thought, too: the limit is one of what is on the bus."""
    controller = Slow(front_wheel_angle_rad=0.5)
    controller.cabin = cabin = Cabin(controller, Mode.STANDBY)
    cabin.decide()
    cabin.engagement.mode = Mode.ENGAGED
    assert cabin.decide(speed_mps=0.0).permitted.front_wheel_angle_rad == 0.0
    controller.takes_ns = ms(40)
    turned_rad = cabin.decide(speed_mps=0.0).permitted.front_wheel_angle_rad
    assert turned_rad == pytest.approx(0.04 * reference().profile.limits.front_wheel_rate_radps, abs=1e-3)
