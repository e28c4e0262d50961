"""Values of snapshots, unknown where their flag says so or the state is old."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_MS
from vehicle_iface_viewer.panels.text import MAX_SHOWN
from vehicle_iface_viewer.recent import Columns

OLD_STATE_NS = 100 * NS_PER_MS
"""What is known of an older state is not drawn."""
Reader = Callable[[Columns], FloatArray]
"""Returns one value for each snapshot; NaN where it is not known."""


def known(values: FloatArray, is_known: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the values, NaN where they are not known or cannot be drawn."""
    with np.errstate(invalid="ignore"):
        return np.where(is_known & (np.abs(values) < MAX_SHOWN), values, np.nan)


def of_state(name: str, factor: float = 1.0, flag: str = "has_state") -> Reader:
    """Read a column that is known where the state is young, in the column's unit times `factor`."""

    def read(rows: Columns) -> FloatArray:
        is_young = rows["published_ns"] - rows["stamp_ns"] < OLD_STATE_NS
        return known(rows[name] * factor, rows[flag] & rows["has_state"] & is_young)

    return read


def of_flag(name: str, flag: str, factor: float = 1.0) -> Reader:
    """Read a column that is known where `flag` is set, in the column's unit times `factor`."""
    return lambda rows: known(rows[name] * factor, rows[flag])
