"""A trajectory rejects what does not fit, and cannot be changed."""

import copy
import dataclasses
import pickle
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.values import LINE, NOT_FINITE, refusal
from vehicle_iface import Trajectory

TRAJECTORY_NUMBERS = ["x_m", "y_m", "heading_rad", "speed_mps", "accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad"]


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
def test_neither_a_trajectory_nor_its_copy_can_be_unlocked(line: dict[str, Any], copied: Callable[..., Any]) -> None:
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


def test_omitted_arrays_are_zero() -> None:
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
