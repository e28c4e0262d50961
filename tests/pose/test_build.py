"""A profile's `[state.pose]` becomes a source of poses, and the sensor of a simulated vehicle."""

import math
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.errors import ConfigError
from vehicle_iface.pose import Pose, PoseInputs, build_pose_sensor, build_pose_source
from vehicle_iface.pose.geographic import Fix
from vehicle_iface.pose.measured import GeographicPosition
from vehicle_iface.pose.mount import SensorMount
from vehicle_iface.profile import Profile, load_profile
from vehicle_iface.profile.state_pose import Mount, StatePose

REFERENCE = load_profile("reference")
ARM = Mount(x_m=1.2, y_m=0.3, heading_rad=0.05)
UTRECHT = (52.0601, 5.1102)


def profile(*, without: tuple[str, ...] = (), **pose: Any) -> Profile:
    signals = msgspec.structs.replace(REFERENCE.state.signals, **dict.fromkeys(without))
    state = msgspec.structs.replace(REFERENCE.state, signals=signals, pose=StatePose(**pose))
    return msgspec.structs.replace(REFERENCE, state=state)


GEOGRAPHIC = profile(source="geographic", origin=UTRECHT, mount=ARM)
FIRST_FIX = profile(source="geographic", mount=ARM)
LOCAL = profile(mount=ARM)


