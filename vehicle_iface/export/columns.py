"""The snapshots of a recording as columns."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.units import NS_PER_MS

Columns = npt.NDArray[np.void]
"""Structured array: one row for each snapshot, one column for each of its numbers."""
Flags = npt.NDArray[np.bool_]

GAP_NS = 250 * NS_PER_MS
"""After a longer time without a snapshot nothing is known of the time between."""
UNKNOWN = -1
"""`controller_state` of a row at the beginning of such a gap; all its flags are false."""
_KINDS = {"int": "i8", "bool": "?", "float": "f8"}
_TYPES = {name: str(getattr(kind, "__forward_arg__", kind)) for name, kind in Snapshot.__annotations__.items()}
_NUMBERS = [name for name in Snapshot._fields if _TYPES[name] in _KINDS]
_PLACES = [Snapshot._fields.index(name) for name in _NUMBERS]
_FLAGS = [name for name in _NUMBERS if _TYPES[name] == "bool"]
_INTEGERS = [Snapshot._fields.index(name) for name in _NUMBERS if _TYPES[name] == "int"]
_TOO_LARGE = 2**62
_ROW = np.dtype([(name, _KINDS[_TYPES[name]]) for name in _NUMBERS])


def to_columns(snapshots: Iterable[Snapshot]) -> Columns:
    """Return snapshots in the order of time, with one more row of unknown values at the beginning of each gap."""
    rows = np.fromiter((tuple(one[place] for place in _PLACES) for one in snapshots if _fits(one)), _ROW)
    return _mark_gaps(rows[np.argsort(rows["published_ns"], kind="stable")])


def _fits(snapshot: Snapshot) -> bool:
    """Whether its integers fit; those of a damaged recording may not."""
    return all(abs(int(snapshot[place])) < _TOO_LARGE for place in _INTEGERS)


def _mark_gaps(rows: Columns) -> Columns:
    times_ns = rows["published_ns"]
    before = np.flatnonzero(np.diff(times_ns) > GAP_NS)
    marks = rows[before].copy()
    marks["published_ns"] += 1
    marks["controller_state"] = UNKNOWN
    for flag in _FLAGS:
        marks[flag] = False
    return np.insert(rows, before + 1, marks)
