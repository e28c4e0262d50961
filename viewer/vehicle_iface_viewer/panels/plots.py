"""The plots: curves of the last seconds, with the vehicle's limits as ranges.

The browser draws a gap only where a value is null, and viser sends arrays of numbers, in which nothing is null. Hence
`_send_curves` queues lists by a private name of exactly viser 1.1.1; `tests/browser/test_plots.py` fails when it
changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from vehicle_iface.telemetry import DrivingLimits, Snapshot
from vehicle_iface.units import NS_PER_S, ns_from_s, s_from_ns
from vehicle_iface_viewer.feed import STALE_AFTER_S, History, View
from vehicle_iface_viewer.panels.text import MAX_SHOWN

WINDOW_S = 20.0
_PLOT_STEP_NS = NS_PER_S // 10
_PLOT_POINTS = int(WINDOW_S * 10)
_REQUESTED, _MEASURED, _SENT = "#fcc419", "#4dabf7", "#69db7c"
_LAYOUT = "layout"
"""Scale and series without a curve. viser creates a plot without a width, and uPlot lays out the labels again only when
a range changes; that of this scale does. The style sheet hides its entry in the legend."""
_TURNS_PER_LAYOUT = 10
_MARGIN = 0.05
"""Part of the range beyond each limit, so that a curve at its limit is not drawn on the edge."""


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
    read: Callable[[Snapshot], float]
    """The value, in the plot's unit; NaN where its flag marks it as missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """One plot: curves of one unit."""

    title: str
    curves: tuple[Curve, ...]
    limits: Callable[[DrivingLimits], Range]


def _degrees(angle_rad: float, *, is_known: bool) -> float:
    return math.degrees(angle_rad) if is_known else math.nan


def _around_zero(limit: float) -> Range:
    return Range(low=-limit, high=limit)


PLOTS = (
    Plot(
        title="Speed, m/s",
        limits=lambda limits: Range(low=0.0, high=limits.speed_max_mps),
        curves=(
            Curve(
                label="reference",
                color=_REQUESTED,
                read=lambda s: s.reference_speed_mps if s.has_reference else math.nan,
            ),
            Curve(label="vehicle", color=_MEASURED, read=lambda s: s.speed_mps if s.has_state else math.nan),
        ),
    ),
    Plot(
        title="Lateral error, m (left positive)",
        limits=lambda limits: _around_zero(limits.lateral_warn_m),
        curves=(
            Curve(label="vehicle", color="#ff8787", read=lambda s: s.lateral_error_m if s.has_reference else math.nan),
        ),
    ),
    Plot(
        title="Heading error, ° (left positive)",
        limits=lambda limits: _around_zero(math.degrees(limits.heading_stop_rad) / 4),
        curves=(
            Curve(
                label="vehicle",
                color="#b197fc",
                read=lambda s: _degrees(s.heading_error_rad, is_known=s.has_reference),
            ),
        ),
    ),
    Plot(
        title="Front wheels, ° (left positive)",
        limits=lambda limits: _around_zero(math.degrees(limits.front_wheel_angle_rad)),
        curves=(
            Curve(
                label="requested",
                color=_REQUESTED,
                read=lambda s: _degrees(s.requested_front_wheel_angle_rad, is_known=s.has_requested),
            ),
            Curve(label="sent", color=_SENT, read=lambda s: _degrees(s.sent_front_wheel_angle_rad, is_known=s.sent)),
            Curve(
                label="vehicle", color=_MEASURED, read=lambda s: _degrees(s.front_wheel_angle_rad, is_known=s.has_state)
            ),
        ),
    ),
    Plot(
        title="Acceleration, m/s²",
        limits=lambda limits: Range(low=limits.accel_min_mps2, high=limits.accel_max_mps2),
        curves=(
            Curve(
                label="requested",
                color=_REQUESTED,
                read=lambda s: s.requested_accel_mps2 if s.has_requested else math.nan,
            ),
            Curve(label="sent", color=_SENT, read=lambda s: s.sent_accel_mps2 if s.sent else math.nan),
            Curve(label="vehicle", color=_MEASURED, read=lambda s: s.accel_mps2 if s.has_state else math.nan),
        ),
    ),
)


