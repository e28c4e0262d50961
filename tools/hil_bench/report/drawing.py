"""Curves, histograms, paths and time lines as SVG path data; the template gives them their colours.

Drawn by hand and not by matplotlib: a page has hundreds of plots, which then cost milliseconds and a few kilobytes
each instead of a fifth of a second and sixty, and take their colours from the page, light or dark. All are drawn into
a field of WIDTH × HEIGHT that the page stretches; what must not be stretched (words, dots) has its share of it.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import msgspec

from hil_bench.report.formatting import is_finite, number, scale_of
from hil_bench.result import CaseResult, Distribution, Event, EventKind, Path2D, Plot, Series

WIDTH = 1000
HEIGHT = 300
COLUMNS = 250
"""Of a curve: each is drawn by its lowest and its highest value."""
PATH_POINTS = 400
LARGEST = 1e9
"""Beyond it a value is not drawn: everything else would be a flat line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """From `low` to `high`, with round numbers between them."""

    low: float
    high: float
    step: float

    def share(self, value: float) -> float:
        """0 at the low end, 1 at the high one."""
        return (value - self.low) / (self.high - self.low)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Share and text of each round number."""
        first, last = math.ceil(self.low / self.step - 1e-9), math.floor(self.high / self.step + 1e-9)
        return [(self.share(n * self.step), number(round(n * self.step, 12))) for n in range(first, last + 1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One line of a plot."""

    name: str
    d: str
    undrawn: int
    """Values that are missing, not finite or too large."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """Something at one place of an axis."""

    share: float
    text: str
    kind: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotDrawing:
    """Curves, and the bands that they must not enter, as shares of the height from the bottom."""

    title: str
    unit: str
    x: Axis
    y: Axis
    curves: list[Curve]
    lowest: float | None
    highest: float | None
    marks: list[Mark]


@dataclass(frozen=True, slots=True, kw_only=True)
class HistogramDrawing:
    """Bars on a logarithmic count, so that the single late one is seen."""

    bars: str
    unit: str
    x: Axis
    y_ticks: list[tuple[float, str]]
    marks: list[Mark]
    limit_beyond: bool
    """The limit is too far away to be drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PathDrawing:
    """To scale, seen from above, +y upwards."""

    height: int
    wanted: str
    driven: str
    start: tuple[int, int] | None
    bar: int
    """Length of the scale bar, of WIDTH."""
    bar_text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """An event: where on the line it is, and where its words are."""

    event: Event
    share: float
    column: float
    since: str
    """From the injection, or from the beginning of the case."""


def axis(values: Iterable[float], count: int = 5, margin: float = 0.0) -> Axis:
    """Over all of them; never empty."""
    drawn = [value for value in values if is_drawable(value)] or [0.0, 1.0]
    low, high = min(drawn), max(drawn)
    if high - low <= 1e-9 * max(1.0, abs(low), abs(high)):
        spread = max(abs(low) * 0.1, 1e-3)
        low, high = low - spread, high + spread
    low, high = low - margin * (high - low), high + margin * (high - low)
    return Axis(low=low, high=high, step=_round_step((high - low) / count))


def is_drawable(value: float | None) -> bool:
    return is_finite(value) and abs(value or 0.0) <= LARGEST


def plots(case: CaseResult) -> list[PlotDrawing]:
    """All on the same time axis, so that they can be read one below the other."""
    times = [at_s for plot in case.plots for series in plot.series for at_s in series.at_s]
    x = axis(times)
    marks = _marks(case.events, x)
    return [_plot(plot, x, marks) for plot in case.plots]


