"""The zero of the heading: the direction of motion against the heading, once sign and unit are known."""

import cmath
import math
from dataclasses import dataclass

import numpy as np

from vehicle_iface.review.delays import Lag
from vehicle_iface.review.fits import find_angular_lag
from vehicle_iface.review.kinematics import Kinematics
from vehicle_iface.review.series import POSITION
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import wrapped_rad

TOLERANCE_RAD = math.radians(5.0)
_SURE = 0.9
_LEAST_S = 5.0
_SURE_AXIS = 0.95
"""Minimum concentration of the axis of motion, regardless of its sense."""
_LEAST_BACKWARDS_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingOffset:
    """True heading = measured heading, in its right sign and unit, + offset."""

    offset_rad: float
    """In [−π, π]."""
    concentration: float
    """1 where the offset is constant."""
    used_s: float
    lag: Lag

    @property
    def is_known(self) -> bool:
        """Whether the drive determines the zero."""
        return self.concentration >= _SURE and self.used_s >= _LEAST_S

    @property
    def is_wrong(self) -> bool:
        """Whether the offset is larger than a misalignment of a sensor."""
        return self.is_known and abs(self.offset_rad) > TOLERANCE_RAD


def find_directions(motion: Kinematics) -> FloatArray | None:
    """Return (n,) −1 where a vehicle with an unsigned speed drives backwards, else 1; None with a signed speed."""
    if not motion.has(POSITION, "heading_rad", "speed_mps") or np.nanmin(motion.value("speed_mps"), initial=0.0) < -0.1:
        return None
    difference = np.exp(1j * (motion.course_rad() - motion.mean("heading_rad")))
    known = difference[np.isfinite(difference)]
    axis = complex(np.mean(known**2)) if len(known) else 0j
    if abs(axis) < _SURE_AXIS:
        return None
    along = (difference * cmath.exp(-0.5j * cmath.phase(axis))).real
    back_s, ahead_s = (motion.grid.step_s * np.count_nonzero(one) for one in (along < 0.0, along > 0.0))
    return np.where(along < 0.0, -1.0, 1.0) if min(back_s, ahead_s) >= _LEAST_BACKWARDS_S else None


def measure_heading_offset(motion: Kinematics, turned_rad: float = 0.0) -> HeadingOffset | None:
    """Measure the offset of a motion with the right signs and units, whose heading is turned by a known angle already.

    None where position, heading or speed is not in the log.
    """
    if not motion.has(POSITION, "heading_rad", "speed_mps"):
        return None
    heading = motion.mean("heading_rad")
    course = motion.course_rad() + np.where(motion.mean("speed_mps") < 0.0, np.pi, 0.0)
    difference = np.exp(1j * (course - heading))
    known = difference[np.isfinite(difference)]
    mean = complex(np.mean(known)) if len(known) else 0j
    grid = motion.grid
    lag = find_angular_lag(heading, course, step_s=grid.step_s, window_s=motion.window_s)
    return HeadingOffset(
        offset_rad=wrapped_rad(cmath.phase(mean) + turned_rad),
        concentration=abs(mean),
        used_s=len(known) * grid.step_s,
        lag=Lag(y=POSITION, x="heading_rad", lag_s=lag.lag_s, error_s=lag.error_s),
    )
