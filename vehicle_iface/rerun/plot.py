"""Plots what a rerun sent beside what was recorded: each signal that differs, over the whole drive, on one page."""

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vehicle_iface.export.page.model import Curve, Drive, Page, PageEvent, Plot, Ticks
from vehicle_iface.export.page.packing import pack
from vehicle_iface.export.page.render import render_page
from vehicle_iface.frame import FrameKey
from vehicle_iface.recorder.inputs import FrameFields
from vehicle_iface.rerun.compare import Comparison, key_of
from vehicle_iface.rerun.report import Difference, RerunReport
from vehicle_iface.trajectory import FloatArray

GAP_PERIODS = 5.0
"""After so many of its usual periods without a frame nothing is known of a message."""
MAX_PLOTS = 40
_TIME_DECIMALS, _VALUE_DECIMALS = 4, 4
_TICKS_PER_S = 10
_STEP_S = 1e-4


class _Side(NamedTuple):
    name: str
    color: str
    width: float


_SIDES = (_Side("recorded", "drive-a", 4.0), _Side("today", "drive-b", 1.6))


class _Sent(NamedTuple):
    """The frames of one message."""

    times_s: FloatArray
    signals: dict[str, FloatArray]


class SentTrace:
    """All frames that were sent, recorded and today."""

    def __init__(self) -> None:
        self._frames: dict[FrameKey, tuple[list[tuple[float, bytes]], list[tuple[float, bytes]]]] = {}
        self.end_s = 0.0
        """Time of the last pass."""

    def add_pass(self, at_s: float, recorded: Iterable[FrameFields], today: Iterable[FrameFields]) -> None:
        """Add the frames of one pass."""
        self.end_s = at_s
        for side, frames in enumerate((recorded, today)):
            for frame in frames:
                self._frames.setdefault(key_of(frame), ([], []))[side].append((at_s, frame[1]))

    def decode(self, comparison: Comparison, messages: Iterable[str]) -> dict[str, list[_Sent]]:
        """Return the frames of these messages by name: recorded and today.

        A value is NaN where the frame cannot be decoded, and in a row of its own where frames are missing.
        """
        names = {comparison.name(key): key for key in self._frames}
        return {
            name: [_decode(self._frames[names[name]][side], names[name], comparison) for side in range(len(_SIDES))]
            for name in messages
            if name in names
        }


def render_differences(report: RerunReport, trace: SentTrace, comparison: Comparison) -> str:
    """Return the page; without a difference it only says so."""
    drives, plots = [_mark_differences(report, trace.end_s)], list[Plot]()
    for name, sides in trace.decode(comparison, report.by_message).items():
        first = len(drives)
        drives += [
            Drive(label=f"{name} {side.name}", color=side.color, time=pack(sent.times_s, _TIME_DECIMALS))
            for side, sent in zip(_SIDES, sides, strict=True)
        ]
        recorded, today = sides
        plots += [
            Plot(title=f"{name} {signal}", unit="", digits=3, curves=_draw_signal(name, signal, first, sides))
            for signal, values in recorded.signals.items()
            if not np.array_equal(values, today.signals[signal], equal_nan=True)
        ]
    title = f"Rerun of {Path(report.folder).resolve().name}"
    lines = [f'<p class="quiet">{escape(line)}</p>' for line in report.text.splitlines()]
    if len(plots) > MAX_PLOTS:
        lines.append(f'<p class="note">{len(plots)} signals differ; the first {MAX_PLOTS} are drawn.</p>')
    page = Page(name=title.lower().replace(" ", "-"), drives=drives, plots=plots[:MAX_PLOTS], has_way=False)
    return render_page(title, page, f"<h1>{escape(title)}</h1>{''.join(lines)}")


def _decode(frames: Sequence[tuple[float, bytes]], key: FrameKey, comparison: Comparison) -> _Sent:
    times_s = np.array([at_s for at_s, _ in frames], np.float64)
    steps_s = np.diff(times_s)
    before = np.flatnonzero(steps_s > GAP_PERIODS * np.median(steps_s)) if len(steps_s) else np.empty(0, np.int64)
    decoded = [comparison.decode(key, data) for _, data in frames]
    return _Sent(
        np.insert(times_s, before + 1, times_s[before] + _STEP_S),
        {
            name: np.insert(np.array([one.get(name, np.nan) for one in decoded], np.float64), before + 1, np.nan)
            for name in comparison.signals(key)
        },
    )


def _draw_signal(message: str, signal: str, first: int, sides: Sequence[_Sent]) -> list[Curve]:
    return [
        Curve(
            drive=first + number,
            key=f"{message}.{signal} {side.name}",
            label=side.name,
            color=side.color,
            width=side.width,
            is_stepped=True,
            values=pack(sent.signals[signal], _VALUE_DECIMALS),
        )
        for number, (side, sent) in enumerate(zip(_SIDES, sides, strict=True))
    ]


def _mark_differences(report: RerunReport, end_s: float) -> Drive:
    """Return the differences as the events of a drive of their own."""
    found = sorted(report.differences, key=lambda difference: difference.at_s)
    times_s = np.unique(np.floor(np.array([one.at_s for one in found]) * _TICKS_PER_S)) / _TICKS_PER_S
    return Drive(
        label="differences",
        color="limit",
        time=pack(np.array([0.0, end_s]), _TIME_DECIMALS),
        ticks=[Ticks(label="differences", color="limit", at_s=times_s.tolist())],
        events=[_describe(one) for one in found],
        events_left_out=report.count - len(found),
    )


def _describe(difference: Difference) -> PageEvent:
    at_s = round(difference.at_s, _TIME_DECIMALS)
    return PageEvent(at_s=at_s, kind="different", name=difference.message, text=difference.what)
