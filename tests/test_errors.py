"""Every error is a VehicleIfaceError and explains itself."""

import inspect
import math

import pytest

from tests.values import STATE
from vehicle_iface import VehicleState, errors
from vehicle_iface.errors import VehicleIfaceError


def test_every_error_is_a_vehicle_iface_error_with_a_line_that_explains_it() -> None:
    kinds = [kind for _, kind in inspect.getmembers(errors, inspect.isclass)]
    assert len(kinds) >= 8
    for kind in kinds:
        assert issubclass(kind, VehicleIfaceError)
        assert (kind.__doc__ or "").strip()


def test_the_tree_in_the_docstring_names_every_error() -> None:
    for name, _ in inspect.getmembers(errors, inspect.isclass):
        assert name in (errors.__doc__ or "")


def test_a_refused_value_is_also_a_value_error() -> None:
    with pytest.raises(ValueError, match="x_m"):
        VehicleState(**STATE | {"x_m": math.nan})
