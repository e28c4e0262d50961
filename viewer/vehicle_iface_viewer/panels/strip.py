"""The strip: the states of a time as colours, with ticks for limited commands, drops, late passes and stops."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle_iface.telemetry.columns import GAP_NS, Columns
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase, limit_spans
from vehicle_iface_viewer.panels.colors import AMBER, BLUE, GREEN, GREY, LIMITED, RED, TEAL, VIOLET, state_color
from vehicle_iface_viewer.panels.text import plain

COLUMNS = 300
"""Of each column the worst state is drawn."""
_BEST_TO_WORST = (GREEN, BLUE, TEAL, GREY, VIOLET, AMBER, RED)
_UNKNOWN = -1
_STOP, _DROPPED, _LATE = "#fff", "#74c0fc", "#ffd43b"
_HEIGHT = 32
_LANES = ((10, 20), (23.5, 3), (27, 3), (30.5, 3))
"""Middle and height of each lane, the first of which is drawn over the states."""

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """The time that a strip shows, in `COLUMNS` columns."""

    begin_ns: int
    width_ns: int
    """Of a column."""

    @classmethod
    def until(cls, now_ns: int, length_ns: int) -> Span:
        """Return the span that ends soon after `now_ns`: its columns begin at whole multiples of their width."""
        width_ns = max(length_ns // COLUMNS, 1)
        return cls(begin_ns=(now_ns // width_ns - COLUMNS + 1) * width_ns, width_ns=width_ns)

    @classmethod
    def between(cls, begin_ns: int, end_ns: int) -> Span:
        """Return the span of a whole drive."""
        return cls(begin_ns=begin_ns, width_ns=max(-(-(end_ns - begin_ns) // COLUMNS), 1))

    @property
    def end_ns(self) -> int:
        """End of the last column."""
        return self.begin_ns + COLUMNS * self.width_ns

    def columns(self, times_ns: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return the column of each time; a time outside is in the first or in the last one."""
        found: npt.NDArray[np.int64] = (np.asarray(times_ns, np.int64) - self.begin_ns) // self.width_ns
        return np.clip(found, 0, COLUMNS - 1)


def strip_html(name: str, span: Span, rows: Columns, events: Iterable[LoopEvent], ends: tuple[str, str]) -> str:
    """Return the strip, and in words what it has. `rows` are snapshots of that time; `ends` name its two ends."""
    inside = [event for event in events if event.at_ns < span.end_ns]
    stops = [event for event in inside if _is_stop(event) and event.at_ns >= span.begin_ns]
    dropped, late = _rises(rows, "drops"), _rises(rows, "deadline_misses")
    lanes = (
        ("stops", len(stops), _STOP, _flags(span.columns([event.at_ns for event in stops]))),
        ("limited", 0, LIMITED, _limited(span, inside)),
        ("dropped", int(dropped.sum()), _DROPPED, _flags(span.columns(rows["published_ns"][dropped > 0]))),
        ("late", int(late.sum()), _LATE, _flags(span.columns(rows["published_ns"][late > 0]))),
    )
    states = _states(span, rows)
    shapes = [_path(states == k, 12, 16, color) for k, color in enumerate(_BEST_TO_WORST)]
    shapes += [_path(flags, y, height, color) for (_, _, color, flags), (y, height) in zip(lanes, _LANES, strict=True)]
    words = " ".join(
        f'<span><i style="background:{color}"></i>{word}{f" {count}" if count else ""}</span>'
        for word, count, color, flags in lanes
        if flags.any()
    )
    return (
        f'<div class="vi-strip" id="strip-{name}"><svg viewBox="0 0 {COLUMNS} {_HEIGHT}" preserveAspectRatio="none">'
        f"{''.join(shapes)}</svg><div><span>{plain(ends[0])}</span>{words}<span>{plain(ends[1])}</span></div></div>"
    )


def _states(span: Span, rows: Columns) -> npt.NDArray[np.int64]:
    """Return the place of each column's worst state in `_BEST_TO_WORST`."""
    worst = np.full(COLUMNS, _UNKNOWN)
    if not len(rows):
        return worst
    codes, kinds = np.unique(rows["controller_state"] * 1000 + rows["reason"], return_inverse=True)
    ranks = [_BEST_TO_WORST.index(state_color(int(code) // 1000, int(code) % 1000)) for code in codes]
    rank, at_ns = np.array(ranks)[kinds], rows["published_ns"]
    column = span.columns(at_ns)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    worst[column[starts]] = np.maximum.reduceat(rank, starts)
    # A column without a snapshot has the state of the one before it, unless that is long ago.
    empty = np.flatnonzero(worst == _UNKNOWN)
    after = np.searchsorted(at_ns, span.begin_ns + empty * span.width_ns)
    is_inside = (after > 0) & (after < len(at_ns))
    empty, after = empty[is_inside], after[is_inside]
    is_near = at_ns[after] - at_ns[after - 1] <= max(GAP_NS, 2 * span.width_ns)
    worst[empty[is_near]] = rank[after[is_near] - 1]
    return worst


def _is_stop(event: LoopEvent) -> bool:
    return event.kind is EventKind.STOP and event.phase is not Phase.ENDED


def _rises(rows: Columns, counter: str) -> npt.NDArray[np.int64]:
    """Return by how much a counter is above that of the snapshot before."""
    values = rows[counter]
    return np.maximum(np.diff(values, prepend=values[:1]), 0)


def _limited(span: Span, events: Sequence[LoopEvent]) -> Flags:
    """Mark the columns in which a limit acted."""
    flags = np.zeros(COLUMNS, np.bool_)
    for begin_ns, end_ns in limit_spans(events, span.begin_ns, span.end_ns):
        if end_ns >= span.begin_ns:
            first, last = span.columns([begin_ns, end_ns])
            flags[first : last + 1] = True
    return flags


def _flags(columns: npt.NDArray[np.int64]) -> Flags:
    flags = np.zeros(COLUMNS, np.bool_)
    flags[columns] = True
    return flags


def _path(flags: Flags, y: float, height: float, color: str) -> str:
    """Return the marked columns as one path of horizontal strokes."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False)).tolist()
    strokes = "".join(f"M{begin} {y:g}h{end - begin}" for begin, end in zip(edges[::2], edges[1::2], strict=True))
    return f'<path d="{strokes}" stroke="{color}" stroke-width="{height:g}"/>' if strokes else ""