def histogram(distribution: Distribution) -> HistogramDrawing:
    """The limit is drawn unless it would squeeze the bars into a corner."""
    distribution = _in_readable_unit(distribution)
    edges = [edge for edge in distribution.edges if is_drawable(edge)]
    limit = distribution.limit if is_drawable(distribution.limit) else None
    top = max(edges, default=0.0)
    beyond = limit is not None and limit > 4.0 * top
    x = axis([*edges, *([] if limit is None or beyond else [limit])])
    most = max(distribution.counts, default=0)
    named = [("p50", distribution.p50), ("p95", distribution.p95), ("p99", distribution.p99), ("max", distribution.max)]
    marks = [Mark(share=x.share(value), text=name, kind="quantile") for name, value in named if is_drawable(value)]
    if limit is not None and not beyond:
        marks.append(Mark(share=x.share(limit), text="limit", kind="limit"))
    decades = range(len(str(most)))
    return HistogramDrawing(
        bars=_bars(distribution, x, most) if most and len(edges) == len(distribution.edges) else "",
        unit=distribution.unit,
        x=x,
        y_ticks=[(_tall(10**decade, most), f"{10**decade:,}".replace(",", " ")) for decade in decades] if most else [],
        marks=[mark for mark in marks if 0.0 <= mark.share <= 1.0],
        limit_beyond=beyond,
    )


def path(found: Path2D) -> PathDrawing:
    """One scale for both axes. What is wanted far beyond where the vehicle came is cut off at the drawing's edge."""
    wanted = _points(found.wanted_x_m, found.wanted_y_m)
    driven = _points(found.driven_x_m, found.driven_y_m)
    shown = [*wanted, *driven] or [(0.0, 0.0)]
    if driven and _span(shown) > 2.0 * _span(driven):
        shown = driven
    left, right = min(x for x, _ in shown), max(x for x, _ in shown)
    low, high = min(y for _, y in shown), max(y for _, y in shown)
    span = _span(shown)
    edge = 0.04 * WIDTH
    scale = (WIDTH - 2 * edge) / span
    height = round(max(0.12 * WIDTH, (high - low) * scale + 2 * edge))
    from_left = (WIDTH - (right - left) * scale) / 2
    from_top = (height - (high - low) * scale) / 2

    def placed(points: list[tuple[float, float]]) -> list[tuple[int, int]]:
        return [(round(from_left + (x - left) * scale), round(from_top + (high - y) * scale)) for x, y in points]

    bar_m = _round_step(span / 6)
    return PathDrawing(
        height=height,
        wanted=_line(placed(wanted)),
        driven=_line(placed(driven)),
        start=placed(driven)[0] if driven else None,
        bar=round(bar_m * scale),
        bar_text=f"{number(bar_m)} m",
    )


def stations(events: Sequence[Event]) -> list[Station]:
    """In order of time; the words stand evenly below the line, and what is close together in time can still be read."""
    ordered = sorted((event for event in events if is_drawable(event.at_s)), key=lambda event: event.at_s)
    if not ordered:
        return []
    begin_s = next((event.at_s for event in ordered if event.kind is EventKind.INJECTION), 0.0)
    first_s, last_s = ordered[0].at_s, ordered[-1].at_s
    span_s = max(last_s - first_s, 1e-9)
    return [
        Station(
            event=event,
            share=(event.at_s - first_s) / span_s,
            column=(place + 0.5) / len(ordered),
            since=_since(event.at_s - begin_s),
        )
        for place, event in enumerate(ordered)
    ]


def _since(seconds: float) -> str:
    sign = "−" if seconds < 0 else "+"
    return f"{sign}{abs(seconds) * 1e3:.0f} ms" if abs(seconds) < 1.0 else f"{sign}{abs(seconds):.2f} s"


def _plot(plot: Plot, x: Axis, marks: list[Mark]) -> PlotDrawing:
    bounds = [bound for bound in (plot.lowest, plot.highest) if bound is not None]
    y = axis([value for s in plot.series for value in s.values if value is not None] + bounds, count=4, margin=0.08)
    return PlotDrawing(
        title=plot.title,
        unit=plot.unit,
        x=x,
        y=y,
        curves=[_curve(series, x, y) for series in plot.series],
        lowest=y.share(plot.lowest) if plot.lowest is not None and is_drawable(plot.lowest) else None,
        highest=y.share(plot.highest) if plot.highest is not None and is_drawable(plot.highest) else None,
        marks=marks,
    )


