"""The bicycle without slip: curvature and wheels."""

import math

import pytest

from vehicle_iface.safety.lateral import curvature_per_m, front_angle_rad


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
