"""The plots: curves of the last seconds."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import viser
from viser import uplot

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.feed import View

WINDOW_S = 20.0
_PLOT_STEP_NS = NS_PER_S // 10
_PLOT_POINTS = int(WINDOW_S * 10)
_REQUESTED, _MEASURED, _SENT = "#fcc419", "#4dabf7", "#69db7c"

_Curve = tuple[str, str, Callable[[Snapshot], float]]
"""Label, colour and value; the value is NaN where its flag marks it as missing."""
PLOTS: tuple[tuple[str, tuple[_Curve, ...]], ...] = (
    (
        "Speed, m/s",
        (
            ("reference", _REQUESTED, lambda s: s.reference_speed_mps if s.has_reference else math.nan),
            ("vehicle", _MEASURED, lambda s: s.speed_mps if s.has_state else math.nan),
        ),
    ),
    (
        "Tracking error: lateral, m · heading, rad",
        (
            ("lateral", "#ff8787", lambda s: s.lateral_error_m if s.has_reference else math.nan),
            ("heading", "#b197fc", lambda s: s.heading_error_rad if s.has_reference else math.nan),
        ),
    ),
    (
        "Front wheels, rad (left positive)",
        (
            ("requested", _REQUESTED, lambda s: s.requested_front_wheel_angle_rad if s.has_requested else math.nan),
            ("sent", _SENT, lambda s: s.sent_front_wheel_angle_rad if s.sent else math.nan),
            ("vehicle", _MEASURED, lambda s: s.front_wheel_angle_rad if s.has_state else math.nan),
        ),
    ),
    (
        "Acceleration, m/s²",
        (
            ("requested", _REQUESTED, lambda s: s.requested_accel_mps2 if s.has_requested else math.nan),
            ("sent", _SENT, lambda s: s.sent_accel_mps2 if s.sent else math.nan),
            ("vehicle", _MEASURED, lambda s: s.accel_mps2 if s.has_state else math.nan),
        ),
    ),
)


class Plots:
    """Curves of the last seconds, in rings of a fixed length."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._due_ns = 0
        self._session = 0
        self._unsent: set[int] = set()
        count = sum(len(curves) for _, curves in PLOTS)
        self._times_ns = np.zeros(_PLOT_POINTS)
        self._values = np.full((count, _PLOT_POINTS), np.nan)
        self._handles = [self._add_plot(gui, title, curves, 10.0 + k) for k, (title, curves) in enumerate(PLOTS)]

    def extend(self, view: View) -> None:
        """Append the newest values; stale data appends nothing, and the curves stop moving."""
        snapshot = view.snapshot
        if view.session != self._session:
            self._session, self._due_ns = view.session, 0
            self._times_ns[:], self._values[:] = 0.0, np.nan
        if snapshot is None or view.is_stale or view.now_ns < self._due_ns:
            return
        self._due_ns = view.now_ns + _PLOT_STEP_NS
        self._times_ns = np.roll(self._times_ns, -1)
        self._values = np.roll(self._values, -1, axis=1)
        self._times_ns[-1] = snapshot.published_ns
        self._values[:, -1] = [value(snapshot) for _, curves in PLOTS for _, _, value in curves]
        self._unsent = set(range(len(PLOTS)))

    def send(self, turn: int) -> None:
        """Send every other plot with new values: each sends whole arrays, and redrawing them is expensive."""
        ago_s = (self._times_ns - self._times_ns[-1]) / NS_PER_S
        kept = ago_s >= -WINDOW_S
        row = 0
        for k, (_, curves) in enumerate(PLOTS):
            if k % 2 == turn % 2 and k in self._unsent:
                self._unsent.remove(k)
                self._handles[k].data = (ago_s[kept], *self._values[row : row + len(curves), kept])
            row += len(curves)

    def _add_plot(
        self, gui: viser.GuiApi, title: str, curves: tuple[_Curve, ...], order: float
    ) -> viser.GuiUplotHandle:
        nothing = np.zeros(1)
        series = [uplot.Series(label="s")]
        series += [uplot.Series(label=label, stroke=color, width=1.6) for label, color, _ in curves]
        line = {"stroke": "#343a40", "width": 1}
        axis = {"stroke": "#adb5bd", "grid": line, "ticks": line}
        # px; with 30 px between labels some plots had only one label
        across, up = axis | {"size": 30}, axis | {"size": 54, "space": 18}
        return gui.add_uplot(
            (nothing, *(nothing for _ in curves)),
            tuple(series),
            title=title,
            scales={"x": uplot.Scale(time=False, auto=False, range=(-WINDOW_S, 0.0))},
            axes=(across, up),  # type: ignore[arg-type]  # plain dictionaries of the keys that matter
            legend=uplot.Legend(show=True, live=False),
            height=118,
            order=order,
        )
