"""The snapshots of a recording as columns."""

from collections.abc import Iterable

import numpy as np

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.columns import GAP_NS, NUMBERS, PLACES, ROW, TYPES, Columns
from vehicle_iface.units import NS_PER_S

UNKNOWN = -1
"""`controller_state` of a row at the beginning of such a gap; all its flags are false."""
_FLAGS = [name for name in NUMBERS if TYPES[name] == "bool"]
_INTEGERS = [Snapshot._fields.index(name) for name in NUMBERS if TYPES[name] == "int"]
_FLOATS = [name for name in NUMBERS if TYPES[name] == "float"]
_DAY_NS = 86_400 * NS_PER_S
_TOO_LARGE, _ABSURD = 2**61, 1e12


def to_columns(snapshots: Iterable[Snapshot]) -> Columns:
    """Return snapshots in the order of time, with one more row of unknown values at the beginning of each gap.

    Numbers that are not finite, or absurd, are NaN. A row of another day than most is left out as damaged.
    """
    rows = np.fromiter((tuple(one[place] for place in PLACES) for one in snapshots if _fits(one)), ROW)
    rows = rows[np.argsort(rows["published_ns"], kind="stable")]
    if len(rows):
        rows = rows[np.abs(rows["published_ns"] - rows["published_ns"][len(rows) // 2]) < _DAY_NS]
    for name in _FLOATS:
        with np.errstate(invalid="ignore"):
            rows[name][~(np.abs(rows[name]) < _ABSURD)] = np.nan
    return _mark_gaps(rows)


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
