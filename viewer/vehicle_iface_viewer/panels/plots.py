"""The plots: curves of the last seconds, with the vehicle's limits as ranges and as lines.

The browser draws a gap only where a value is null, and viser sends arrays of numbers, in which nothing is null. Hence
`_send_curves` queues lists by a private name of exactly viser 1.1.1; `tests/browser/test_plots.py` fails when it
changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import viser
from viser import uplot

from vehicle_iface.telemetry import DrivingLimits
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_MS
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.curves import TimeAxis
from vehicle_iface_viewer.panels.plot_time import USUAL_WINDOW, WINDOWS
from vehicle_iface_viewer.panels.text import MAX_SHOWN
from vehicle_iface_viewer.recent import Columns, RecentSnapshots

OLD_STATE_NS = 100 * NS_PER_MS
"""What is known of an older state is not drawn."""
_REQUESTED, _MEASURED, _SENT = "#fcc419", "#4dabf7", "#69db7c"
_LIMIT, _LIMITED = "#e03131", "#f06595"
_LAYOUT = "layout"
"""Scale and series without a curve. viser creates a plot without a width, and uPlot lays out the labels again only when
a range changes; that of this scale does. The style sheet hides its entry in the legend, and those of the limits."""
_TURNS_PER_LAYOUT = 10
_MARGIN = 0.05
"""Part of the range beyond each limit, so that a curve at its limit is not drawn on the edge."""
_ROUNDING_MPS2, _ROUNDING_RAD = 0.05, 0.005
"""A command that differs by less from the request was rounded, not limited."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Range of a vertical axis."""

    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One curve of a plot."""

    label: str
    color: str
    read: Callable[[Columns], FloatArray]
    """The values, in the plot's unit; NaN where their flag marks them as missing."""
    width: float = 1.6


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """One plot: curves of one unit."""

    title: str
    curves: tuple[Curve, ...]
    range: Callable[[DrivingLimits], Range]
    lines: Callable[[Range], tuple[float, float]] = lambda limits: (limits.low, limits.high)
    """Limits that are drawn; NaN for none."""


def _around_zero(limit: float) -> Range:
    return Range(low=-limit, high=limit)


def _known(values: FloatArray, is_known: npt.NDArray[np.bool_]) -> FloatArray:
    with np.errstate(invalid="ignore"):
        return np.where(is_known & (np.abs(values) < MAX_SHOWN), values, np.nan)


def _of_state(name: str, factor: float = 1.0, flag: str = "has_state") -> Callable[[Columns], FloatArray]:
    """Read a column that is known where the state is young, in the column's unit times `factor`."""

    def read(rows: Columns) -> FloatArray:
        is_young = rows["published_ns"] - rows["stamp_ns"] < OLD_STATE_NS
        return _known(rows[name] * factor, rows[flag] & rows["has_state"] & is_young)

    return read


def _of_command(name: str, flag: str, factor: float = 1.0) -> Callable[[Columns], FloatArray]:
    return lambda rows: _known(rows[name] * factor, rows[flag])


def _limited(name: str, rounding: float, factor: float = 1.0) -> Callable[[Columns], FloatArray]:
    """Read what was sent where it is not what was requested."""

    def read(rows: Columns) -> FloatArray:
        requested, sent = rows[f"requested_{name}"], rows[f"sent_{name}"]
        with np.errstate(invalid="ignore"):
            is_limited = np.abs(requested - sent) > rounding
        return _known(sent * factor, rows["sent"] & rows["has_requested"] & is_limited)

    return read


_DEGREES = math.degrees(1.0)
PLOTS = (
    Plot(
        title="Speed, m/s",
        range=lambda limits: Range(low=0.0, high=limits.speed_max_mps),
        lines=lambda limits: (math.nan, limits.high),
        curves=(
            Curve(label="reference", color=_REQUESTED, read=_of_state("reference_speed_mps", flag="has_reference")),
            Curve(label="vehicle", color=_MEASURED, read=_of_state("speed_mps")),
        ),
    ),
    Plot(
        title="Lateral error, m (left positive)",
        range=lambda limits: _around_zero(limits.lateral_warn_m),
        curves=(Curve(label="vehicle", color="#ff8787", read=_of_state("lateral_error_m", flag="has_reference")),),
    ),
    Plot(
        title="Heading error, ° (left positive)",
        range=lambda limits: _around_zero(math.degrees(limits.heading_stop_rad) / 4),
        lines=lambda _: (math.nan, math.nan),  # the limit is four times as far
        curves=(
            Curve(
                label="vehicle",
                color="#b197fc",
                read=_of_state("heading_error_rad", _DEGREES, flag="has_reference"),
            ),
        ),
    ),
    Plot(
        title="Front wheels, ° (left positive)",
        range=lambda limits: _around_zero(math.degrees(limits.front_wheel_angle_rad)),
        curves=(
            Curve(
                label="limited",
                color=_LIMITED,
                width=5.0,
                read=_limited("front_wheel_angle_rad", _ROUNDING_RAD, _DEGREES),
            ),
            Curve(
                label="requested",
                color=_REQUESTED,
                read=_of_command("requested_front_wheel_angle_rad", "has_requested", _DEGREES),
            ),
            Curve(label="sent", color=_SENT, read=_of_command("sent_front_wheel_angle_rad", "sent", _DEGREES)),
            Curve(label="vehicle", color=_MEASURED, read=_of_state("front_wheel_angle_rad", _DEGREES)),
        ),
    ),
    Plot(
        title="Acceleration, m/s²",
        range=lambda limits: Range(low=limits.accel_min_mps2, high=limits.accel_max_mps2),
        curves=(
            Curve(label="limited", color=_LIMITED, width=5.0, read=_limited("accel_mps2", _ROUNDING_MPS2)),
            Curve(label="requested", color=_REQUESTED, read=_of_command("requested_accel_mps2", "has_requested")),
            Curve(label="sent", color=_SENT, read=_of_command("sent_accel_mps2", "sent")),
            Curve(label="vehicle", color=_MEASURED, read=_of_state("accel_mps2")),
        ),
    ),
)


