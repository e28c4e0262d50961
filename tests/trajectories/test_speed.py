"""Speed profiles: never above a limit, and never lower than the limits make them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.trajectories import speed
from vehicle_iface.trajectory import FloatArray

ACCEL, DECEL = 1.0, 1.5
LIMITS = st.lists(st.floats(0.0, 20.0), min_size=3, max_size=40).map(np.array)
STEPS_M = st.floats(0.05, 5.0)


def stretches(s_m: FloatArray, reached: FloatArray) -> FloatArray:
    return np.diff(reached**2) / (2.0 * np.diff(s_m))


@given(limit=LIMITS, step_m=STEPS_M)
def test_the_profile_keeps_every_limit_and_touches_one_at_each_point(limit: FloatArray, step_m: float) -> None:
    s_m = step_m * np.arange(len(limit), dtype=np.float64)
    reached = speed.reachable_mps(s_m, limit, accel_mps2=ACCEL, decel_mps2=DECEL)
    accel = stretches(s_m, reached)
    assert np.all(reached <= limit + 1e-6)
    assert np.all(accel <= ACCEL + 1e-6)
    assert np.all(accel >= -DECEL - 1e-6)
    at_limit = np.isclose(reached, limit, atol=1e-5)
    speeding_up = np.append(False, np.isclose(accel, ACCEL, atol=1e-5))
    slowing_down = np.append(np.isclose(accel, -DECEL, atol=1e-5), False)
    assert np.all(at_limit | speeding_up | slowing_down)


@given(limit=LIMITS, step_m=STEPS_M, laps=st.integers(2, 4))
def test_a_closed_profile_is_that_of_the_same_path_driven_for_ever(limit: FloatArray, step_m: float, laps: int) -> None:
    limit = np.append(limit, limit[0])
    s_m = step_m * np.arange(len(limit), dtype=np.float64)
    cyclic = speed.reachable_cyclic_mps(s_m, limit, accel_mps2=ACCEL, decel_mps2=DECEL)
    many = np.append(np.tile(limit[:-1], 2 * laps + 1), limit[0])
    endless = speed.reachable_mps(
        step_m * np.arange(len(many), dtype=np.float64), many, accel_mps2=ACCEL, decel_mps2=DECEL
    )
    middle = laps * (len(limit) - 1)
    assert cyclic == pytest.approx(endless[middle : middle + len(limit)], abs=1e-5)
    assert cyclic[0] == pytest.approx(cyclic[-1], abs=1e-5)


@given(curvature=st.lists(st.floats(-2.0, 2.0), min_size=1).map(np.array))
def test_the_lateral_limit_is_the_speed_limit_or_exactly_the_acceleration(curvature: FloatArray) -> None:
    limit = speed.lateral_limit_mps(curvature, speed_mps=5.0, lateral_accel_mps2=1.5)
    lateral = limit**2 * np.abs(curvature)
    assert np.all((limit == 5.0) | np.isclose(lateral, 1.5))
    assert np.all(lateral <= 1.5 + 1e-12)
    assert np.all(limit <= 5.0)


def test_times_and_accelerations_are_those_of_the_textbook() -> None:
    s_m, speeds = np.array([0.0, 2.0, 6.0]), np.array([0.0, 2.0, 2.0])
    assert speed.durations_s(s_m, speeds).tolist() == [2.0, 2.0]
    assert speed.accelerations_mps2(s_m, speeds).tolist() == [1.0, 0.0, 0.0]
