"""The bicycle without slip: curvature and wheels."""

import math

import pytest

from vehicle_iface.safety.lateral import curvature_per_m, front_angle_rad

from .test_gate import driven, new_gate, wish


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


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("speed_mps", "step_rad"), [(0.0, 0.008), (0.0999, 0.008), (0.1, 0.0027), (0.12, 0.0019)])
def test_from_a_tenth_of_a_metre_a_second_on_the_wheels_are_held_back_by_what_can_be_felt(
    speed_mps: float, step_rad: float, sign: int
) -> None:
    gate = new_gate(lateral_jerk_mps3=0.001)
    (answer,) = driven(gate, wish(front_wheel_angle_rad=sign * 0.6), sign * speed_mps, 1)
    assert answer.front_wheel_angle_rad == pytest.approx(sign * step_rad, abs=1.0001e-4)
