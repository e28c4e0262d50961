"""Histograms and paths as SVG path data; the template gives them their colours.

Drawn by hand and not by matplotlib: a page has hundreds of plots, which then cost milliseconds and a few kilobytes
each instead of a fifth of a second and sixty, and take their colours from the page, light or dark. All are drawn into
a field of WIDTH × HEIGHT that the page stretches; what must not be stretched (words, dots) has its share of it.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec

from hil_bench.report.axis import Axis, axis, is_drawable, line, round_step
from hil_bench.report.formatting import number, scale_of
from hil_bench.result import Distribution, Path2D

WIDTH = 1000
HEIGHT = 300
PATH_POINTS = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """Something at one place of an axis."""

    share: float
    text: str
    kind: str = ""


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

    bar_m = round_step(span / 6)
    return PathDrawing(
        height=height,
        wanted=line(placed(wanted)),
        driven=line(placed(driven)),
        start=placed(driven)[0] if driven else None,
        bar=round(bar_m * scale),
        bar_text=f"{number(bar_m)} m",
    )


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
