"""The series of a drive at common times, and quantities derived from them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vehicle_iface.profile.state_pose import Mount
from vehicle_iface.review.grid import Grid, choose_window_s
from vehicle_iface.review.series import POSITION, RecordedDrive, Series
from vehicle_iface.trajectory import FloatArray

WHEELBASE, HANDEDNESS = "wheelbase", "handedness"
"""Gains that belong to no field: stated over true wheelbase; −1 where the axes of the position are mirrored."""
COMMANDED = "command."
"""Prefix of the fields of commands."""
_MOVING_SHARE = 0.25
"""Share of a high speed of the drive below which a vehicle counts as standing, without a direction of motion."""


class Kinematics:
    """The series of a drive at common times, and what follows from them."""

    def __init__(
        self,
        drive: RecordedDrive,
        gains: Mapping[str, float] | None = None,
        turn_rad: float = 0.0,
        directions: FloatArray | None = None,
    ) -> None:
        """`gains` (measured over true value) are taken out of the fields, and `turn_rad` is added to the heading.

        `directions` (n,) are the signs of a speed that has none.
        """
        gains = gains or {}
        self.grid = Grid.over(drive.duration_s)
        self.wheelbase_m = drive.database.profile.geometry.wheelbase_m / gains.get(WHEELBASE, 1.0)
        self.window_s = choose_window_s(*drive.state.values())
        self.commands: Mapping[str, Series] = drive.commands
        is_reckoned = drive.database.profile.state.pose.source == "odometry"
        self._values = {
            name: self.grid.resample(_correct(series, gains.get(name, 1.0)))
            for name, series in drive.state.items()
            if not (is_reckoned and name == POSITION)
        }
        if "heading_rad" in self._values:
            self._values["heading_rad"] += turn_rad
        if directions is not None and "speed_mps" in self._values:
            self._values["speed_mps"] *= directions
        if POSITION in self._values:
            self._values[POSITION] *= (1.0, gains.get(HANDEDNESS, 1.0))
            self._move_to_rear_axle(drive.database.profile.state.pose.mount)
        self._commanded = {
            name: self.grid.resample(_correct(series, gains.get(COMMANDED + name, 1.0)))
            for name, series in drive.commands.items()
        }

    def _move_to_rear_axle(self, mount: Mount) -> None:
        """Move the position from the sensor to the rear axle."""
        if (mount.x_m or mount.y_m) and "heading_rad" in self._values:
            cos, sin = np.cos(self._values["heading_rad"]), np.sin(self._values["heading_rad"])
            arm = np.column_stack((cos * mount.x_m - sin * mount.y_m, sin * mount.x_m + cos * mount.y_m))
            self._values[POSITION] -= arm

    def has(self, *fields: str) -> bool:
        """Return whether all fields are in the log."""
        return all(name in self._values for name in fields)

    def value(self, field: str) -> FloatArray:
        """Return (n,) the measured values."""
        return self._values[field]

    def mean(self, field: str) -> FloatArray:
        """Return (n,) the mean over the window around each time."""
        return self.grid.mean(self._values[field], self.window_s)

    def rate(self, field: str) -> FloatArray:
        """Return (n,) the change per second over the window."""
        return self.grid.rate(self._values[field], self.window_s)

    def commanded(self, field: str) -> FloatArray:
        """Return (n,) the mean of a command, NaN while it is not enabled."""
        values = self.grid.mean(self._commanded[field], self.window_s)
        return np.where(self._commanded["enable"] == 1.0, values, np.nan) if "enable" in self._commanded else values

    def velocity(self) -> FloatArray:
        """Return (n, 2) the velocity by the position."""
        position = self._values[POSITION]
        return np.column_stack([self.grid.rate(column, self.window_s) for column in position.T])

    def course_rad(self) -> FloatArray:
        """Return (n,) the direction of motion; NaN where the vehicle hardly moves."""
        east, north = self.velocity().T
        pace = np.hypot(east, north)
        return np.where(is_moving(pace), np.arctan2(north, east), np.nan)

    def course_rate(self) -> FloatArray:
        """Return (n,) the change of the direction of motion in rad/s over another window; NaN where it reverses."""
        course = self.course_rad()
        half = max(1, round(self.window_s / self.grid.step_s / 2.0))
        result = np.full(len(course), np.nan)
        if len(course) > 2 * half:
            change = (course[2 * half :] - course[: -2 * half] + np.pi) % (2.0 * np.pi) - np.pi
            change[np.abs(change) > 0.75 * np.pi] = np.nan
            result[half:-half] = change / (2 * half * self.grid.step_s)
        return result


def _correct(series: Series, gain: float) -> Series:
    """Divide the series by its gain."""
    values = series.values / gain
    return replace(series, values=np.unwrap(values) if series.field == "heading_rad" else values)


def is_moving(speed: FloatArray) -> NDArray[np.bool_]:
    """Return (n,) whether a speed of any unit is great enough for a direction."""
    known = np.abs(speed[np.isfinite(speed)])
    often = float(np.percentile(known, 95)) if len(known) else 0.0
    with np.errstate(invalid="ignore"):
        return np.abs(speed) > max(_MOVING_SHARE * often, 1e-6)
