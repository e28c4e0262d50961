"""Whatever a user's controller, hook or source does, the loop goes on and the vehicle has an answer."""

from collections import Counter

import pytest
from harness import Drive, straight

from vehicle_iface import BehaviorConfig, Command, ControllerBase, Reason, StopSteering, Trajectory, VehicleState
from vehicle_iface.safety.engagement import Mode


class _Handy(ControllerBase):
    def compute_command_impl(self, state: VehicleState) -> Command:
        return Command(stamp_ns=state.stamp_ns, accel_mps2=1.0, front_wheel_angle_rad=0.0, speed_mps=5.0)

    def stop_steering_impl(self, state: VehicleState) -> tuple[float, float]:
        raise KeyError("table", state)


class _Broken:
    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:
        raise ValueError(now_ns, state)

    def restart(self) -> None:
        raise ValueError("again")


def test_a_stop_steering_hook_that_raises_anything_is_a_straight_stop() -> None:
    drive = Drive(controller=_Handy(BehaviorConfig(stop_steering=StopSteering.TRACK))).engage(3.0)
    drive.say("pose_valid 0")
    drive.run_s(0.5)
    assert drive.last()["SAFE_STOP"] == 1
    assert drive.last()["FRONT_WHEEL_ANGLE_REQUEST"] == 0.0


def test_a_source_that_raises_stops_the_vehicle_and_not_the_loop() -> None:
    drive = Drive(_Broken())
    drive.run_s(1.0)
    assert drive.last()["SAFE_STOP"] == 1
    assert drive.loop.reason is Reason.NO_TRAJECTORY


class _Worse(_Broken):
    """Gives something too fast twice before it breaks."""

    def __init__(self) -> None:
        self.left = 2

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:
        self.left -= 1
        return straight(speed_mps=25.0) if self.left >= 0 else super().next(now_ns, state)

    def restart(self) -> None:
        """As if nothing had been."""


def test_the_first_thing_that_a_source_raises_is_logged_with_its_place_whatever_was_refused_before(
    caplog: pytest.LogCaptureFixture,
) -> None:
    drive = Drive(_Worse())
    drive.run_s(1.0)
    assert drive.loop.details()["loop"]["trajectories_rejected"] > 10
    assert caplog.text.count("no new trajectory; the old one stays in force") == 1
    assert "raise ValueError(now_ns, state)" in caplog.text


@pytest.mark.parametrize("seconds", [0.07, 0.09, 2.0])
def test_after_a_stall_only_the_newest_sample_is_answered(seconds: float) -> None:
    drive = Drive().engage(3.0)
    drive.stall(seconds)
    since = len(drive.sent)
    drive.run_s(0.5)
    assert max(Counter(pair.step for pair in drive.pairs(since)).values()) == 1


def test_a_bus_that_takes_nothing_for_100_ms_silences_and_latches() -> None:
    drive = Drive().engage(3.0)
    drive.line.full = True
    drive.run_s(0.3)
    assert drive.mode() is Mode.SILENT
    assert drive.loop.reason is Reason.LINK_DOWN
    drive.line.full = False
    since = len(drive.sent)
    drive.run_s(1.0)
    assert drive.pairs(since) == []
