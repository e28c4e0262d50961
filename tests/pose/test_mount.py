"""A sensor's pose becomes that of the rear axle's centre, and the reverse."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.pose import Pose
from vehicle_iface.pose.mount import SensorMount

ARMS_M = st.floats(-20.0, 20.0)
ANGLES_RAD = st.floats(-math.pi, math.pi)
PLACES_M = st.floats(-1e5, 1e5)


@given(ARMS_M, ARMS_M, ANGLES_RAD, PLACES_M, PLACES_M, ANGLES_RAD)
def test_sensor_and_body_convert_into_one_another(
    arm_x_m: float, arm_y_m: float, look_rad: float, x_m: float, y_m: float, heading_rad: float
) -> None:
    mount = SensorMount(x_m=arm_x_m, y_m=arm_y_m, heading_rad=look_rad)
    body = Pose(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    sensor = mount.to_sensor(body)
    again = mount.to_body(sensor)
    assert (again.x_m, again.y_m) == pytest.approx((x_m, y_m), abs=1e-9)
    assert abs(math.remainder(again.heading_rad - heading_rad, math.tau)) < 1e-12
    assert math.hypot(sensor.x_m - x_m, sensor.y_m - y_m) == pytest.approx(math.hypot(arm_x_m, arm_y_m), abs=1e-9)


@pytest.mark.parametrize(
    ("mount", "sensor"),
    [
        (SensorMount(), (10.0, 20.0, math.pi / 2)),
        (SensorMount(x_m=1.2), (10.0, 21.2, math.pi / 2)),  # ahead of the axle: further north
        (SensorMount(y_m=0.5), (9.5, 20.0, math.pi / 2)),  # left of it: further west
        (SensorMount(heading_rad=-math.pi / 2), (10.0, 20.0, 0.0)),  # it looks to the right: east
        (SensorMount(x_m=1.2, y_m=0.5, heading_rad=math.pi / 2), (9.5, 21.2, math.pi)),
    ],
)
def test_a_vehicle_that_looks_north_has_its_sensor_there(
    mount: SensorMount, sensor: tuple[float, float, float]
) -> None:
    body = Pose(x_m=10.0, y_m=20.0, heading_rad=math.pi / 2)
    seen = mount.to_sensor(body)
    assert (seen.x_m, seen.y_m, seen.heading_rad) == pytest.approx(sensor)


def test_the_antenna_of_a_vehicle_that_turns_on_the_spot_moves_and_its_axle_does_not() -> None:
    mount = SensorMount(x_m=1.2, y_m=-0.3, heading_rad=0.1)
    for step in range(100):
        heading_rad = math.remainder(0.1 * step, math.tau)
        body = Pose(x_m=3.0, y_m=4.0, heading_rad=heading_rad)
        again = mount.to_body(mount.to_sensor(body))
        assert (again.x_m, again.y_m) == pytest.approx((3.0, 4.0), abs=1e-12)
        assert abs(again.heading_rad) <= math.pi