class Plots:
    """Curves of the last seconds, in rings of a fixed length."""

    def __init__(self, gui: viser.GuiApi, history: History | None = None) -> None:
        """`history`: what a recording has of the time before; without it, only the newest snapshots are shown."""
        self._history = history
        self._due_ns = 0
        self._session = 0
        self._limits = DrivingLimits()
        self._unsent: set[int] = set()
        self._times_ns = np.zeros(_PLOT_POINTS)
        self._values = [np.full((len(plot.curves), _PLOT_POINTS), np.nan) for plot in PLOTS]
        self._handles = [self._add_plot(gui, plot, 10.0 + k) for k, plot in enumerate(PLOTS)]

    def extend(self, view: View) -> None:
        """Append the newest values; stale data appends nothing, and the curves stop moving."""
        snapshot = view.snapshot
        if view.session != self._session:
            self._session, self._due_ns = view.session, 0
            self._reset(view.info.limits if view.info is not None else DrivingLimits())
        is_old = view.is_stale and self._history is None  # a recording knows what was before
        if snapshot is None or is_old or view.now_ns < self._due_ns:
            return
        self._due_ns = view.now_ns + _PLOT_STEP_NS
        begin_ns = max(int(self._times_ns[-1]), view.now_ns - ns_from_s(WINDOW_S))
        past = self._history(begin_ns, view.now_ns, _PLOT_STEP_NS) if self._history is not None else [snapshot]
        for each in past:
            self._append(each)

    def send(self, turn: int) -> None:
        """Send one plot with new values, each turn another: it sends whole arrays, and redrawing it is expensive."""
        ago_s = (self._times_ns - self._times_ns[-1]) / NS_PER_S
        kept = (ago_s >= -WINDOW_S) & (self._times_ns > 0.0)
        for k, values in enumerate(self._values):
            if k == turn % len(PLOTS) and k in self._unsent:
                self._unsent.remove(k)
                _send_curves(self._handles[k], ago_s[kept], values[:, kept], turn // _TURNS_PER_LAYOUT)

    def _reset(self, limits: DrivingLimits) -> None:
        """Empty the plots, and set their ranges if the limits are others."""
        self._times_ns[:] = 0.0
        for values in self._values:
            values[:] = np.nan
        self._unsent = set(range(len(PLOTS)))
        if limits != self._limits:
            self._limits = limits
            for plot, handle in zip(PLOTS, self._handles, strict=True):
                handle.scales = _scales(plot.limits(limits))

    def _append(self, snapshot: Snapshot) -> None:
        """Append a point to each curve, behind a gap if the one before is older than stale data."""
        newest_ns = self._times_ns[-1]
        if newest_ns and s_from_ns(snapshot.published_ns - int(newest_ns)) > STALE_AFTER_S:
            self._append_column(snapshot.published_ns - 1, None)
        self._append_column(snapshot.published_ns, snapshot)
        self._unsent = set(range(len(PLOTS)))

    def _append_column(self, at_ns: int, snapshot: Snapshot | None) -> None:
        self._times_ns[:-1] = self._times_ns[1:]
        self._times_ns[-1] = at_ns
        for plot, values in zip(PLOTS, self._values, strict=True):
            values[:, :-1] = values[:, 1:]
            values[:, -1] = math.nan if snapshot is None else [_drawable(each.read(snapshot)) for each in plot.curves]

    def _add_plot(self, gui: viser.GuiApi, plot: Plot, order: float) -> viser.GuiUplotHandle:
        series = [uplot.Series(label="s")]
        series += [uplot.Series(label=curve.label, stroke=curve.color, width=1.6) for curve in plot.curves]
        series += [uplot.Series(label=_LAYOUT, scale=_LAYOUT, width=0, points={"show": False})]
        line = {"stroke": "#343a40", "width": 1}
        axis = {"stroke": "#adb5bd", "grid": line, "ticks": line}
        # px; with 30 px between labels some plots had only one label
        across, up = axis | {"size": 30}, axis | {"size": 54, "space": 18}
        return gui.add_uplot(
            (np.zeros(0), *(np.zeros(0) for _ in series[1:])),
            tuple(series),
            title=plot.title,
            scales=_scales(plot.limits(self._limits)),
            axes=(across, up),  # type: ignore[arg-type]  # plain dictionaries of the keys that matter
            legend=uplot.Legend(show=True, live=False),
            height=118,
            padding=(6, 24, 0, 0),  # room for half of the topmost label
            order=order,
        )


def _drawable(value: float) -> float:
    """Return the value; NaN where it cannot be drawn."""
    return value if abs(value) < MAX_SHOWN else math.nan


def _scales(limits: Range) -> dict[str, uplot.Scale]:
    """Return scales for the last seconds and these limits; the browser widens the range for values beyond them."""
    margin = (limits.high - limits.low) * _MARGIN
    up = {
        "min": {"soft": limits.low - margin, "mode": 1, "pad": _MARGIN},
        "max": {"soft": limits.high + margin, "mode": 1, "pad": _MARGIN},
    }
    return {
        "x": uplot.Scale(time=False, auto=False, range=(-WINDOW_S, 0.0)),
        "y": uplot.Scale(range=up),
        _LAYOUT: uplot.Scale(),
    }


def _send_curves(handle: viser.GuiUplotHandle, ago_s: np.ndarray, values: np.ndarray, number: int) -> None:
    """Send curves whose NaN are gaps. Where `number` differs from the last one, the page lays out the labels again."""
    curves = ([None if math.isnan(value) else value for value in curve] for curve in values.tolist())
    layout = [None] * (len(ago_s) - 1) + [number] if len(ago_s) else []
    handle._queue_update("data", (ago_s.tolist(), *curves, layout))
