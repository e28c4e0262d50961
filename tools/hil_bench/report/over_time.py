"""Everything of a case that is drawn over time, on one axis: events, strips of named values, and plots.

Drawn into a field of WIDTH × HEIGHT that the page stretches and zooms: WIDTH is so large that a millisecond of a case
can still be seen.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from hil_bench.report.axis import Axis, axis, is_drawable, line
from hil_bench.report.formatting import number
from hil_bench.result import CaseResult, Event, EventKind, Plot, Series, Strip

WIDTH = 20_000
HEIGHT = 2000
MOST_POINTS = 1000
COLUMNS = 250
"""Of a curve with more points: each is drawn by its lowest and its highest value."""
FAR = 1.5
"""Limits further away than this, in heights of the curves, are named but not drawn."""
STRETCH = 3.0
"""Limits are drawn if the plot is no more than this many times as high as without them."""


COLOURS = {
    ("MODE", "AUTONOMOUS"): "good",
    ("MODE", "FAULT"): "bad",
    ("MODE", "EMERGENCY_STOP"): "bad",
    ("ENABLE", "0"): "off",
    ("ENABLE", "1"): "good",
    ("SAFE_STOP", "0"): "off",
    ("SAFE_STOP", "1"): "stop",
    ("REASON", "NOMINAL"): "good",
}
"""Of values that mean the same in every case."""
OTHERS = ("s1", "s3", "s4", "s5")
LEAST_SPAN = {"m/s": 0.5, "m/s²": 0.5, "rad": 0.05, "m": 0.1}
"""A plot is at least so high, so that noise does not look like motion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One line of a plot."""

    name: str
    d: str
    undrawn: int
    """Values that are missing, not finite or too large."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """A line that the curves must not cross, and the area beyond it."""

    d: str
    beyond: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotDrawing:
    """Curves and their limits."""

    title: str
    unit: str
    y: Axis
    curves: list[Curve]
    limits: list[Limit]
    far: str
    """Limits that are too far away to be drawn, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """A part of a strip, as shares of its width."""

    left: float
    width: float
    value: str
    colour: str
    since_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StripDrawing:
    """A signal with named values."""

    name: str
    segments: list[Segment]


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """An event: where on the axis it is, and where its words are."""

    event: Event
    share: float
    column: float
    since: str
    """From the injection, or from the beginning of the case."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseDrawing:
    """All of them, on the axis `x`, s."""

    x: Axis
    injected_s: float | None
    stations: list[Station]
    strips: list[StripDrawing]
    plots: list[PlotDrawing]


def draw_case(case: CaseResult) -> CaseDrawing:
    """One time axis for all."""
    events = [event for event in case.events if is_drawable(event.at_s)]
    times = [at_s for plot in case.plots for series in plot.series for at_s in series.at_s]
    times += [at_s for strip in case.strips for at_s in strip.at_s] + [event.at_s for event in events]
    x = axis(times, count=8)
    return CaseDrawing(
        x=x,
        injected_s=_injected_s(events),
        stations=stations(events, x),
        strips=[_strip(strip, x) for strip in case.strips],
        plots=[_plot(plot, x) for plot in case.plots],
    )


def stations(events: Sequence[Event], x: Axis) -> list[Station]:
    """In order of time; the words stand evenly below the line, and what is close together in time can still be read."""
    ordered = sorted(events, key=lambda event: event.at_s)
    begin_s = _injected_s(ordered) or 0.0
    return [
        Station(
            event=event,
            share=x.share(event.at_s),
            column=(place + 0.5) / len(ordered),
            since=_since(event.at_s - begin_s),
        )
        for place, event in enumerate(ordered)
    ]


def _injected_s(events: Sequence[Event]) -> float | None:
    return next((event.at_s for event in events if event.kind is EventKind.INJECTION), None)


def _since(seconds: float) -> str:
    sign = "−" if seconds < 0 else "+"
    return f"{sign}{abs(seconds) * 1e3:.0f} ms" if abs(seconds) < 1.0 else f"{sign}{abs(seconds):.2f} s"


def _strip(strip: Strip, x: Axis) -> StripDrawing:
    others = [value for value in dict.fromkeys(strip.values) if value and (strip.name, value) not in COLOURS]
    colours = {value: OTHERS[number % len(OTHERS)] for number, value in enumerate(others)}
    ends_s = [*strip.at_s[1:], x.high]
    return StripDrawing(
        name=strip.name,
        segments=[
            Segment(
                left=x.share(at_s), width=max(0.0, x.share(end_s) - x.share(at_s)), value=value,
                colour=COLOURS.get((strip.name, value), "") or colours[value], since_s=at_s,
            )
            for at_s, end_s, value in zip(strip.at_s, ends_s, strip.values, strict=False)
            if value and is_drawable(at_s) and is_drawable(end_s)
        ],
    )  # fmt: skip


def _plot(plot: Plot, x: Axis) -> PlotDrawing:
    drawn = [value for series in plot.series for value in series.values if value is not None]
    bounds = [_Bound(plot.lowest, plot.lowest_at, -1.0), _Bound(plot.highest, plot.highest_at, 1.0)]
    drawn += _widen(drawn, LEAST_SPAN.get(plot.unit, 0.0))
    plain = axis(drawn, count=4, margin=0.08)
    height = plain.high - plain.low
    near = [bound for bound in bounds if bound.values and bound.distance(plain) <= FAR * height]
    y = axis(drawn + [value for bound in near for value in bound.values_near(plain, STRETCH * height)], 4, 0.08)
    far = [f"{number(bound.nearest)} {plot.unit}".strip() for bound in bounds if bound.values and bound not in near]
    return PlotDrawing(
        title=plot.title,
        unit=plot.unit,
        y=y,
        curves=[_curve(series, x, y) for series in plot.series],
        limits=[bound.draw(x, y) for bound in near],
        far=" and ".join(far),
    )


def _widen(values: Sequence[float], span: float) -> list[float]:
    """What makes the range of the values as large as `span`, around its middle."""
    found = [value for value in values if is_drawable(value)]
    if not found or max(found) - min(found) >= span:
        return []
    middle = (max(found) + min(found)) / 2.0
    return [middle - span / 2.0, middle + span / 2.0]


@dataclass(frozen=True, slots=True)
class _Bound:
    """A lower (`side` −1) or upper (+1) limit, constant or over time."""

    constant: float | None
    over_time: Series | None
    side: float

    @property
    def values(self) -> list[float]:
        series = self.over_time.values if self.over_time else [self.constant]
        return [value for value in series if value is not None and is_drawable(value)]

    @property
    def nearest(self) -> float:
        return min(self.values) if self.side > 0.0 else max(self.values)

    def distance(self, y: Axis) -> float:
        """From the plot to the nearest value."""
        return max(0.0, self.nearest - y.high if self.side > 0.0 else y.low - self.nearest)

    def values_near(self, y: Axis, within: float) -> list[float]:
        low, high = y.low - within / 2.0, y.high + within / 2.0
        return [min(max(value, low), high) for value in (min(self.values), max(self.values))]

    def draw(self, x: Axis, y: Axis) -> Limit:
        series = self.over_time or Series(name="", at_s=[x.low, x.high], values=[self.constant] * 2)
        edge = 0 if self.side > 0.0 else HEIGHT
        pieces = _pieces(series, x, y)
        areas = [f"{line([(piece[0][0], edge), *piece, (piece[-1][0], edge)])}z" for piece in pieces]
        return Limit(d="".join(map(line, pieces)), beyond="".join(areas))


def _curve(series: Series, x: Axis, y: Axis) -> Curve:
    pairs = zip(series.at_s, series.values, strict=False)
    undrawn = sum(value is not None and not (is_drawable(value) and is_drawable(at_s)) for at_s, value in pairs)
    return Curve(name=series.name, d="".join(map(line, _pieces(series, x, y))), undrawn=undrawn)


def _pieces(series: Series, x: Axis, y: Axis) -> list[list[tuple[int, int]]]:
    """The points between the gaps; values far outside of the plot are drawn at its edge."""
    pieces: list[list[tuple[int, int]]] = [[]]
    for at_s, value in zip(series.at_s, series.values, strict=False):
        if value is not None and is_drawable(value) and is_drawable(at_s):
            height = min(max(1.0 - y.share(value), -1.0), 2.0)
            pieces[-1].append((round(x.share(at_s) * WIDTH), round(height * HEIGHT)))
        elif pieces[-1]:
            pieces.append([])
    return [_thin_out(piece) for piece in pieces if piece]


def _thin_out(points: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Not more than COLUMNS × 4 of many, with every extreme kept."""
    if len(points) <= MOST_POINTS:
        return points
    kept: list[tuple[int, int]] = []
    for _, column in itertools.groupby(points, key=lambda point: point[0] * COLUMNS // WIDTH):
        inside = list(column)
        wanted = (inside[0], min(inside, key=_height), max(inside, key=_height), inside[-1])
        kept += dict.fromkeys(sorted(wanted, key=inside.index))
    return kept


def _height(point: tuple[int, int]) -> int:
    return point[1]
