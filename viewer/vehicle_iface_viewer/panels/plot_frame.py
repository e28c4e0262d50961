"""What all plots have: axes, lines for limits, one cursor, and how curves with gaps are sent.

The browser draws a gap only where a value is null, and viser sends arrays of numbers, in which nothing is null. Hence
`send_curves` queues lists by a private name of exactly viser 1.1.1; `tests/browser/test_plots.py` fails when it
changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from vehicle_iface.trajectory import FloatArray

LAYOUT = "layout"
"""Scale and series without a curve, which is another power of ten each time. viser creates a plot without a width, and
uPlot lays out the labels and reads the values at the cursor only when a range changes; that of this scale does. The
style sheet hides its entry in the legend, and those of the limits."""
MARGIN = 0.05
"""Part of the range beyond each limit, so that a curve at its limit is not drawn on the edge."""
# A curve has a contrast of at least 3 on the dark page and on the light one.
_LIMIT = "#f03e3e"
_GRID = "rgba(128,128,128,.25)"
_CURSOR: uplot.Cursor = {"sync": {"key": "vehicle-iface"}}
"""The plots of a page have one cursor, and are zoomed together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Range of a vertical axis."""

    low: float
    high: float

    @property
    def width(self) -> float:
        return self.high - self.low


def add_plot(
    gui: viser.GuiApi, title: str, curves: Sequence[uplot.Series], scales: dict[str, uplot.Scale], order: float
) -> viser.GuiUplotHandle:
    """Add a plot without data."""
    series = all_series(curves)
    return gui.add_uplot(
        tuple(np.zeros(0) for _ in series),
        series,
        title=title,
        scales=scales,
        axes=axes(),
        legend=uplot.Legend(show=True, live=True),
        cursor=_CURSOR,
        height=118,
        padding=(6, 24, 0, 0),  # room for half of the topmost label
        order=order,
    )


def all_series(curves: Sequence[uplot.Series]) -> tuple[uplot.Series, ...]:
    """Return the series of a plot: time, curves, two limits, layout."""
    dashes = uplot.Series(stroke=_LIMIT, width=1, dash=(6, 4), spanGaps=True, points={"show": False})
    limits = (dashes | uplot.Series(label=label) for label in ("lower limit", "limit"))
    layout = uplot.Series(label=LAYOUT, scale=LAYOUT, width=0, points={"show": False})
    return (uplot.Series(label="s"), *curves, *limits, layout)


def axes(right: str = "") -> tuple[uplot.Axis, ...]:
    """Return the axes of time and of values, and one of the scale `right` if it is named. The page gives their texts
    the colour of its theme."""
    line = {"stroke": _GRID, "width": 1}
    axis = {"grid": line, "ticks": line}
    # px; with 30 px between labels some plots had only one label
    across, up = axis | {"size": 30}, axis | {"size": 54, "space": 18}
    second = (up | {"scale": right, "side": 1, "grid": {"show": False}},) if right else ()
    return (across, up, *second)


def time_scale(window_s: float) -> uplot.Scale:
    """Return the scale of the last `window_s` seconds."""
    return uplot.Scale(time=False, auto=False, range=(-window_s, 0.0))


def value_scale(limits: Range) -> uplot.Scale:
    """Return the scale of a range; the browser widens it for values beyond."""
    margin = limits.width * MARGIN
    up = {
        "min": {"soft": limits.low - margin, "mode": 1, "pad": MARGIN},
        "max": {"soft": limits.high + margin, "mode": 1, "pad": MARGIN},
    }
    return uplot.Scale(range=up)


def send_curves(
    handle: viser.GuiUplotHandle,
    times_s: FloatArray,
    curves: Sequence[FloatArray],
    lines: tuple[float, float],
    number: int,
) -> None:
    """Send curves whose NaN are gaps, and horizontal lines. `number` is that of the sending."""
    between = [None] * (len(times_s) - 2)
    shown = ([None if math.isnan(value) else value for value in curve.tolist()] for curve in curves)
    across = ([end, *between, end] for end in (None if math.isnan(line) else line for line in lines))
    handle._queue_update("data", (times_s.tolist(), *shown, *across, [10 ** (number % 5)] * len(times_s)))
