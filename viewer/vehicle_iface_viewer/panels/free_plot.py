"""The free plot of one browser: two signals that its user chooses, of the telemetry or of the buses, each with an axis
of its own unless both have the same unit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import viser
from viser import uplot

from vehicle_iface.telemetry.columns import GAP_NS
from vehicle_iface.trajectory import FloatArray
from vehicle_iface_viewer.bus_table.bus_signals import MAX_PLOTTED, BusSignals, SampleRows
from vehicle_iface_viewer.controls import handle_text
from vehicle_iface_viewer.panels.colors import MEASURED, REQUESTED
from vehicle_iface_viewer.panels.curves import TimeAxis
from vehicle_iface_viewer.panels.free_signals import FREE_SIGNALS
from vehicle_iface_viewer.panels.plot_frame import (
    LAYOUT,
    Range,
    add_plot,
    all_series,
    axes,
    send_curves,
    time_scale,
    value_scale,
)
from vehicle_iface_viewer.panels.plot_time import USUAL_WINDOW, WINDOWS
from vehicle_iface_viewer.panels.text import plain
from vehicle_iface_viewer.recent import RecentSnapshots

NONE = "none"
USUAL_SIGNALS = ("latency, ms", NONE)
_COLORS = (MEASURED, REQUESTED)
_SCALES = ("y", "right")
_NO_LINES = (math.nan, math.nan)
_ORDER = 20.0
_LONGEST_NAME = 200
_GAP_PERIODS = 3
"""A signal of a bus has a gap where it did not come for so many of its periods."""
_LEAST_FILLED = 0.3
"""A curve that fills less of its range gets a smaller one."""


class FreePlot:
    """Two signals over the time of the other plots."""

    def __init__(self, client: viser.ClientHandle, recent: RecentSnapshots, bus: BusSignals) -> None:
        """`bus`: the signals of the buses at the time that this browser shows."""
        self._recent, self._bus = recent, bus
        self._window_s = WINDOWS[USUAL_WINDOW]
        self._names = list(USUAL_SIGNALS)
        self._unknown = ["", ""]
        """Names that the browser asked for, of signals that there are not (yet)."""
        self._ranges: list[Range | None] = [None, None]
        self._number = 0
        self._sent: tuple[int, float, tuple[str, ...], int] | None = None
        self._boxes: list[viser.GuiDropdownHandle[str]] = []
        self._handle = add_plot(client.gui, "Free plot", self._series(), self._scales(), _ORDER + 1)
        names = tuple(FREE_SIGNALS)
        for place, (label, choices) in enumerate((("Free plot", names), ("and", (NONE, *names)))):
            box: viser.GuiDropdownHandle[str] = client.gui.add_dropdown(
                label, choices, initial_value=self._names[place], order=_ORDER + 0.1 * (place + 1)
            )
            handle_text(client, box._impl.uuid, _LONGEST_NAME, partial(self._set, place))
            self._boxes.append(box)
        self._offered: tuple[str, ...] = ()
        self._note = client.gui.add_html("", order=_ORDER + 1.1)

    @property
    def names(self) -> tuple[str, str]:
        """The two signals; the second may be `NONE`."""
        return self._names[0], self._names[1]

    @property
    def wanted(self) -> tuple[str, str]:
        """The two signals, or what was asked for instead and is not there (yet)."""
        return self._unknown[0] or self._names[0], self._unknown[1] or self._names[1]

    def choose(self, place: int, name: str) -> None:
        """Draw another signal; `place` 0 has the left axis. A name that is no signal is ignored, except `NONE`, and
        named below the plot until it is one: a message may not have been received yet."""
        if self._is_signal(place, name):
            self._set(place, name)
            self._boxes[place].value = name  # type: ignore[misc]  # viser declares no setter
        elif name != NONE:
            self._unknown[place] = name[:_LONGEST_NAME]

    def _is_signal(self, place: int, name: str) -> bool:
        return name in FREE_SIGNALS or self._bus.find(name) is not None or (place == 1 and name == NONE)

    def _set(self, place: int, name: str) -> None:
        if self._is_signal(place, name):
            self._names[place], self._unknown[place] = name, ""

    def show(self, *, end_ns: int, window_s: float) -> None:
        """Send `window_s` seconds until `end_ns`, if they or the signals are others than before."""
        self._follow_bus()
        axis = TimeAxis.until(end_ns, window_s)
        samples = {name: self._bus.between(name, axis.begin_ns - 1, end_ns) for name in self._names}
        wanted = (end_ns, window_s, tuple(self._names), sum(map(len, samples.values())))
        if self._sent == wanted:
            return
        is_other = self._sent is None or self._sent[1:3] != wanted[1:3]
        self._sent, self._window_s = wanted, window_s
        self._number += 1
        rows = self._recent.between(axis.begin_ns - 1, end_ns)
        curves = [
            axis.decimate(rows["published_ns"], FREE_SIGNALS[name].read(rows))
            if name in FREE_SIGNALS
            else axis.decimate(samples[name]["at_ns"], samples[name]["value"], _find_gap(samples[name]))
            for name in self._drawn()
        ]
        ranges = self._find_ranges(curves)
        if is_other or ranges != self._ranges:
            self._ranges = ranges
            self._handle.series = all_series(self._series())
            self._handle.axes = axes(_SCALES[1] if self._has_two_axes() else "")
            self._handle.scales = self._scales()
        send_curves(self._handle, axis.times_s, curves, _NO_LINES, self._number)

    def _follow_bus(self) -> None:
        """Offer the signals that are new, draw those that were asked for, and keep the samples of what is drawn."""
        if self._offered is not self._bus.offered:
            self._offered = self._bus.offered
            names = (*FREE_SIGNALS, *self._offered)
            for box, choices in zip(self._boxes, (names, (NONE, *names)), strict=True):
                box.options = choices
        for place, name in enumerate(self._unknown):
            if name:
                self.choose(place, name)
        for name in self._names:
            self._bus.want(name)
        content = "".join(f'<div class="vi-note">{plain(note)}</div>' for note in self._notes())
        if self._note.content != content:
            self._note.content = content

    def _notes(self) -> Iterator[str]:
        for name in filter(None, (*self._unknown, *self._drawn())):
            if name not in FREE_SIGNALS and self._bus.find(name) is None:
                reason = f" ({self._bus.problem})" if self._bus.problem else ""
                yield f"“{name}” is not among the signals, at least not yet, and not drawn{reason}"
            elif self._bus.is_left_out(name):
                yield f"“{name}” is not drawn: {MAX_PLOTTED} signals of the bus are plotted already"

    def _drawn(self) -> list[str]:
        return [name for name in self._names if name != NONE]

    def _unit(self, name: str) -> str:
        if name in FREE_SIGNALS:
            return FREE_SIGNALS[name].unit
        signal = self._bus.find(name)
        return signal.unit if signal is not None else ""

    def _has_two_axes(self) -> bool:
        return len({self._unit(name) for name in self._drawn()}) > 1

    def _find_ranges(self, curves: Sequence[FloatArray]) -> list[Range | None]:
        if self._has_two_axes():
            return [find_range(curve, old) for curve, old in zip(curves, self._ranges, strict=True)]
        return [find_range(np.concatenate(curves), self._ranges[0]), None]

    def _series(self) -> list[uplot.Series]:
        scales = _SCALES if self._has_two_axes() else ("y", "y")
        return [
            uplot.Series(label=name, stroke=color, width=1.6, scale=scale)
            for name, color, scale in zip(self._drawn(), _COLORS, scales, strict=False)
        ]

    def _scales(self) -> dict[str, uplot.Scale]:
        ranges = zip(_SCALES, self._ranges, strict=True)
        return {
            "x": time_scale(self._window_s),
            **{name: value_scale(limits or Range(low=0.0, high=1.0)) for name, limits in ranges},
            LAYOUT: uplot.Scale(),
        }


def _find_gap(samples: SampleRows) -> int:
    """Return the time in ns after which the next sample is missing."""
    periods_ns = np.diff(samples["at_ns"])
    return max(GAP_NS, round(_GAP_PERIODS * float(np.median(periods_ns)))) if len(periods_ns) else GAP_NS


def find_range(values: FloatArray, old: Range | None) -> Range | None:
    """Return a range with round ends for these values: the old one where it still fits, as another one rebuilds the
    plot in the browser."""
    values = values[np.isfinite(values)]
    if not len(values):
        return old
    low, high = float(values.min()), float(values.max())
    step = _step(low, high)
    found = Range(low=math.floor(low / step) * step, high=math.ceil(high / step) * step)
    if found.low == found.high:
        found = Range(low=found.low - step, high=found.high + step)
    is_inside = old is not None and old.low <= low and high <= old.high
    return old if old is not None and is_inside and found.width > _LEAST_FILLED * old.width else found


def _step(low: float, high: float) -> float:
    """Return 1, 2 or 5 times a power of ten: about a quarter of the range, or a part of a constant value."""
    width = max(high - low, 1e-3 * max(abs(low), abs(high))) or 1.0
    power = 10.0 ** math.floor(math.log10(width / 4))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= width / 4)
