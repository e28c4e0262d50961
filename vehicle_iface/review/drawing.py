"""Plots as inline SVG. Their sizes are fixed, their colours come from the page."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from vehicle_iface.trajectory import FloatArray

MAX_POINTS = 900
"""Maximum number of points of a curve: twice the number of pixels."""
MAX_DOTS = 700


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """One line of a plot."""

    name: str
    style: str
    """CSS class of the line."""
    x: FloatArray
    y: FloatArray


@dataclass(frozen=True, slots=True)
class _Axis:
    low: float
    high: float

    @classmethod
    def over(cls, *values: FloatArray) -> "_Axis":
        """Return an axis over the values, without the most extreme 0.4 %."""
        known = np.concatenate([one[np.isfinite(one)] for one in values])
        if not len(known):
            return cls(-1.0, 1.0)
        low, high = np.percentile(known, (0.2, 99.8))
        margin = 0.06 * (high - low) or abs(high) * 0.1 or 1.0
        return cls(float(low - margin), float(high + margin))

    def ticks(self, most: int) -> list[float]:
        """Return round numbers within the axis."""
        step = 10.0 ** math.floor(math.log10((self.high - self.low) / most))
        step *= next(one for one in (1.0, 2.0, 5.0, 10.0, 20.0) if (self.high - self.low) / (one * step) <= most)
        first = math.ceil(self.low / step)
        return [number * step for number in range(first, math.floor(self.high / step) + 1)]

    def place(self, value: float, begin: float, end: float) -> float:
        """Return the position of a value between two pixels."""
        return begin + (value - self.low) / (self.high - self.low) * (end - begin)


@dataclass(frozen=True, slots=True)
class _Field:
    """The drawing area with its axes."""

    width: int
    height: int
    x: _Axis
    y: _Axis
    left: int = 52
    right: int = 10
    top: int = 10
    bottom: int = 34

    def at(self, x: float, y: float) -> tuple[float, float]:
        return (
            self.x.place(x, self.left, self.width - self.right),
            self.y.place(y, self.height - self.bottom, self.top),
        )

    def frame(self, x_label: str, y_label: str) -> str:
        """Draw grid, numbers and names of the axes."""
        low, high, right = self.height - self.bottom, self.top, self.width - self.right
        parts = []
        for value in self.y.ticks(5):
            _, y = self.at(self.x.low, value)
            parts.append(f'<path class="grid" d="M{self.left} {y:.1f}H{right}"/>')
            parts.append(f'<text class="tick end" x="{self.left - 6}" y="{y + 4:.1f}">{_number(value)}</text>')
        for value in self.x.ticks(max(3, (right - self.left) // 90)):
            x, _ = self.at(value, self.y.low)
            parts.append(f'<path class="grid" d="M{x:.1f} {high}V{low}"/>')
            parts.append(f'<text class="tick middle" x="{x:.1f}" y="{low + 15}">{_number(value)}</text>')
        middle = (self.left + right) / 2
        parts.append(f'<text class="axis middle" x="{middle:.0f}" y="{self.height - 4}">{escape(x_label)}</text>')
        across = (low + high) / 2
        parts.append(
            f'<text class="axis middle" transform="translate(11 {across:.0f}) rotate(-90)">{escape(y_label)}</text>'
        )
        return "".join(parts)

    def wrap(self, title: str, content: str) -> str:
        """Return the picture, clipped to the drawing area."""
        width, height = self.width - self.left - self.right, self.height - self.top - self.bottom
        return (
            f'<svg viewBox="0 0 {self.width} {self.height}" role="img" aria-label="{escape(title)}">'
            f'<svg x="{self.left}" y="{self.top}" width="{width}" height="{height}" '
            f'viewBox="{self.left} {self.top} {width} {height}">{content}</svg>'
        )


def draw_curves(curves: Sequence[Curve], title: str, y_label: str, *, width: int = 640, height: int = 240) -> str:
    """Draw curves over time."""
    x = _Axis(float(curves[0].x[0]), float(curves[0].x[-1]) or 1.0)
    field = _Field(width, height, x, _Axis.over(*(curve.y for curve in curves)))
    lines = "".join(
        f'<path class="curve {curve.style}" d="{_path(field, curve.x, curve.y)}"/>' for curve in reversed(curves)
    )
    return field.wrap(title, lines) + field.frame("time, s", y_label) + "</svg>"


def draw_scatter(
    x: FloatArray, y: FloatArray, slope: float, offset: float, title: str, x_label: str, y_label: str
) -> str:
    """Draw one quantity against another, with the fitted and the expected line."""
    field = _Field(300, 240, _Axis.over(x), _Axis.over(y))
    good = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    chosen = good[:: max(1, len(good) // MAX_DOTS)]
    dots = "".join("M{:.1f} {:.1f}h0".format(*field.at(float(x[index]), float(y[index]))) for index in chosen.tolist())
    content = (
        f'<path class="dots" d="{dots}"/>{_line(field, slope, offset, "fitted")}{_line(field, 1.0, 0.0, "expected")}'
    )
    return field.wrap(title, content) + field.frame(x_label, y_label) + "</svg>"


def draw_path(x: FloatArray, y: FloatArray, title: str) -> str:
    """Draw a path in the plane, both axes to one scale."""
    width, height = 460, 340
    axis_x, axis_y = _Axis.over(x), _Axis.over(y)
    scale = max((axis_x.high - axis_x.low) / (width - 62), (axis_y.high - axis_y.low) / (height - 44))
    field = _Field(
        width,
        height,
        _centred(axis_x, scale * (width - 62)),
        _centred(axis_y, scale * (height - 44)),
    )
    start = np.flatnonzero(np.isfinite(x + y))
    dot = ""
    if len(start):
        place = field.at(float(x[start[0]]), float(y[start[0]]))
        dot = f'<circle class="start" cx="{place[0]:.1f}" cy="{place[1]:.1f}" r="5"/>'
    content = f'<path class="curve of-y" d="{_path(field, x, y)}"/>{dot}'
    return field.wrap(title, content) + field.frame("x, m", "y, m") + "</svg>"


def _centred(axis: _Axis, span: float) -> _Axis:
    middle = (axis.low + axis.high) / 2.0
    return _Axis(middle - span / 2.0, middle + span / 2.0)


def _line(field: _Field, slope: float, offset: float, style: str) -> str:
    ends = [field.at(x, slope * x + offset) for x in (field.x.low, field.x.high)]
    (x1, y1), (x2, y2) = ends
    return f'<path class="{style}" d="M{x1:.1f} {_bounded(y1)}L{x2:.1f} {_bounded(y2)}"/>'


def _path(field: _Field, x: FloatArray, y: FloatArray) -> str:
    """Return the SVG path through the points, interrupted where one is missing."""
    step = max(1, len(x) // MAX_POINTS)
    parts, is_drawn = [], False
    for one_x, one_y in zip(x[::step].tolist(), y[::step].tolist(), strict=True):
        if not math.isfinite(one_x + one_y):
            is_drawn = False
            continue
        place = field.at(one_x, one_y)
        parts.append(f"{'L' if is_drawn else 'M'}{place[0]:.1f} {_bounded(place[1])}")
        is_drawn = True
    return "".join(parts)


def _bounded(pixel: float) -> str:
    return f"{max(-9999.0, min(9999.0, pixel)):.1f}"


def _number(value: float) -> str:
    return f"{value:.6g}".replace("-", "−") if abs(value) > 1e-12 else "0"