class Plots:
    """Curves of the last seconds."""

    def __init__(self, gui: viser.GuiApi, recent: RecentSnapshots) -> None:
        self._recent = recent
        self._limits = DrivingLimits()
        self._window_s = WINDOWS[USUAL_WINDOW]
        self._sent = [(-1, 0.0)] * len(PLOTS)
        self._handles = [self._add_plot(gui, plot, 10.0 + k) for k, plot in enumerate(PLOTS)]

    def show(self, view: View, turn: int, *, end_ns: int, window_s: float) -> None:
        """Send one plot of `window_s` seconds until `end_ns` if it has new values, each turn another: redrawing one is
        expensive for the browser.

        Stale data brings nothing new, and the curves stop moving.
        """
        limits = view.info.limits if view.info is not None else self._limits
        if (limits, window_s) != (self._limits, self._window_s):
            self._limits, self._window_s = limits, window_s
            for plot, handle in zip(PLOTS, self._handles, strict=True):
                handle.scales = _scales(plot.range(limits), window_s)
        k = turn % len(PLOTS)
        if self._sent[k] != (end_ns, window_s):
            self._sent[k] = (end_ns, window_s)
            self._send(k, TimeAxis.until(end_ns, window_s), turn // _TURNS_PER_LAYOUT)

    def _send(self, k: int, axis: TimeAxis, number: int) -> None:
        plot = PLOTS[k]
        rows = self._recent.between(axis.begin_ns - 1, axis.now_ns)
        curves = [axis.decimate(rows["published_ns"], curve.read(rows)) for curve in plot.curves]
        _send_curves(self._handles[k], axis.times_s, curves, plot.lines(plot.range(self._limits)), number)

    def _add_plot(self, gui: viser.GuiApi, plot: Plot, order: float) -> viser.GuiUplotHandle:
        series = [uplot.Series(label="s")]
        series += [uplot.Series(label=curve.label, stroke=curve.color, width=curve.width) for curve in plot.curves]
        dashes = uplot.Series(stroke=_LIMIT, width=1, dash=(6, 4), spanGaps=True, points={"show": False})
        series += [dashes | uplot.Series(label=label) for label in ("lower limit", "limit")]
        series += [uplot.Series(label=_LAYOUT, scale=_LAYOUT, width=0, points={"show": False})]
        line = {"stroke": "#343a40", "width": 1}
        axis = {"stroke": "#adb5bd", "grid": line, "ticks": line}
        # px; with 30 px between labels some plots had only one label
        across, up = axis | {"size": 30}, axis | {"size": 54, "space": 18}
        return gui.add_uplot(
            (np.zeros(0), *(np.zeros(0) for _ in series[1:])),
            tuple(series),
            title=plot.title,
            scales=_scales(plot.range(self._limits), self._window_s),
            axes=(across, up),  # type: ignore[arg-type]  # plain dictionaries of the keys that matter
            legend=uplot.Legend(show=True, live=False),
            height=118,
            padding=(6, 24, 0, 0),  # room for half of the topmost label
            order=order,
        )


def _scales(limits: Range, window_s: float) -> dict[str, uplot.Scale]:
    """Return scales for the last seconds and these limits; the browser widens the range for values beyond them."""
    margin = (limits.high - limits.low) * _MARGIN
    up = {
        "min": {"soft": limits.low - margin, "mode": 1, "pad": _MARGIN},
        "max": {"soft": limits.high + margin, "mode": 1, "pad": _MARGIN},
    }
    return {
        "x": uplot.Scale(time=False, auto=False, range=(-window_s, 0.0)),
        "y": uplot.Scale(range=up),
        _LAYOUT: uplot.Scale(),
    }


def _send_curves(
    handle: viser.GuiUplotHandle, times_s: FloatArray, curves: list[FloatArray], lines: tuple[float, float], number: int
) -> None:
    """Send curves whose NaN are gaps, and horizontal lines. Where `number` differs from the last one, the page lays out
    the labels again."""
    between = [None] * (len(times_s) - 2)
    shown = ([None if math.isnan(value) else value for value in curve.tolist()] for curve in curves)
    across = ([end, *between, end] for end in (None if math.isnan(line) else line for line in lines))
    handle._queue_update("data", (times_s.tolist(), *shown, *across, [None, *between, number]))
