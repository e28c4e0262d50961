"""Fit of one quantity against another: slope, correlation and lag, each with its uncertainty."""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vehicle_iface.trajectory import FloatArray

MAX_LAG_S = 0.5
_Number = TypeVar("_Number", np.float64, np.complex128)
_OUTLIER = 6.0
"""Residuals beyond this many robust standard deviations are left out …"""
_FLOOR = 0.05
"""… where a standard deviation is at least this share of the quantity itself."""
_ROUNDS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """y(t) = slope · x(t − lag) + offset."""

    slope: float
    slope_error: float
    """Standard deviation of the slope, relative to it."""
    offset: float
    correlation: float
    lag_s: float
    """Lag of y behind x."""
    lag_error_s: float
    """Standard deviation; infinite where nothing changes fast enough to tell."""
    used_s: float
    """Duration of the usable part of the drive."""


@dataclass(frozen=True, slots=True)
class LagEstimate:
    lag_s: float
    error_s: float


def fit(x: FloatArray, y: FloatArray, *, step_s: float, window_s: float, through_origin: bool = False) -> Fit | None:
    """Fit two arrays of one length, in which NaN is missing; None with too little data."""
    lag = _find_lag(x, y, step_s, window_s)
    shift = round(lag.lag_s / step_s) if math.isfinite(lag.error_s) else 0
    x_at, y_at = _shifted(x, y, shift)
    good = np.isfinite(x_at) & np.isfinite(y_at)
    x_at, y_at = x_at[good], y_at[good]
    used_s = len(x_at) * step_s
    independent = used_s / window_s
    if independent < 4.0 or not np.any(x_at) or not np.any(y_at):
        return None
    slope, offset = _fit_line(x_at, y_at, through_origin)
    kept = _inliers(x_at, y_at, slope, offset)
    x_at, y_at = x_at[kept], y_at[kept]
    slope, offset = _solve(x_at, y_at, np.ones(len(x_at)), through_origin)
    correlation = _correlate(x_at, y_at, through_origin) if np.mean(kept) > 0.8 else 0.0
    spread = math.sqrt(max(0.0, 1.0 / correlation**2 - 1.0)) if correlation else math.inf
    return Fit(
        slope=slope,
        slope_error=spread / math.sqrt(independent),
        offset=offset,
        correlation=correlation,
        lag_s=lag.lag_s if math.isfinite(lag.error_s) else 0.0,
        lag_error_s=lag.error_s,
        used_s=used_s,
    )


