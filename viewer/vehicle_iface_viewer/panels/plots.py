"""The plots: curves of the last seconds, with the vehicle's limits as ranges and as lines."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import viser
from viser import uplot

from vehicle_iface.telemetry import DrivingLimits
from vehicle_iface.telemetry.columns import ROUNDING_MPS2, ROUNDING_RAD, Reader, of_flag, of_limited, of_state
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.colors import LIMITED, MEASURED, REQUESTED, SENT
from vehicle_iface_viewer.panels.curves import TimeAxis
from vehicle_iface_viewer.panels.plot_frame import (
    LAYOUT,
    Range,
    add_plot,
    send_curves,
    time_scale,
    value_scale,
)
from vehicle_iface_viewer.panels.plot_time import USUAL_WINDOW, WINDOWS
from vehicle_iface_viewer.recent import RecentSnapshots


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One curve of a plot."""

    label: str
    color: str
    read: Reader
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


_DEGREES = math.degrees(1.0)
PLOTS = (
    Plot(
        title="Speed, m/s",
        range=lambda limits: Range(low=0.0, high=limits.speed_max_mps),
        lines=lambda limits: (math.nan, limits.high),
        curves=(
            Curve(label="reference", color=REQUESTED, read=of_state("reference_speed_mps", flag="has_reference")),
            Curve(label="vehicle", color=MEASURED, read=of_state("speed_mps")),
        ),
    ),
    Plot(
        title="Lateral error, m (left positive)",
        range=lambda limits: _around_zero(limits.lateral_warn_m),
        curves=(Curve(label="vehicle", color="#0ca678", read=of_state("lateral_error_m", flag="has_reference")),),
    ),
    Plot(
        title="Heading error, ° (left positive)",
        range=lambda limits: _around_zero(math.degrees(limits.heading_stop_rad) / 4),
        lines=lambda _: (math.nan, math.nan),  # the limit is four times as far
        curves=(
            Curve(
                label="vehicle",
                color="#9775fa",
                read=of_state("heading_error_rad", _DEGREES, flag="has_reference"),
            ),
        ),
    ),
    Plot(
        title="Front wheels, ° (left positive)",
        range=lambda limits: _around_zero(math.degrees(limits.front_wheel_angle_rad)),
        curves=(
            Curve(
                label="limited",
                color=LIMITED,
                width=5.0,
                read=of_limited("front_wheel_angle_rad", ROUNDING_RAD, _DEGREES),
            ),
            Curve(
                label="requested",
                color=REQUESTED,
                read=of_flag("requested_front_wheel_angle_rad", "has_requested", _DEGREES),
            ),
            Curve(label="sent", color=SENT, read=of_flag("sent_front_wheel_angle_rad", "sent", _DEGREES)),
            Curve(label="vehicle", color=MEASURED, read=of_state("front_wheel_angle_rad", _DEGREES)),
        ),
    ),
    Plot(
        title="Acceleration, m/s²",
        range=lambda limits: Range(low=limits.accel_min_mps2, high=limits.accel_max_mps2),
        curves=(
            Curve(label="limited", color=LIMITED, width=5.0, read=of_limited("accel_mps2", ROUNDING_MPS2)),
            Curve(label="requested", color=REQUESTED, read=of_flag("requested_accel_mps2", "has_requested")),
            Curve(label="sent", color=SENT, read=of_flag("sent_accel_mps2", "sent")),
            Curve(label="vehicle", color=MEASURED, read=of_state("accel_mps2")),
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
            self._send(k, TimeAxis.until(end_ns, window_s), turn // len(PLOTS))

    def _send(self, k: int, axis: TimeAxis, number: int) -> None:
        plot = PLOTS[k]
        rows = self._recent.between(axis.begin_ns - 1, axis.now_ns)
        curves = [axis.decimate(rows["published_ns"], curve.read(rows)) for curve in plot.curves]
        send_curves(self._handles[k], axis.times_s, curves, plot.lines(plot.range(self._limits)), number)

    def _add_plot(self, gui: viser.GuiApi, plot: Plot, order: float) -> viser.GuiUplotHandle:
        curves = [uplot.Series(label=curve.label, stroke=curve.color, width=curve.width) for curve in plot.curves]
        return add_plot(gui, plot.title, curves, _scales(plot.range(self._limits), self._window_s), order)


def _scales(limits: Range, window_s: float) -> dict[str, uplot.Scale]:
    """Return scales for the last seconds and these limits."""
    return {"x": time_scale(window_s), "y": value_scale(limits), LAYOUT: uplot.Scale()}
