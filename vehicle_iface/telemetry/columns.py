"""Snapshots as columns, and their values for a plot: unknown where their flag says so, or where the state is old."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from vehicle_iface.reason import Reason
from vehicle_iface.telemetry.snapshot import Snapshot
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_MS

Columns = npt.NDArray[np.void]
"""Structured array: one row for each snapshot, one column for each of its numbers."""
Flags = npt.NDArray[np.bool_]
Reader = Callable[[Columns], FloatArray]
"""Returns one value for each snapshot; NaN where it is not known."""

_KINDS = {"int": "i8", "bool": "?", "float": "f8"}
TYPES = {name: str(getattr(kind, "__forward_arg__", kind)) for name, kind in Snapshot.__annotations__.items()}
"""Type of each field of a snapshot, as text."""
NUMBERS = [name for name in Snapshot._fields if TYPES[name] in _KINDS]
"""Fields of a snapshot that are columns."""
PLACES = [Snapshot._fields.index(name) for name in NUMBERS]
"""Their places in a snapshot."""
ROW = np.dtype([(name, _KINDS[TYPES[name]]) for name in NUMBERS])

OLD_STATE_NS = 100 * NS_PER_MS
"""What is known of an older state is not drawn."""
GAP_NS = 250 * NS_PER_MS
"""Nothing is drawn between known values that are farther apart: two periods of the slowest usual signal, 100 ms, and a
margin. A shorter time would draw such a signal, or one of a busy machine, as dots."""
ROUNDING_MPS2, ROUNDING_RAD = 0.05, 0.005
"""A command that differs by less from the request was rounded, not limited."""
LARGEST = 1e12
"""A number that is not smaller is not drawn."""


def known(values: FloatArray, is_known: Flags) -> FloatArray:
    """Return the values, NaN where they are not known or cannot be drawn."""
    with np.errstate(invalid="ignore"):
        return np.where(is_known & (np.abs(values) < LARGEST), values, np.nan)


def of_state(name: str, factor: float = 1.0, flag: str = "has_state") -> Reader:
    """Read a column that is known where the state is young, in the column's unit times `factor`."""

    def read(rows: Columns) -> FloatArray:
        is_young = rows["published_ns"] - rows["stamp_ns"] < OLD_STATE_NS
        return known(rows[name] * factor, rows[flag] & rows["has_state"] & is_young)

    return read


def of_flag(name: str, flag: str, factor: float = 1.0) -> Reader:
    """Read a column that is known where `flag` is set, in the column's unit times `factor`."""
    return lambda rows: known(rows[name] * factor, rows[flag])


def of_limited(name: str, rounding: float, factor: float = 1.0) -> Reader:
    """Read what was sent where a limit has changed what was requested."""
    return lambda rows: known(rows[f"sent_{name}"] * factor, is_limited(rows, name, rounding))


def is_limited(rows: Columns, name: str, rounding: float) -> Flags:
    """Return whether what was sent differs from the request; a stop replaces the request and is no limit (n,)."""
    with np.errstate(invalid="ignore"):
        differs = np.abs(rows[f"requested_{name}"] - rows[f"sent_{name}"]) > rounding
    found: Flags = rows["sent"] & rows["has_requested"] & (rows["reason"] == Reason.NOMINAL) & differs
    return found
