"""Checks reject what does not fit, by name and value."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.values import NOT_FINITE, NOT_NUMBERS, refusal
from vehicle_iface import checks


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_finite_float_passes_unchanged(number: float) -> None:
    assert checks.finite("n", number) == number
    assert type(checks.finite("n", np.float64(number))) is float


@pytest.mark.parametrize("value", [*NOT_FINITE, *NOT_NUMBERS, 10**400])
@pytest.mark.parametrize("check", [checks.finite, checks.positive, checks.non_negative])
def test_numbers_that_are_not_finite_are_refused_by_name(check: Callable[[str, object], float], value: object) -> None:
    assert "n = " in refusal(lambda: check("n", value))


@pytest.mark.parametrize("value", [0.0, -0.0, -5e-324, -1.0])
def test_positive_means_above_zero(value: float) -> None:
    assert f"n = {value}: must be above 0" in refusal(lambda: checks.positive("n", value))
    assert checks.positive("n", 5e-324) == 5e-324


def test_non_negative_takes_zero_and_refuses_the_next_float_below() -> None:
    assert checks.non_negative("n", 0.0) == 0.0
    assert "n = -5e-324" in refusal(lambda: checks.non_negative("n", -5e-324))


@pytest.mark.parametrize("value", [1.0, 1e18, math.nan, True, None, "3", b"3"])
def test_a_stamp_that_is_no_integer_is_refused_even_when_it_is_whole(value: object) -> None:
    assert repr(value) in refusal(lambda: checks.integer("stamp_ns", value))


def test_integers_of_numpy_become_pythons() -> None:
    assert type(checks.integer("n", np.int64(7))) is int


@pytest.mark.parametrize("value", ["", None, 0, b"map", ["map"]])
def test_a_frame_of_reference_without_a_name_is_refused(value: object) -> None:
    assert f"frame_id = {value!r}" in refusal(lambda: checks.frame_id("frame_id", value))


@pytest.mark.parametrize("value", ["m" * 65, "ä" * 33])
def test_a_frame_of_reference_whose_name_is_too_long_is_refused_with_the_limit(value: str) -> None:
    assert "must be at most 64 bytes" in refusal(lambda: checks.frame_id("frame_id", value))
    assert checks.frame_id("frame_id", value[: len(value) - 1]) == value[:-1]


@pytest.mark.parametrize("value", ["a\0b", "map\n", "\ud800"])
def test_a_frame_of_reference_whose_name_cannot_be_printed_is_refused(value: str) -> None:
    assert f"frame_id = {value!r}" in refusal(lambda: checks.frame_id("frame_id", value))
