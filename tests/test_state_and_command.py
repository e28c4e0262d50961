"""State and command reject what is no finite number, and cannot be changed."""

import copy
import dataclasses
import math
import pickle
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from tests.values import COMMAND, LINE, NOT_FINITE, NOT_NUMBERS, STATE, refusal
from vehicle_iface import Command, Reason, Trajectory, VehicleState
from vehicle_iface.errors import InvalidValueError

STATE_NUMBERS = [f.name for f in dataclasses.fields(VehicleState) if f.name not in ("stamp_ns", "frame_id")]
COMMAND_NUMBERS = [f.name for f in dataclasses.fields(Command) if f.name not in ("stamp_ns", "reason")]


@pytest.mark.parametrize("value", [*NOT_FINITE, *NOT_NUMBERS])
@pytest.mark.parametrize("name", STATE_NUMBERS)
def test_a_state_refuses_a_number_that_is_not_finite_naming_field_and_value(name: str, value: Any) -> None:
    text = refusal(lambda: VehicleState(**STATE | {name: value}))
    assert text.startswith(f"{name} = {value!r}" if not isinstance(value, float) else f"{name} = {value}")


@pytest.mark.parametrize("value", [*NOT_FINITE, *NOT_NUMBERS])
@pytest.mark.parametrize("name", COMMAND_NUMBERS)
def test_a_command_refuses_a_number_that_is_not_finite_naming_field_and_value(name: str, value: Any) -> None:
    text = refusal(lambda: Command(**COMMAND | {name: value}))
    assert text.startswith(f"{name} = {value!r}" if not isinstance(value, float) else f"{name} = {value}")


@pytest.mark.parametrize("kind", [VehicleState, Command])
@pytest.mark.parametrize("stamp_ns", [1.0, None, "1", True, math.nan])
def test_a_stamp_is_an_integer(kind: type, stamp_ns: Any) -> None:
    fields = STATE if kind is VehicleState else COMMAND
    assert "stamp_ns" in refusal(lambda: kind(**fields | {"stamp_ns": stamp_ns}))


@pytest.mark.parametrize("reason", [0, 3, "NOMINAL", None])
def test_a_commands_reason_is_a_reason_and_no_number(reason: Any) -> None:
    assert f"reason = {reason!r}" in refusal(lambda: Command(**COMMAND, reason=reason))


def test_only_a_nominal_command_is_no_stop() -> None:
    assert [reason for reason in Reason if not Command(**COMMAND, reason=reason).is_stop] == [Reason.NOMINAL]


@pytest.mark.parametrize("number", [3, np.float32(0.5), np.int64(2), Fraction(1, 2)])
def test_other_kinds_of_numbers_become_plain_floats(number: Any) -> None:
    state = VehicleState(**STATE | {"x_m": number, "stamp_ns": np.int64(4)})
    assert type(state.x_m) is float
    assert state.x_m == float(number)
    assert type(state.stamp_ns) is int


@pytest.mark.parametrize("value", [VehicleState(**STATE), Command(**COMMAND), Trajectory(**LINE)])
def test_data_cannot_be_changed(value: Any) -> None:
    for field in dataclasses.fields(value):
        with pytest.raises(AttributeError):
            setattr(value, field.name, 0)
        with pytest.raises(AttributeError):
            delattr(value, field.name)


@pytest.mark.parametrize(("kind", "given"), [(VehicleState, STATE), (Command, COMMAND)])
def test_the_functions_of_dataclasses_take_state_and_command(kind: Any, given: dict[str, Any]) -> None:
    value = kind(**given)
    assert dataclasses.asdict(value) == {name: getattr(value, name) for name in kind.__annotations__}
    assert dataclasses.replace(value) == value
    assert dataclasses.replace(value, stamp_ns=77).stamp_ns == 77
    with pytest.raises(InvalidValueError):
        dataclasses.replace(value, speed_mps=math.nan)


@pytest.mark.parametrize("value", [VehicleState(**STATE), Command(**COMMAND)])
def test_equal_data_has_one_hash_and_survives_copies_and_pickling(value: Any) -> None:
    for same in (copy.copy(value), copy.deepcopy(value), pickle.loads(pickle.dumps(value))):
        assert same == value
        assert hash(same) == hash(value)
    assert dataclasses.replace(value, speed_mps=value.speed_mps + 1.0) != value
    assert repr(value).startswith(f"{type(value).__name__}(stamp_ns={value.stamp_ns}, ")


@pytest.mark.parametrize("kind", [VehicleState, Command, Trajectory])
def test_data_is_built_by_keyword_alone(kind: Any) -> None:
    with pytest.raises(TypeError):
        kind(1, 2.0, 3.0, 4.0, 5.0, 6.0)