def _marks(events: Sequence[Event], x: Axis) -> list[Mark]:
    marks = [Mark(share=x.share(e.at_s), text=e.kind, kind=slug(e.kind)) for e in events if is_drawable(e.at_s)]
    return [mark for mark in marks if 0.0 <= mark.share <= 1.0]


def slug(kind: EventKind) -> str:
    return kind.replace(" ", "-")


def _curve(series: Series, x: Axis, y: Axis) -> Curve:
    pieces: list[list[tuple[int, int]]] = [[]]
    undrawn = 0
    for at_s, value in zip(series.at_s, series.values, strict=False):
        if value is not None and is_drawable(value) and is_drawable(at_s):
            pieces[-1].append((round(x.share(at_s) * WIDTH), round((1.0 - y.share(value)) * HEIGHT)))
        else:
            undrawn += 1
            if pieces[-1]:
                pieces.append([])
    return Curve(name=series.name, d="".join(_line(_thin_out(piece)) for piece in pieces), undrawn=undrawn)


def _thin_out(points: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Not more than COLUMNS × 4, with every extreme kept."""
    kept: list[tuple[int, int]] = []
    for _, column in itertools.groupby(points, key=lambda point: point[0] * COLUMNS // WIDTH):
        inside = list(column)
        wanted = (inside[0], min(inside, key=_height), max(inside, key=_height), inside[-1])
        kept += dict.fromkeys(sorted(wanted, key=inside.index))
    return kept


def _height(point: tuple[int, int]) -> int:
    return point[1]


def _line(points: list[tuple[int, int]]) -> str:
    """Relative steps, which are the shortest to write; steps in one direction are one."""
    if not points:
        return ""
    steps: list[tuple[int, int]] = []
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        dx, dy = x1 - x0, y1 - y0
        if (dx, dy) == (0, 0):
            continue
        if steps and dy == 0 and steps[-1][1] == 0 and steps[-1][0] * dx > 0:
            steps[-1] = (steps[-1][0] + dx, 0)
        else:
            steps.append((dx, dy))
    return f"M{points[0][0]} {points[0][1]}l" + " ".join(f"{dx} {dy}" for dx, dy in steps or [(0, 0)])


def _points(xs: Sequence[float], ys: Sequence[float]) -> list[tuple[float, float]]:
    found = [(x, y) for x, y in zip(xs, ys, strict=False) if is_drawable(x) and is_drawable(y)]
    stride = max(1, math.ceil(len(found) / PATH_POINTS))
    return [*found[::stride], *found[-1:]]


def _in_readable_unit(one: Distribution) -> Distribution:
    scale, unit = scale_of(one.unit, one.max)
    return msgspec.structs.replace(
        one,
        unit=unit,
        p50=one.p50 * scale,
        p95=one.p95 * scale,
        p99=one.p99 * scale,
        max=one.max * scale,
        edges=[edge * scale for edge in one.edges],
        limit=None if one.limit is None else one.limit * scale,
    )


def _span(points: list[tuple[float, float]]) -> float:
    """Width of a drawing that has room for them, m; a vehicle that stood has some of its path around it."""
    xs, ys = [x for x, _ in points], [y for _, y in points]
    return max(max(xs) - min(xs), (max(ys) - min(ys)) / 0.8, 5.0)


def _bars(distribution: Distribution, x: Axis, most: int) -> str:
    drawn = []
    for (low, high), count in zip(itertools.pairwise(distribution.edges), distribution.counts, strict=False):
        if count > 0:
            left, right = round(x.share(low) * WIDTH), round(x.share(high) * WIDTH)
            tall = max(2, round(_tall(count, most) * HEIGHT))
            drawn.append(f"M{left} {HEIGHT}v-{tall}h{max(1, right - left)}v{tall}z")
    return "".join(drawn)


def _tall(count: int, most: int) -> float:
    """A single one is seen, and the most fill nine tenths."""
    return 0.9 * (math.log10(count) + 0.3) / (math.log10(most) + 0.3)


def _round_step(rough: float) -> float:
    """1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(rough))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough * (1 - 1e-9))
