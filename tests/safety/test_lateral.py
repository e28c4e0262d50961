"""The bicycle without slip: curvature and wheels, and what the speed leaves of it."""

import math

import pytest

from vehicle_iface.safety.lateral import SLOW_MPS, curvature_per_m, front_angle_rad, greatest_curvature_per_m


@pytest.mark.parametrize(
    ("front_rad", "rear_rad", "expected_per_m"),
    [
        (math.atan(0.3), 0.0, 0.1),
        (0.0, math.atan(0.3), -0.1),
        (math.atan(0.3), -math.atan(0.3), 0.2),
        (math.atan(0.9), math.atan(0.9), 0.0),
    ],
)
def test_a_path_bends_by_the_difference_of_the_wheels_tangents(
    front_rad: float, rear_rad: float, expected_per_m: float
) -> None:
    assert curvature_per_m(front_rad, rear_rad, 3.0) == pytest.approx(expected_per_m)
    assert front_angle_rad(expected_per_m, rear_rad, 3.0) == pytest.approx(front_rad)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_greatest_curvature_falls_with_the_square_of_the_speed_either_way(sign: float) -> None:
    assert greatest_curvature_per_m(3.0, sign * 10.0) == pytest.approx(0.03)
    assert greatest_curvature_per_m(3.0, sign * 20.0) == pytest.approx(0.0075)


def test_a_vehicle_slower_than_a_tenth_of_a_metre_per_second_is_not_held_back() -> None:
    assert SLOW_MPS == 0.1
    assert greatest_curvature_per_m(3.0, 0.0) == math.inf
    assert greatest_curvature_per_m(3.0, -math.nextafter(0.1, 0.0)) == math.inf
    assert greatest_curvature_per_m(3.0, 0.1) == pytest.approx(300.0)
