"""Prediction against the same motion integrated in small steps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.control import predict
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.state import VehicleState

GAUSS_AT, GAUSS_WEIGHT = np.polynomial.legendre.leggauss(40)
"""Exact to rounding for a turn of a few radians."""

turn_rates = st.floats(-3.0, 3.0) | st.sampled_from([0.0, 1e-320, 1e-12, -1e-8, 1e-4, 0.2999999, 0.3000001])


def moving(**more: float) -> VehicleState:
    return VehicleState(**{"stamp_ns": 7, "x_m": 1.0, "y_m": -2.0, "heading_rad": 0.5, "speed_mps": 8.0, **more})  # type: ignore[arg-type]


@given(speed=st.floats(-30, 30), accel=st.floats(-5, 5), lateral=st.floats(-2, 2), rate=turn_rates, dt=st.floats(-1, 2))
def test_it_is_the_integral_of_the_motion(speed: float, accel: float, lateral: float, rate: float, dt: float) -> None:
    state = moving(speed_mps=speed, accel_mps2=accel, lateral_speed_mps=lateral, yaw_rate_radps=rate)
    tau = dt / 2 * (GAUSS_AT + 1)
    heading = state.heading_rad + rate * tau
    x = (
        state.x_m
        + dt / 2 * (GAUSS_WEIGHT * ((speed + accel * tau) * np.cos(heading) - lateral * np.sin(heading))).sum()
    )
    y = (
        state.y_m
        + dt / 2 * (GAUSS_WEIGHT * ((speed + accel * tau) * np.sin(heading) + lateral * np.cos(heading))).sum()
    )
    later = predict(state, dt)
    assert later.x_m == pytest.approx(x, abs=2e-13 * (1 + abs(speed)))
    assert later.y_m == pytest.approx(y, abs=2e-13 * (1 + abs(speed)))
    assert later.heading_rad == state.heading_rad + rate * dt
    assert later.speed_mps == state.speed_mps + accel * dt


@given(rate=turn_rates, first=st.floats(0, 1), second=st.floats(0, 1))
def test_two_predictions_in_a_row_are_one(rate: float, first: float, second: float) -> None:
    state = moving(accel_mps2=-2.0, yaw_rate_radps=rate, lateral_speed_mps=0.3)
    twice, once = predict(predict(state, first), second), predict(state, first + second)
    for name in ("x_m", "y_m", "heading_rad", "speed_mps"):
        assert getattr(twice, name) == pytest.approx(getattr(once, name), abs=1e-12)


def test_the_stamp_moves_with_it_and_the_rest_stays() -> None:
    state = moving(accel_mps2=1.0, yaw_rate_radps=0.2, front_wheel_angle_rad=0.1, rear_wheel_angle_rad=-0.1)
    later = predict(state, 0.25)
    assert later.stamp_ns == 250_000_007
    for name in ("accel_mps2", "yaw_rate_radps", "lateral_speed_mps", "front_wheel_angle_rad", "rear_wheel_angle_rad"):
        assert getattr(later, name) == getattr(state, name)
    assert type(later.x_m) is float


def test_no_time_changes_nothing() -> None:
    state = moving(accel_mps2=1.0, yaw_rate_radps=0.2)
    assert predict(state, 0.0) == state


def test_a_full_circle_ends_where_it_began() -> None:
    later = predict(moving(yaw_rate_radps=1.0), math.tau)
    assert (later.x_m, later.y_m) == pytest.approx((1.0, -2.0), abs=1e-12)


def test_acceleration_carries_on_through_standstill() -> None:
    assert predict(moving(speed_mps=1.0, accel_mps2=-2.0), 1.0).speed_mps == -1.0


@pytest.mark.parametrize("dt_s", [math.nan, math.inf, "1"])
def test_a_time_that_is_not_finite_is_refused(dt_s: float) -> None:
    with pytest.raises(InvalidValueError, match="dt_s"):
        predict(moving(), dt_s)
