"""Words and data: what is refused is refused by name and value, and what is built cannot change."""

import copy
import dataclasses
import inspect
import math
import pickle
import sys
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import Command, Reason, Trajectory, VehicleState, checks, clock, errors, units
from vehicle_iface.errors import InvalidValueError, VehicleIfaceError
from vehicle_iface.frame import CanFrame

NOT_FINITE = [math.nan, math.inf, -math.inf]
NOT_NUMBERS = [None, "1.0", b"1", True, False, [], {}, object(), 1j]
STATE: dict[str, Any] = {"stamp_ns": 1, "x_m": 1.0, "y_m": 2.0, "heading_rad": 0.5, "speed_mps": 3.0}
COMMAND: dict[str, Any] = {"stamp_ns": 1, "accel_mps2": 1.0, "front_wheel_angle_rad": 0.1}
STATE_NUMBERS = [f.name for f in dataclasses.fields(VehicleState) if f.name not in ("stamp_ns", "frame_id")]
COMMAND_NUMBERS = [f.name for f in dataclasses.fields(Command) if f.name not in ("stamp_ns", "reason")]
TRAJECTORY_NUMBERS = ["x_m", "y_m", "heading_rad", "speed_mps", "accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad"]
LINE: dict[str, Any] = {
    "stamp_ns": 5,
    "time_from_start_ns": [0, 10, 20],
    "x_m": [0.0, 1.0, 2.0],
    "y_m": [0.0, 0.0, 0.0],
    "heading_rad": [0.0, 0.0, 0.0],
    "speed_mps": [1.0, 1.0, 1.0],
}


def refusal(build: Callable[[], object]) -> str:
    """What the refusal says."""
    with pytest.raises(InvalidValueError) as caught:
        build()
    return str(caught.value)


# Errors


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


# Checks


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_finite_float_passes_unchanged(number: float) -> None:
    assert checks.finite("n", number) == number
    assert type(checks.finite("n", np.float64(number))) is float


@pytest.mark.parametrize("value", [*NOT_FINITE, *NOT_NUMBERS, 10**400])
@pytest.mark.parametrize("check", [checks.finite, checks.positive, checks.non_negative])
def test_what_is_no_finite_number_is_refused_by_name(check: Callable[[str, object], float], value: object) -> None:
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


# Units and clock


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


def test_the_monotonic_clock_is_integer_and_never_goes_back() -> None:
    stamps = [clock.monotonic_ns() for _ in range(1000)]
    assert stamps == sorted(stamps)
    assert all(type(stamp) is int for stamp in stamps)


def test_sleeping_until_a_moment_gone_by_returns_and_until_a_coming_one_waits_for_it() -> None:
    clock.sleep_until(clock.monotonic_ns() - 10**12)
    deadline_ns = clock.monotonic_ns() + 2_000_000
    clock.sleep_until(deadline_ns)
    assert clock.monotonic_ns() >= deadline_ns


# Reasons


def test_the_reasons_have_the_contracts_numbers() -> None:
    page = """
        0 NOMINAL, 1 NO_TRAJECTORY, 2 EMPTY_TRAJECTORY, 3 PAST_END_SPACE, 4 PAST_END_TIME, 5 FRAME_MISMATCH,
        6 STATE_STALE, 7 STATE_INVALID, 8 CONTROLLER_ERROR, 9 DEVIATION, 10 DRIVER_OVERRIDE,
        11 VEHICLE_NOT_AUTONOMOUS, 12 VEHICLE_FAULT, 13 LINK_DOWN, 14 DUPLICATE_COMMANDER, 15 SHUTDOWN,
        16 DEADLINE_MISSED, 17 NOT_ENGAGED
    """
    assert [f"{reason.value} {reason.name}" for reason in Reason] == [entry.strip() for entry in page.split(",")]


# Frames


@pytest.mark.parametrize(("can_id", "is_extended"), [(0, False), (0x7FF, False), (0, True), (0x1FFFFFFF, True)])
def test_identifiers_at_the_ends_of_their_range_are_taken(can_id: int, is_extended: bool) -> None:
    assert CanFrame(can_id, b"", is_extended=is_extended).can_id == can_id


