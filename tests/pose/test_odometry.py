"""Dead reckoning adds up what the vehicle drove, and has no pose where it cannot know."""

import math
from collections.abc import Iterable

import pytest

from tests.kinematics import WHEELBASE_M, drive
from vehicle_iface import VehicleState
from vehicle_iface.pose import Pose, PoseInputs
from vehicle_iface.pose.odometry import Odometry

PERIOD_NS = 10_000_000


def odometry(*, has_yaw_rate: bool = True) -> Odometry:
    return Odometry(wheelbase_m=WHEELBASE_M, max_gap_s=0.05, has_yaw_rate=has_yaw_rate)


def moving(speed_mps: float, yaw_radps: float = 0.0, lateral_mps: float | None = None) -> PoseInputs:
    return PoseInputs(speed_mps=speed_mps, yaw_rate_radps=yaw_radps, lateral_speed_mps=lateral_mps)


def run(source: Odometry, samples: Iterable[tuple[int, PoseInputs]]) -> Pose:
    """The last pose of samples that all have one."""
    pose = None
    for stamp_ns, values in samples:
        pose = source.resolve(stamp_ns, values)
        assert pose is not None
    assert pose is not None
    return pose


def sensed(states: Iterable[VehicleState], *fields: str) -> list[tuple[int, PoseInputs]]:
    return [(state.stamp_ns, PoseInputs(**{name: getattr(state, name) for name in fields})) for state in states]


def test_it_begins_at_zero_with_the_first_sample() -> None:
    source = odometry()
    assert source.resolve(123_456, moving(20.0, 1.0)) == Pose(x_m=0.0, y_m=0.0, heading_rad=0.0)
    assert (source.driven_m, source.invalid_because) == (0.0, "")


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_a_circle_at_100_hz_closes_within_a_millimetre(direction: float, turn: float) -> None:
    source, samples = odometry(), 1000
    yaw_radps = turn * math.tau / (samples * 0.01)
    pose = run(source, [(i * PERIOD_NS, moving(8.0 * direction, yaw_radps)) for i in range(samples + 1)])
    assert (pose.x_m, pose.y_m, pose.heading_rad) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert source.driven_m == pytest.approx(80.0)


