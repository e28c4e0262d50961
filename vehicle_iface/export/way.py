"""The way along the path: a common measure for drives of different speeds."""

from typing import NamedTuple

import numpy as np

from vehicle_iface.telemetry.columns import Columns, Flags
from vehicle_iface.trajectory import FloatArray

JUMP_M = 1.0
"""A reference that moves so much further than the vehicle in one step has changed to another place."""
NEAR_M = 5.0
"""A drive that begins within this distance of the other one's path is aligned with it."""
_HEADING_WEIGHT_M = 3.0
"""Distance that 1 rad counts for: this separates crossing branches."""


def way_along_path(rows: Columns) -> FloatArray:
    """Return how far along its path the vehicle had come at each row, in m (n,); it never decreases.

    It is the length of path that the reference has passed. Where no reference is known, or where it jumps, the
    vehicle's own motion counts.
    """
    ahead = np.where(_path_speed(rows) < 0.0, -1.0, 1.0)
    heading = rows["heading_rad"] - rows["heading_error_rad"]
    of_reference = _progress(rows, "spatial_reference", heading) * ahead[1:]
    of_vehicle = _progress(rows, "", rows["heading_rad"]) * np.where(rows["speed_mps"] < 0.0, -1.0, 1.0)[1:]
    knows_state, knows_reference = (_pairs(rows[flag]) for flag in ("has_state", "has_reference"))
    of_vehicle = np.where(knows_state, of_vehicle, 0.0)
    is_followed = knows_reference & (np.abs(of_reference - of_vehicle) < JUMP_M)
    way_m = np.concatenate([[0.0], np.cumsum(np.where(is_followed, of_reference, of_vehicle))])
    return np.maximum.accumulate(way_m)


def offset_m(first: Columns, first_way_m: FloatArray, second: Columns, second_way_m: FloatArray) -> float | None:
    """Return what to add to the way of the second drive so that both are at the same place of the path at one way.

    None where neither begins on the path of the other.
    """
    if not (first["has_reference"].any() and second["has_reference"].any()):
        return None
    ahead = _begin_on(first, first_way_m, second, second_way_m)
    behind = _begin_on(second, second_way_m, first, first_way_m)
    if not min(ahead.distance_m, behind.distance_m) <= NEAR_M:
        return None
    return ahead.way_m if ahead.distance_m <= behind.distance_m else -behind.way_m


class _Begin(NamedTuple):
    """Where on one path another one begins, and how far beside it."""

    distance_m: float
    way_m: float


def _begin_on(first: Columns, first_way_m: FloatArray, second: Columns, second_way_m: FloatArray) -> _Begin:
    begins, known = np.flatnonzero(second["has_reference"]), np.flatnonzero(first["has_reference"])
    begin = second[begins[0]]
    there = first[known]
    distance = np.hypot(
        there["spatial_reference_x_m"] - begin["spatial_reference_x_m"],
        there["spatial_reference_y_m"] - begin["spatial_reference_y_m"],
    )
    turn = (there["heading_rad"] - there["heading_error_rad"]) - (begin["heading_rad"] - begin["heading_error_rad"])
    cost = distance + _HEADING_WEIGHT_M * np.abs(np.angle(np.exp(1j * turn)))
    nearest = int(np.argmin(np.where(np.isfinite(cost), cost, np.inf)))
    return _Begin(float(distance[nearest]), float(first_way_m[known[nearest]] - second_way_m[begins[0]]))


def _path_speed(rows: Columns) -> FloatArray:
    """The reference's speed; where it is 0 or unknown, the one before."""
    speed = np.where(rows["has_reference"], rows["reference_speed_mps"], 0.0)
    places = np.maximum.accumulate(np.where(speed != 0.0, np.arange(len(speed)), 0))
    last: FloatArray = speed[places]
    return last


def _progress(rows: Columns, name: str, heading: FloatArray) -> FloatArray:
    """The steps of a point along a heading (n − 1,)."""
    x, y = ((f"{name}_{axis}_m" if name else f"{axis}_m") for axis in "xy")
    ahead: FloatArray = np.diff(rows[x]) * np.cos(heading[1:]) + np.diff(rows[y]) * np.sin(heading[1:])
    return np.where(np.isfinite(ahead), ahead, 0.0)


def _pairs(flags: Flags) -> Flags:
    """Whether a flag is set in a row and in the one before (n − 1,)."""
    both: Flags = flags[1:] & flags[:-1]
    return both