@pytest.mark.parametrize(("can_id", "is_extended"), [(-1, False), (0x800, False), (-1, True), (0x20000000, True)])
def test_an_identifier_that_does_not_fit_is_refused_with_its_value(can_id: int, is_extended: bool) -> None:
    assert f"can_id = {can_id:#x}" in refusal(lambda: CanFrame(can_id, b"", is_extended=is_extended))


@pytest.mark.parametrize(("length", "is_fd"), [(8, False), (64, True)])
def test_a_payload_may_be_full_but_not_one_byte_longer(length: int, is_fd: bool) -> None:
    assert len(CanFrame(1, bytes(length), is_fd=is_fd).data) == length
    text = refusal(lambda: CanFrame(1, bytes(length + 1), is_fd=is_fd))
    assert f"data of {length + 1} bytes: at most {length}" in text


# State and command


@pytest.mark.parametrize("value", [*NOT_FINITE, *NOT_NUMBERS])
@pytest.mark.parametrize("name", STATE_NUMBERS)
def test_a_state_refuses_what_is_no_finite_number_naming_field_and_value(name: str, value: Any) -> None:
    text = refusal(lambda: VehicleState(**STATE | {name: value}))
    assert text.startswith(f"{name} = {value!r}" if not isinstance(value, float) else f"{name} = {value}")


@pytest.mark.parametrize("value", [*NOT_FINITE, *NOT_NUMBERS])
@pytest.mark.parametrize("name", COMMAND_NUMBERS)
def test_a_command_refuses_what_is_no_finite_number_naming_field_and_value(name: str, value: Any) -> None:
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
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, field.name, 0)


@pytest.mark.parametrize("kind", [VehicleState, Command, Trajectory])
def test_data_is_built_by_keyword_alone(kind: Any) -> None:
    with pytest.raises(TypeError):
        kind(1, 2.0, 3.0, 4.0, 5.0, 6.0)


# Trajectories


def test_a_trajectory_copies_and_locks_what_it_is_given() -> None:
    x_m = np.array([0.0, 1.0, 2.0])
    trajectory = Trajectory(**LINE | {"x_m": x_m})
    x_m[:] = 99.0
    assert trajectory.x_m.tolist() == [0.0, 1.0, 2.0]
    for name in [*TRAJECTORY_NUMBERS, "time_from_start_ns"]:
        with pytest.raises(ValueError, match="read-only"):
            getattr(trajectory, name)[0] = 1


@pytest.mark.parametrize("line", [LINE, {name: values and [] for name, values in LINE.items() if name != "stamp_ns"}])
@pytest.mark.parametrize("copied", [lambda t: t, copy.copy, copy.deepcopy, lambda t: pickle.loads(pickle.dumps(t))])
def test_nobody_can_unlock_a_trajectory_nor_a_copy_of_it(line: dict[str, Any], copied: Callable[..., Any]) -> None:
    trajectory = Trajectory(**{"stamp_ns": 5} | line)
    twin = copied(trajectory)
    for field in dataclasses.fields(trajectory):
        ours, theirs = getattr(trajectory, field.name), getattr(twin, field.name)
        if isinstance(theirs, np.ndarray):
            assert theirs.tolist() == ours.tolist()
            with pytest.raises(ValueError, match="WRITEABLE"):
                theirs.setflags(write=True)
        else:
            assert theirs == ours


def test_the_trajectorys_arrays_are_plain_ones_whatever_they_came_from() -> None:
    given = np.array([[0.0, 9.0], [1.0, 9.0], [2.0, 9.0]], dtype=">f4")[:, 0]
    x_m = Trajectory(**LINE | {"x_m": given}).x_m
    assert x_m.tolist() == [0.0, 1.0, 2.0]
    assert x_m.dtype == np.float64
    assert x_m.flags.c_contiguous
    assert x_m.flags.aligned


def test_what_is_not_given_is_zero() -> None:
    trajectory = Trajectory(**LINE)
    for name in ("accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad"):
        assert getattr(trajectory, name).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("name", TRAJECTORY_NUMBERS)