@pytest.mark.parametrize(("direction", "sign"), [(1.0, 1.0), (-1.0, -1.0)])
def test_half_a_circle_to_the_left_ends_a_diameter_to_the_left(direction: float, sign: float) -> None:
    samples = 500
    yaw_radps = math.pi / (samples * 0.01)
    pose = run(odometry(), [(i * PERIOD_NS, moving(8.0 * direction, yaw_radps)) for i in range(samples + 1)])
    assert (pose.x_m, pose.y_m) == pytest.approx((0.0, sign * 2.0 * 8.0 / yaw_radps), abs=1e-9)
    assert abs(pose.heading_rad) == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("fields", "rear_rad"),
    [
        (("speed_mps", "yaw_rate_radps"), 0.0),
        (("speed_mps", "front_wheel_angle_rad"), 0.0),
        (("speed_mps", "front_wheel_angle_rad", "rear_wheel_angle_rad"), -0.1),
        (("speed_mps", "yaw_rate_radps", "lateral_speed_mps"), 0.1),
        (("speed_mps", "yaw_rate_radps", "rear_wheel_angle_rad"), 0.1),
        (("speed_mps", "front_wheel_angle_rad", "rear_wheel_angle_rad", "lateral_speed_mps"), 0.1),
    ],
)
@pytest.mark.parametrize("speed_mps", [8.0, -3.0])
def test_a_vehicle_without_slip_is_followed_while_it_brakes_in_a_turn(
    fields: tuple[str, ...], rear_rad: float, speed_mps: float
) -> None:
    states = drive(10.0, speed_mps=speed_mps, accel_mps2=-0.1 * speed_mps, front_rad=0.2, rear_rad=rear_rad)
    first, last = states[0], states[-1]
    pose = run(odometry(has_yaw_rate="yaw_rate_radps" in fields), sensed(states, *fields))
    dx_m, dy_m = last.x_m - first.x_m, last.y_m - first.y_m
    cos, sin = math.cos(first.heading_rad), math.sin(first.heading_rad)
    assert (pose.x_m, pose.y_m) == pytest.approx((dx_m * cos + dy_m * sin, dy_m * cos - dx_m * sin), abs=0.001)
    turned_rad = last.heading_rad - first.heading_rad
    assert math.remainder(pose.heading_rad - turned_rad, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_the_samples_own_stamps_count_however_irregular() -> None:
    stamps_ns = [0, 1, 7_000_000, 7_000_001, 40_000_000, 90_000_000]
    pose = run(odometry(), [(9**17 + stamp_ns, moving(10.0)) for stamp_ns in stamps_ns])
    assert pose.x_m == pytest.approx(0.9)


def test_between_two_samples_speed_and_yaw_rate_are_their_means() -> None:
    source = odometry()
    pose = run(source, [(0, moving(0.0, 0.0)), (50_000_000, moving(2.0, 0.4))])
    assert pose.heading_rad == pytest.approx(0.2 * 0.05)
    assert source.driven_m == pytest.approx(1.0 * 0.05)


def test_a_sample_that_comes_twice_moves_nothing() -> None:
    source = odometry()
    before = run(source, [(0, moving(10.0, 0.5)), (PERIOD_NS, moving(10.0, 0.5))])
    assert source.resolve(PERIOD_NS, moving(10.0, 0.5)) == before


def test_the_way_driven_adds_up_forwards_and_backwards() -> None:
    source = odometry()
    there = [(i * PERIOD_NS, moving(5.0)) for i in range(101)]
    back = [(i * PERIOD_NS, moving(-5.0)) for i in range(102, 203)]
    pose = run(source, there + back)
    assert pose.x_m == pytest.approx(0.0, abs=1e-9)
    assert source.driven_m == pytest.approx(10.0, abs=0.06)


def test_a_vehicle_that_stands_is_not_turned_by_its_gyroscopes_bias() -> None:
    source = odometry()
    moved = run(source, [(0, moving(1.0, 0.01)), (PERIOD_NS, moving(0.0, 0.01))])
    stood = run(source, [(i * PERIOD_NS, moving(0.0, 0.01)) for i in range(2, 1000)])
    assert stood == moved


def test_a_lateral_speed_moves_the_vehicle_sideways() -> None:
    pose = run(odometry(), [(i * PERIOD_NS, moving(2.0, 0.0, 1.0)) for i in range(101)])
    assert (pose.x_m, pose.y_m, pose.heading_rad) == pytest.approx((2.0, 1.0, 0.0))


@pytest.mark.parametrize(("gap_ns", "is_valid"), [(50_000_000, True), (50_000_001, False)])
def test_after_a_gap_there_is_no_pose_until_it_is_reset(gap_ns: int, is_valid: bool) -> None:
    source = odometry()
    run(source, [(0, moving(10.0)), (PERIOD_NS, moving(10.0))])
    after_ns = PERIOD_NS + gap_ns
    assert (source.resolve(after_ns, moving(10.0)) is not None) is is_valid
    assert (source.resolve(after_ns + PERIOD_NS, moving(10.0)) is not None) is is_valid
    assert ("interrupted" in source.invalid_because) is not is_valid
    source.reset()
    again = run(source, [(after_ns + 2 * PERIOD_NS, moving(10.0)), (after_ns + 3 * PERIOD_NS, moving(10.0))])
    assert (again.x_m, source.driven_m) == pytest.approx((0.1, 0.1))
    assert source.invalid_because == ""


@pytest.mark.parametrize(
    "values",
    [
        PoseInputs(),
        PoseInputs(speed_mps=10.0),
        PoseInputs(yaw_rate_radps=0.0),
        PoseInputs(speed_mps=1.0, front_wheel_angle_rad=0.1),
        moving(math.nan),
        moving(1.0, math.inf),
        moving(1.0, 0.0, math.nan),
    ],
)
def test_a_sample_without_its_values_is_passed_over(values: PoseInputs) -> None:
    source = odometry()
    run(source, [(0, moving(10.0))])
    assert source.resolve(PERIOD_NS, values) is None
    assert "without a value" in source.invalid_because
    assert run(source, [(2 * PERIOD_NS, moving(10.0))]).x_m == pytest.approx(0.2)


@pytest.mark.parametrize("angle_rad", [None, math.nan, math.inf])
def test_without_a_wheel_angle_there_is_no_pose(angle_rad: float | None) -> None:
    source = odometry(has_yaw_rate=False)
    assert source.resolve(0, PoseInputs(speed_mps=1.0, front_wheel_angle_rad=angle_rad)) is None
    assert source.resolve(0, PoseInputs(front_wheel_angle_rad=0.1)) is None


def test_a_sample_that_is_older_than_the_last_one_has_no_pose_and_moves_nothing() -> None:
    source = odometry()
    run(source, [(PERIOD_NS, moving(10.0))])
    assert source.resolve(0, moving(10.0)) is None
    assert "older" in source.invalid_because
    assert run(source, [(2 * PERIOD_NS, moving(10.0))]).x_m == pytest.approx(0.1)
