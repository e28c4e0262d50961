"""Seconds and nanoseconds, and angles within half a turn."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import units


@given(st.integers(-(2**52), 2**52))
def test_seconds_and_nanoseconds_convert_there_and_back(duration_ns: int) -> None:
    assert abs(units.ns_from_s(units.s_from_ns(duration_ns)) - duration_ns) <= 1


@given(st.floats(-1e6, 1e6))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle_rad: float) -> None:
    wrapped = units.wrapped_rad(angle_rad)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle_rad), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle_rad), abs=1e-9)


@given(st.floats(-math.pi, math.pi))
def test_angles_within_half_a_turn_are_left_exactly_as_they_are(angle_rad: float) -> None:
    assert units.wrapped_rad(angle_rad) == angle_rad


def test_just_beyond_half_a_turn_the_angle_changes_its_sign() -> None:
    assert units.wrapped_rad(math.nextafter(math.pi, 4.0)) == pytest.approx(-math.pi)
    assert units.wrapped_rad(math.nextafter(-math.pi, -4.0)) == pytest.approx(math.pi)
