"""The laws between the fields of a drive, measured.

A `Relation` is y against x, which should have the slope 1. Its slope is a product of the gains (measured over true
value) of the fields that it is made of, each with a power: `powers`.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from vehicle_iface.review.fits import Fit, fit
from vehicle_iface.review.kinematics import COMMANDED, HANDEDNESS, WHEELBASE, Kinematics, is_moving
from vehicle_iface.review.series import POSITION
from vehicle_iface.trajectory import FloatArray

SURE, DOUBTFUL = 0.8, 0.5
"""Correlations: from the first on a slope is used; below the second there is no relation."""
_TURNING_RADPS = 0.03
_ANGLE_RAD = 0.015
_GREATEST_ANGLE_RAD = 1.0
"""Largest plausible angle of a road wheel."""
_SPEED_MPS = 0.5
_ACCEL_MPS2 = 0.25
_SURE_ERROR = 0.05
"""Relative error of a slope below which any amount of data is enough."""
_NOISE_SHARE = 0.6
_CONSTANT_SHARE, _ONE_SIDED_TOLERANCE = 0.3, 0.08
"""Nearly constant: a spread below this share; then the slope includes a sensor's offset, and has more tolerance."""
_LEAST_S = 5.0
"""Minimum duration of values of both sides at once."""


class Outcome(Enum):
    """Result of measuring a relation."""

    MEASURED = "measured"
    UNCLEAR = "unclear"
    """Not enough data in the drive."""
    UNRELATED = "unrelated"
    """Enough data, but the two sides are not correlated."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Relation:
    """One law, measured."""

    key: str
    title: str
    y: str
    """Name of the field that is late by `fit.lag_s`."""
    x: str
    y_text: str
    x_text: str
    unit: str
    powers: Mapping[str, int]
    is_signed: bool
    tolerance: float
    """Relative tolerance of the slope."""
    outcome: Outcome
    why: str
    """Reason for an outcome that is not `MEASURED`."""
    fit: Fit | None
    times_s: FloatArray
    """(n,)"""
    y_values: FloatArray
    x_values: FloatArray

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields whose gains determine the slope."""
        return tuple(self.powers)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Law:
    key: str
    title: str
    y: str
    x: str
    y_text: str
    x_text: str
    unit: str
    powers: Mapping[str, int]
    tolerance: float
    least: float
    """Minimum standard deviation of either side."""
    short: str
    """Text on missing motion, if there is too little."""
    is_signed: bool = True
    through_origin: bool = False


def measure_relations(motion: Kinematics) -> Iterator[Relation]:
    """Measure every law whose fields are in the log."""
    if motion.has("yaw_rate_radps", "heading_rad"):
        yield _measure(motion, _HEADING_YAW, motion.mean("yaw_rate_radps"), motion.rate("heading_rad"))
    if motion.has("yaw_rate_radps", "speed_mps", "front_wheel_angle_rad"):
        yield _measure(motion, _WHEEL_YAW, *_curvatures(motion))
    if motion.has("speed_mps", "accel_mps2"):
        yield _measure(motion, _SPEED_ACCEL, motion.mean("accel_mps2"), motion.rate("speed_mps"))
    if motion.has(POSITION, "speed_mps"):
        pace = np.hypot(*motion.velocity().T)
        yield _measure(motion, _DISTANCE, np.abs(motion.mean("speed_mps")), pace)
    if motion.has(POSITION, "heading_rad"):
        smooth = motion.grid.mean(motion.rate("heading_rad"), motion.window_s)
        yield _measure(motion, _COURSE_HEADING, smooth, motion.course_rate())
    if motion.has(POSITION, "yaw_rate_radps"):
        smooth = motion.grid.mean(motion.mean("yaw_rate_radps"), motion.window_s)
        yield _measure(motion, _COURSE_YAW, smooth, motion.course_rate())
    for field, law in _COMMANDS.items():
        if field in motion.commands and motion.has(field):
            measured, commanded = motion.mean(field), motion.commanded(field)
            yield _measure(motion, law, commanded, np.where(np.isfinite(commanded), measured, np.nan))


def _curvatures(motion: Kinematics) -> tuple[FloatArray, FloatArray]:
    """Return tan of the measured wheel angle, and of that implied by the turn: wheelbase · yaw rate / speed.

    Of an angle that no road wheel has (of the steering wheel, in degrees) it is the angle itself.
    """
    speed, yaw_rate = motion.mean("speed_mps"), motion.mean("yaw_rate_radps")
    angle = motion.mean("front_wheel_angle_rad")
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = motion.wheelbase_m * yaw_rate / np.where(is_moving(speed), speed, np.nan)
        if motion.has("rear_wheel_angle_rad"):
            rear = motion.mean("rear_wheel_angle_rad")
            turn += np.where(np.abs(rear) < _GREATEST_ANGLE_RAD, np.tan(rear), 0.0)
        is_road_wheel = not np.any(np.abs(angle) > _GREATEST_ANGLE_RAD)
    return np.tan(angle) if is_road_wheel else angle, turn


def _measure(motion: Kinematics, law: _Law, x: FloatArray, y: FloatArray) -> Relation:
    step_s, window_s = motion.grid.step_s, motion.window_s
    if _is_constant(x) and _is_constant(y):
        law = replace(law, through_origin=True, tolerance=law.tolerance + _ONE_SIDED_TOLERANCE)
    found = fit(x, y, step_s=step_s, window_s=window_s, through_origin=law.through_origin)
    outcome, why = _judge(law, found, x, y, motion)
    return Relation(
        key=law.key,
        title=law.title,
        y=law.y,
        x=law.x,
        y_text=law.y_text,
        x_text=law.x_text,
        unit=law.unit,
        powers=law.powers,
        is_signed=law.is_signed,
        tolerance=law.tolerance,
        outcome=outcome,
        why=why,
        fit=found,
        times_s=motion.grid.times_s,
        y_values=y,
        x_values=x,
    )


