"""Trajectories: position, heading and speed over time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self, TypeVar

import numpy as np
import numpy.typing as npt
from msgspec.structs import asdict, force_setattr

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.value import Value

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Scalar = TypeVar("Scalar", bound=np.generic)

_REQUIRED = ("x_m", "y_m", "heading_rad", "speed_mps")
_OPTIONAL = ("accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad")


class Trajectory(Value, frozen=True, kw_only=True, eq=False):
    """n points in time order; n = 0 means: stop.

    Arrays are copied into immutable memory, so the caller may change the ones passed; copies of a trajectory are
    immutable, too. Raises `InvalidValueError` naming the field, the index and the value when a number is not finite,
    lengths differ, an array is not one-dimensional, or times are negative or decrease. Equal times of neighbours are
    allowed.
    """

    stamp_ns: int
    """Time 0 of the trajectory, nanoseconds of the monotonic clock."""
    frame_id: str = "map"
    """Frame of reference of `x_m`, `y_m` and `heading_rad`."""
    time_from_start_ns: IntArray
    """(n,) nanoseconds after `stamp_ns`, never decreasing, at least 0."""
    x_m: FloatArray
    """(n,) position of the rear axle's centre."""
    y_m: FloatArray
    """(n,) position of the rear axle's centre."""
    heading_rad: FloatArray
    """(n,) direction of the body's x axis, also where the vehicle reverses."""
    speed_mps: FloatArray
    """(n,) negative where the vehicle reverses."""
    accel_mps2: FloatArray = None  # type: ignore[assignment]  # zeros when not given
    """(n,) along the body's x axis."""
    yaw_rate_radps: FloatArray = None  # type: ignore[assignment]  # zeros when not given
    """(n,) positive to the left."""
    front_wheel_angle_rad: FloatArray = None  # type: ignore[assignment]  # zeros when not given
    """(n,) road-wheel angle, positive to the left."""

    def __post_init__(self) -> None:
        force_setattr(self, "stamp_ns", checks.integer("stamp_ns", self.stamp_ns))
        checks.frame_id("frame_id", self.frame_id)
        times = _times(self.time_from_start_ns)
        force_setattr(self, "time_from_start_ns", times)
        for name in _REQUIRED + _OPTIONAL:
            given = getattr(self, name)
            values = _floats(name, np.zeros(len(times)) if given is None and name in _OPTIONAL else given)
            if len(values) != len(times):
                raise InvalidValueError(f"{name} has {len(values)} values: time_from_start_ns has {len(times)}")
            force_setattr(self, name, values)

    def __deepcopy__(self, _: dict[int, Any]) -> Self:
        """The trajectory itself, because it is immutable."""
        return self

    def __reduce__(self) -> tuple[Callable[..., Trajectory], tuple[type[Trajectory], dict[str, Any]]]:
        """Pickled copies go through the constructor, which checks and locks them."""
        return _rebuilt, (type(self), asdict(self))

    def __len__(self) -> int:
        return len(self.time_from_start_ns)

    @classmethod
    def empty(cls, *, stamp_ns: int, frame_id: str = "map") -> Trajectory:
        """The trajectory without points, which means: stop."""
        none = np.zeros(0)
        return cls(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            time_from_start_ns=np.zeros(0, dtype=np.int64),
            x_m=none,
            y_m=none,
            heading_rad=none,
            speed_mps=none,
        )


def _rebuilt(kind: type[Trajectory], values: dict[str, Any]) -> Trajectory:
    return kind(**values)


def _locked(array: npt.NDArray[Any], kind: type[Scalar]) -> npt.NDArray[Scalar]:
    """A copy of a one-dimensional array in immutable bytes: `setflags` cannot make it writable."""
    values = array.astype(kind, copy=False)
    return np.ndarray(values.shape, values.dtype, values.tobytes())


def _times(given: Any) -> IntArray:
    """`given` as a locked int64 copy, never decreasing."""
    array = _one_dimensional("time_from_start_ns", given)
    if array.size and array.dtype.kind not in "iu":
        raise InvalidValueError(f"time_from_start_ns of type {array.dtype}: must be integer nanoseconds")
    if array.size and array.dtype.kind == "u" and int(array.max()) > np.iinfo(np.int64).max:
        raise InvalidValueError(f"time_from_start_ns = {array.max()}: must fit 63 bits")
    times = _locked(array, np.int64)
    if times.size and times[0] < 0:
        raise InvalidValueError(f"time_from_start_ns[0] = {times[0]}: must be at least 0")
    falls = np.flatnonzero(times[1:] < times[:-1])
    if falls.size:
        i = int(falls[0])
        raise InvalidValueError(f"time_from_start_ns[{i + 1}] = {times[i + 1]}: must not be below [{i}] = {times[i]}")
    return times


def _floats(name: str, given: Any) -> FloatArray:
    """`given` as a locked float64 copy, finite."""
    array = _one_dimensional(name, given)
    if array.size and array.dtype.kind not in "iuf":
        raise InvalidValueError(f"{name} of type {array.dtype}: must be numbers")
    values = _locked(array, np.float64)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise InvalidValueError(f"{name}[{int(bad[0])}] = {values[bad[0]]}: must be a finite number")
    return values


def _one_dimensional(name: str, given: Any) -> npt.NDArray[Any]:
    try:
        array = np.asarray(given)
    except (TypeError, ValueError):
        raise InvalidValueError(f"{name} = {given!r}: must be a sequence of numbers") from None
    if array.ndim != 1:
        raise InvalidValueError(f"{name} of shape {array.shape}: must be (n,)")
    return array
