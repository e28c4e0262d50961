"""Tables of a profile are read linearly between their rows, and are constant beyond them."""

import pytest

from vehicle_iface.interpolation import interpolate


@pytest.mark.parametrize(
    ("at", "expected"),
    [(-5.0, 0.4), (0.0, 0.4), (5.0, 0.4), (7.5, 0.3), (10.0, 0.2), (15.0, 0.15), (20.0, 0.1), (99.0, 0.1)],
)
def test_a_table_holds_its_first_value_before_its_first_row_and_its_last_one_beyond_the_last(
    at: float, expected: float
) -> None:
    assert interpolate(((5.0, 0.4), (10.0, 0.2), (20.0, 0.1)), at) == pytest.approx(expected)


@pytest.mark.parametrize("at", [-1.0, 3.0, 9.0])
def test_one_row_is_a_constant(at: float) -> None:
    assert interpolate(((3.0, 0.7),), at) == 0.7