def _judge(law: _Law, found: Fit | None, x: FloatArray, y: FloatArray, motion: Kinematics) -> tuple[Outcome, str]:
    step_s = motion.grid.step_s
    apart = 2 * round(motion.window_s / step_s)
    noisy = [not law.through_origin and _is_noise(values, apart) for values in (x, y)]
    size: Callable[[FloatArray], float] = _rms if law.through_origin else _deviation
    sizes = [0.0 if is_noise else size(values) for values, is_noise in zip((x, y), noisy, strict=True)]
    is_enough = sizes[0] >= law.least if law.x.startswith(COMMANDED) else max(sizes) >= law.least
    if found is not None and abs(found.correlation) >= SURE and (is_enough or found.slope_error < _SURE_ERROR):
        return Outcome.MEASURED, ""
    both_s = step_s * np.count_nonzero(np.isfinite(x) & np.isfinite(y))
    if not is_enough or both_s < _LEAST_S:
        return Outcome.UNCLEAR, f"not enough {law.short} to tell"
    if any(noisy) or (found is not None and abs(found.correlation) >= DOUBTFUL):
        return Outcome.UNCLEAR, f"too noisy to tell, or too little {law.short}"
    return Outcome.UNRELATED, f"{law.y_text} does not follow {law.x_text}"


def _is_noise(values: FloatArray, apart: int) -> bool:
    """Return whether values `apart` samples apart are nearly uncorrelated."""
    if len(values) <= 2 * apart:
        return True
    middle = values[apart:-apart] - 0.5 * (values[: -2 * apart] + values[2 * apart :])
    return _deviation(middle) > _NOISE_SHARE * math.sqrt(1.5) * _deviation(values)


def _is_constant(values: FloatArray) -> bool:
    """Return whether the quantity is mostly one value other than 0, as on a circle."""
    return 0.0 < _deviation(values) < _CONSTANT_SHARE * _rms(values)


def _deviation(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.std(known)) if len(known) else 0.0


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


_HEADING_YAW = _Law(
    key="heading_yaw",
    title="Heading rate against yaw rate",
    y="heading_rad",
    x="yaw_rate_radps",
    y_text="heading rate",
    x_text="yaw rate",
    unit="rad/s",
    powers={"heading_rad": 1, "yaw_rate_radps": -1},
    tolerance=0.06,
    least=_TURNING_RADPS,
    short="turning",
)
_WHEEL_YAW = _Law(
    key="wheel_yaw",
    title="Turn, wheelbase · yaw rate / speed, against tan(wheel angle)",
    y="yaw_rate_radps",
    x="front_wheel_angle_rad",
    y_text="turn",
    x_text="tan(wheel angle)",
    unit="1",
    powers={"yaw_rate_radps": 1, "speed_mps": -1, "front_wheel_angle_rad": -1, WHEELBASE: 1},
    tolerance=0.07,
    least=_ANGLE_RAD,
    short="turning",
)
_SPEED_ACCEL = _Law(
    key="speed_accel",
    title="Speed rate against acceleration",
    y="speed_mps",
    x="accel_mps2",
    y_text="speed rate",
    x_text="acceleration",
    unit="m/s²",
    powers={"speed_mps": 1, "accel_mps2": -1},
    tolerance=0.25,
    least=_ACCEL_MPS2,
    short="accelerating and braking",
)
_DISTANCE = _Law(
    key="distance",
    title="Position rate against speed",
    y=POSITION,
    x="speed_mps",
    y_text="position rate",
    x_text="speed",
    unit="m/s",
    powers={POSITION: 1, "speed_mps": -1},
    tolerance=0.05,
    least=_SPEED_MPS,
    short="driving",
    is_signed=False,
    through_origin=True,
)
_COURSE_HEADING = _Law(
    key="course_heading",
    title="Turning of the direction of motion against that of the heading",
    y=POSITION,
    x="heading_rad",
    y_text="course rate",
    x_text="heading rate",
    unit="rad/s",
    powers={HANDEDNESS: 1, "heading_rad": -1},
    tolerance=0.08,
    least=_TURNING_RADPS,
    short="turning",
)
_COURSE_YAW = _Law(
    key="course_yaw",
    title="Turning of the direction of motion against yaw rate",
    y=POSITION,
    x="yaw_rate_radps",
    y_text="course rate",
    x_text="yaw rate",
    unit="rad/s",
    powers={HANDEDNESS: 1, "yaw_rate_radps": -1},
    tolerance=0.08,
    least=_TURNING_RADPS,
    short="turning",
)


def _command_law(field: str, what: str, unit: str, tolerance: float, least: float) -> _Law:
    return _Law(
        key=f"command_{field}",
        title=f"Measured {what} against the commanded one",
        y=field,
        x=COMMANDED + field,
        y_text=f"measured {what}",
        x_text=f"commanded {what}",
        unit=unit,
        powers={field: 1, COMMANDED + field: -1},
        tolerance=tolerance,
        least=least,
        short=f"commanded change of the {what}",
    )


_COMMANDS = {
    "front_wheel_angle_rad": _command_law("front_wheel_angle_rad", "wheel angle", "rad", 0.25, _ANGLE_RAD),
    "accel_mps2": _command_law("accel_mps2", "acceleration", "m/s²", 0.5, _ACCEL_MPS2),
    "speed_mps": _command_law("speed_mps", "speed", "m/s", 0.3, _SPEED_MPS),
}