def find_angular_lag(x_rad: FloatArray, y_rad: FloatArray, *, step_s: float, window_s: float) -> LagEstimate:
    """Return the lag, as in `Fit`, of two angles that differ by a constant."""
    x, y = np.exp(1j * x_rad), np.exp(1j * y_rad)
    steps = min(round(MAX_LAG_S / step_s), len(x) // 4)
    scores = []
    for shift in range(-steps, steps + 1):
        x_at, y_at = _shifted(x, y, shift)
        good = np.isfinite(x_at) & np.isfinite(y_at)
        scores.append(abs(complex(np.mean(y_at[good] * np.conj(x_at[good])))) if np.any(good) else 0.0)
    peak, used = int(np.argmax(scores)), int(np.sum(np.isfinite(x) & np.isfinite(y)))
    if peak in (0, 2 * steps) or not used:
        return LagEstimate(0.0, math.inf)
    turning = _measure_agility(x_rad, step_s, window_s)
    noise = math.sqrt(max(0.0, -2.0 * math.log(max(scores[peak], 1e-9))))
    error_s = noise / (turning * math.sqrt(used * step_s / window_s)) if turning > 0.0 else math.inf
    return LagEstimate((peak - steps + _refine(scores, peak)) * step_s, error_s)


def _find_lag(x: FloatArray, y: FloatArray, step_s: float, window_s: float) -> LagEstimate:
    """Return the lag of the greatest correlation, of either sign."""
    x, y = _clip(x), _clip(y)
    steps = min(round(MAX_LAG_S / step_s), len(x) // 4)
    scores = [abs(_correlate_pairs(*_shifted(x, y, shift))) for shift in range(-steps, steps + 1)]
    peak = int(np.argmax(scores))
    used = int(np.sum(np.isfinite(x) & np.isfinite(y)))
    if peak in (0, 2 * steps) or scores[peak] < 0.5 or used * step_s < 4.0 * window_s:
        return LagEstimate(0.0, math.inf)
    agility = _measure_agility(x, step_s, window_s) / float(np.nanstd(x))  # 1/s
    noise = math.sqrt(max(0.0, 1.0 / scores[peak] ** 2 - 1.0))
    error_s = noise / (agility * math.sqrt(used * step_s / window_s)) if agility > 0.0 else math.inf
    return LagEstimate((peak - steps + _refine(scores, peak)) * step_s, error_s)


def _measure_agility(x: FloatArray, step_s: float, window_s: float) -> float:
    """Measure how much the rate of a quantity changes: a constant rate acts like an offset and determines no lag."""
    half = max(1, round(window_s / step_s))
    rate = (x[2 * half :] - x[: -2 * half]) / (2 * half * step_s)
    return float(np.nanstd(rate)) if np.any(np.isfinite(rate)) else 0.0


def _refine(scores: list[float], peak: int) -> float:
    """Return the maximum of the parabola through the peak and its neighbours, in steps from the peak."""
    before, here, after = scores[peak - 1 : peak + 2]
    bend = before - 2.0 * here + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0


def _shifted(x: NDArray[_Number], y: NDArray[_Number], shift: int) -> tuple[NDArray[_Number], NDArray[_Number]]:
    """Return pairs of x at a time and y a number of steps later."""
    if shift >= 0:
        return x[: len(x) - shift], y[shift:]
    return x[-shift:], y[:shift]


def _clip(values: FloatArray) -> FloatArray:
    good = values[np.isfinite(values)]
    if not len(good):
        return values
    low, high = np.percentile(good, (0.5, 99.5))
    return np.clip(values, low, high)


def _correlate_pairs(x: FloatArray, y: FloatArray) -> float:
    good = np.isfinite(x) & np.isfinite(y)
    return _correlate(x[good], y[good], False) if np.count_nonzero(good) > 2 else 0.0


def _correlate(x: FloatArray, y: FloatArray, through_origin: bool) -> float:
    if not through_origin:
        x, y = x - x.mean(), y - y.mean()
    product = math.sqrt(float(x @ x) * float(y @ y))
    return float(x @ y) / product if product > 0.0 else 0.0


def _fit_line(x: FloatArray, y: FloatArray, through_origin: bool) -> tuple[float, float]:
    """Fit the line of least absolute deviations by reweighted least squares, which is robust to outliers."""
    weights = np.ones(len(x))
    slope, offset = _solve(x, y, weights, through_origin)
    for _ in range(_ROUNDS):
        residual = np.abs(y - slope * x - offset)
        scale = max(float(np.median(residual)), 1e-9)
        slope, offset = _solve(x, y, 1.0 / np.maximum(residual, 0.1 * scale), through_origin)
    return slope, offset


def _solve(x: FloatArray, y: FloatArray, weights: FloatArray, through_origin: bool) -> tuple[float, float]:
    total = float(weights.sum())
    mean_x, mean_y = (0.0, 0.0) if through_origin else (float(weights @ x) / total, float(weights @ y) / total)
    square = float(weights @ (x - mean_x) ** 2)
    slope = float(weights @ ((x - mean_x) * (y - mean_y))) / square if square > 0.0 else 0.0
    return slope, mean_y - slope * mean_x


def _inliers(x: FloatArray, y: FloatArray, slope: float, offset: float) -> NDArray[np.bool_]:
    residual = np.abs(y - slope * x - offset)
    scale = max(1.4826 * float(np.median(residual)), _FLOOR * float(np.sqrt(np.mean(y**2))))
    return residual <= _OUTLIER * scale