@pytest.mark.parametrize("vehicle", [GEOGRAPHIC, LOCAL])
@given(st.floats(-6e4, 6e4), st.floats(-6e4, 6e4), st.floats(-3.1, 3.1))
def test_a_simulated_measurement_resolves_to_the_same_pose(
    vehicle: Profile, x_m: float, y_m: float, heading_rad: float
) -> None:
    body = Pose(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    pose = build_pose_source(vehicle).resolve(0, build_pose_sensor(vehicle)(body))
    assert pose is not None
    assert (pose.x_m, pose.y_m) == pytest.approx((x_m, y_m), abs=1e-6)
    assert math.remainder(pose.heading_rad - heading_rad, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_without_a_table_the_pose_is_the_bound_one() -> None:
    values = PoseInputs(x_m=1.0, y_m=-2.0, heading_rad=0.5, speed_mps=3.0)
    source = build_pose_source(REFERENCE)
    assert source.resolve(0, values) == Pose(x_m=1.0, y_m=-2.0, heading_rad=0.5)
    assert (source.driven_m, source.invalid_because) == (None, "")


def test_a_heading_beyond_half_a_turn_is_wrapped() -> None:
    pose = build_pose_source(REFERENCE).resolve(0, PoseInputs(x_m=0.0, y_m=0.0, heading_rad=6.0))
    assert pose is not None
    assert pose.heading_rad == pytest.approx(6.0 - math.tau)


def test_the_first_fix_is_the_origin_and_stays_it_after_a_lost_link() -> None:
    source = build_pose_source(profile(source="geographic", origin="first"))
    north = PoseInputs(latitude_deg=52.0, longitude_deg=5.0, heading_rad=math.pi / 2)
    further = PoseInputs(latitude_deg=52.001, longitude_deg=5.0, heading_rad=math.pi / 2)
    assert source.resolve(0, north) == Pose(x_m=0.0, y_m=0.0, heading_rad=math.pi / 2)
    before = source.resolve(1, further)
    assert before is not None
    assert before.y_m == pytest.approx(111.26, abs=0.01)
    source.reset()
    assert source.resolve(2, further) == before


def test_the_mount_counts_from_the_first_fix_too() -> None:
    pose = build_pose_source(FIRST_FIX).resolve(0, PoseInputs(latitude_deg=-33.9, longitude_deg=331.2, heading_rad=0.0))
    expected = SensorMount(x_m=1.2, y_m=0.3, heading_rad=0.05).to_body(Pose(x_m=0.0, y_m=0.0, heading_rad=0.0))
    assert pose == expected


@pytest.mark.parametrize(
    ("fix", "why"),
    [
        ((0.0, 0.0), "no fix yet"),
        ((math.nan, 5.0), "no fix yet"),
        ((52.0, math.inf), "no fix yet"),
        ((90.0, 5.0), "no fix yet"),
        ((None, 5.0), "without a value"),
        ((52.0, None), "without a value"),
    ],
)
def test_the_first_fix_must_be_one(fix: tuple[float | None, float | None], why: str) -> None:
    source = build_pose_source(FIRST_FIX)
    latitude_deg, longitude_deg = fix
    values = PoseInputs(latitude_deg=latitude_deg, longitude_deg=longitude_deg, heading_rad=0.0)
    assert source.resolve(0, values) is None
    assert why in source.invalid_because
    assert source.resolve(1, PoseInputs(latitude_deg=52.0, longitude_deg=5.0, heading_rad=0.0)) is not None
    assert source.invalid_because == ""


def test_a_fix_far_from_the_origin_is_no_pose() -> None:
    source = build_pose_source(GEOGRAPHIC)
    assert source.resolve(0, PoseInputs(latitude_deg=0.0, longitude_deg=0.0, heading_rad=0.0)) is None
    assert "too far from the origin" in source.invalid_because
    source.reset()
    assert source.invalid_because == ""


@pytest.mark.parametrize("heading_rad", [None, math.nan])
@pytest.mark.parametrize("vehicle", [GEOGRAPHIC, LOCAL])
def test_without_a_heading_there_is_no_pose(vehicle: Profile, heading_rad: float | None) -> None:
    values = PoseInputs(x_m=0.0, y_m=0.0, latitude_deg=52.06, longitude_deg=5.11, heading_rad=heading_rad)
    source = build_pose_source(vehicle)
    assert source.resolve(0, values) is None
    assert "without a value" in source.invalid_because


@pytest.mark.parametrize("values", [PoseInputs(y_m=0.0, heading_rad=0.0), PoseInputs(x_m=0.0, heading_rad=0.0)])
def test_without_a_position_there_is_no_local_pose(values: PoseInputs) -> None:
    assert build_pose_source(LOCAL).resolve(0, values) is None


@pytest.mark.parametrize(("without", "turns"), [((), False), (("yaw_rate_radps",), True)])
def test_odometry_turns_by_the_wheels_where_no_yaw_rate_is_bound(without: tuple[str, ...], turns: bool) -> None:
    source = build_pose_source(profile(source="odometry", without=without))
    values = PoseInputs(speed_mps=10.0, yaw_rate_radps=0.0, front_wheel_angle_rad=0.27)
    source.resolve(0, values)
    pose = source.resolve(50_000_000, values)
    assert pose is not None
    wheels_radps = 10.0 * math.tan(0.27) / REFERENCE.geometry.wheelbase_m
    assert pose.heading_rad == pytest.approx(0.05 * wheels_radps if turns else 0.0)
    assert source.driven_m == pytest.approx(0.5)
    assert source.resolve(101_000_000, values) is None  # state_stale_s = 0.05


def test_a_simulated_vehicle_with_odometry_measures_no_position() -> None:
    sense = build_pose_sensor(profile(source="odometry"))
    assert sense(Pose(x_m=1.0, y_m=2.0, heading_rad=3.0)) == PoseInputs()


def test_without_an_origin_a_simulated_vehicle_is_somewhere_on_land() -> None:
    sense: Callable[[Pose], PoseInputs] = build_pose_sensor(profile(source="geographic"))
    values = sense(Pose(x_m=0.0, y_m=0.0, heading_rad=0.0))
    assert (values.latitude_deg, values.longitude_deg) == pytest.approx(UTRECHT)


def test_a_sensor_without_an_origin_measures_nothing() -> None:
    with pytest.raises(ConfigError, match="no origin yet"):
        GeographicPosition(SensorMount(), None).measure(Pose(x_m=0.0, y_m=0.0, heading_rad=0.0))
    with pytest.raises(ConfigError, match="origin latitude"):
        GeographicPosition(SensorMount(), Fix(91.0, 0.0))
