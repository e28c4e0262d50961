"""Units by their spellings."""

import pytest

from vehicle_iface.codec.quantities import Unit, find_unit


@pytest.mark.parametrize(("spelling", "factor"), [("1/m", 1.0), ("rad/m", 1.0), ("1/km", 1e-3), ("km^-1", 1e-3)])
def test_a_curvature_is_per_metre_or_per_kilometre(spelling: str, factor: float) -> None:
    assert find_unit(spelling) == Unit("curvature", factor)


@pytest.mark.parametrize("spelling", ["min", "1/mm", ""])
def test_an_unknown_spelling_is_no_unit(spelling: str) -> None:
    assert find_unit(spelling) is None