@pytest.mark.parametrize("value", NOT_FINITE)
@pytest.mark.parametrize("index", [0, 1, 2])
def test_a_number_that_is_not_finite_is_named_with_its_index(name: str, value: float, index: int) -> None:
    values = [0.0, 1.0, 2.0]
    values[index] = value
    assert f"{name}[{index}] = {value}" in refusal(lambda: Trajectory(**LINE | {name: values}))


@pytest.mark.parametrize("name", TRAJECTORY_NUMBERS)
@pytest.mark.parametrize("values", [[], [1.0], [1.0] * 2, [1.0] * 4])
def test_arrays_of_another_length_are_refused_with_both_lengths(name: str, values: list[float]) -> None:
    text = refusal(lambda: Trajectory(**LINE | {name: values}))
    assert f"{name} has {len(values)} values: time_from_start_ns has 3" in text


@pytest.mark.parametrize("values", [1.0, [[1.0, 2.0, 3.0]], [[1.0], [2.0], [3.0]]])
def test_arrays_of_another_shape_are_refused(values: Any) -> None:
    assert "x_m of shape" in refusal(lambda: Trajectory(**LINE | {"x_m": values}))


@pytest.mark.parametrize("values", [["a", "b", "c"], [True, False, True], [None] * 3, [1j] * 3, [[1.0], [2.0, 3.0]]])
def test_arrays_of_anything_but_numbers_are_refused(values: Any) -> None:
    assert "y_m" in refusal(lambda: Trajectory(**LINE | {"y_m": values}))


@pytest.mark.parametrize("times", [[0, 10, 9], [0, 20, 10], [5, 4, 6]])
def test_time_that_goes_back_is_refused_at_its_first_step_back(times: list[int]) -> None:
    i = next(i for i in range(1, 3) if times[i] < times[i - 1])
    text = refusal(lambda: Trajectory(**LINE | {"time_from_start_ns": times}))
    assert f"time_from_start_ns[{i}] = {times[i]}" in text


def test_time_may_stand_still_and_may_begin_late_but_not_before_zero() -> None:
    assert len(Trajectory(**LINE | {"time_from_start_ns": [7, 7, 7]})) == 3
    text = refusal(lambda: Trajectory(**LINE | {"time_from_start_ns": [-1, 0, 1]}))
    assert "time_from_start_ns[0] = -1" in text


@pytest.mark.parametrize("times", [[0.0, 1.0, 2.0], np.array([0.0, 1.0, 2.0]), ["0", "1", "2"], [True, True, True]])
def test_times_are_integers(times: Any) -> None:
    assert "time_from_start_ns" in refusal(lambda: Trajectory(**LINE | {"time_from_start_ns": times}))


def test_times_that_do_not_fit_63_bits_are_refused() -> None:
    times = np.array([0, 1, 2**63], dtype=np.uint64)
    assert f"= {2**63}" in refusal(lambda: Trajectory(**LINE | {"time_from_start_ns": times}))


def test_a_trajectory_without_points_is_a_trajectory() -> None:
    empty = Trajectory.empty(stamp_ns=3, frame_id="odom")
    assert (len(empty), empty.stamp_ns, empty.frame_id) == (0, 3, "odom")


@given(st.lists(st.integers(0, 2**62), max_size=20).map(sorted), st.data())
def test_a_trajectory_is_what_it_was_given(times: list[int], data: st.DataObject) -> None:
    numbers = st.lists(st.floats(-sys.float_info.max, sys.float_info.max), min_size=len(times), max_size=len(times))
    given_values: dict[str, Any] = {name: data.draw(numbers) for name in TRAJECTORY_NUMBERS}
    trajectory = Trajectory(stamp_ns=0, time_from_start_ns=np.array(times, dtype=np.int64), **given_values)
    assert trajectory.time_from_start_ns.tolist() == times
    for name, values in given_values.items():
        array = getattr(trajectory, name)
        assert array.dtype == np.float64
        assert array.tolist() == values
