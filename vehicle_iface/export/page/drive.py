"""A recording as the data of a page."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vehicle_iface.errors import ConfigError
from vehicle_iface.export.columns import UNKNOWN, to_columns
from vehicle_iface.export.csv_file import name_of
from vehicle_iface.export.figures import DriveFigures, measure_drive
from vehicle_iface.export.page.model import Curve, Drive, Packed, PageEvent, PathLine, Plot, StateSpan, Ticks, Track
from vehicle_iface.export.page.packing import pack
from vehicle_iface.export.page.plots import PLOTS
from vehicle_iface.export.page.reduction import Reduction
from vehicle_iface.export.recording import RecordedDrive
from vehicle_iface.export.way import way_along_path
from vehicle_iface.recorder.files import Meta, TrajectoryLine
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry.columns import Columns, Flags
from vehicle_iface.telemetry.events import LoopEvent, limit_spans
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_S, s_from_ns

MAX_EVENTS = 3000
PATH_PERIOD_NS = NS_PER_S
"""Of trajectories that replace each other faster, one in this time is drawn."""
PATH_STEP_M = 0.5
_TIME_DECIMALS, _PLACE_DECIMALS, _VALUE_DECIMALS, _HEADING_DECIMALS, _PATH_DECIMALS = 4, 3, 4, 4, 2
_TICKS_PER_S = 10
LETTERS = "AB"
"""Names of drives that are compared."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadedDrive:
    """A recording in memory."""

    folder: Path
    meta: Meta
    rows: Columns
    way_m: FloatArray
    """How far along its path the vehicle had come at each row (n,)."""
    events: Sequence[LoopEvent]
    paths: Sequence[TrajectoryLine]
    figures: DriveFigures
    first_ns: int
    """Time of the first snapshot of the recording."""
    damaged: int

    @property
    def engaged_ns(self) -> int | None:
        """When the loop began to drive; None when it never did."""
        engaged = np.flatnonzero(self.rows["controller_state"] == ControllerState.ENGAGED)
        return int(self.rows["published_ns"][engaged[0]]) if len(engaged) else None


def load_drive(recording: RecordedDrive) -> LoadedDrive:
    """Read what a page needs. Raises `ConfigError` when a file cannot be read, or when there is nothing to show."""
    rows = to_columns(recording.snapshots())
    if not len(rows):
        raise ConfigError(f"{recording.folder}: no snapshot between --from and --to: there is nothing to show")
    way_m, events = way_along_path(rows), sorted(recording.events(), key=lambda event: event.at_ns)
    return LoadedDrive(
        folder=recording.folder,
        meta=recording.meta,
        rows=rows,
        way_m=way_m,
        events=events,
        paths=list(_choose_paths(recording.trajectories(), int(rows["published_ns"][0]))),
        figures=measure_drive(rows, way_m, events, _count_limited(recording)),
        first_ns=recording.first_ns,
        damaged=recording.damaged,
    )


def describe_drive(
    drive: LoadedDrive, *, label: str, color: str, zero_ns: int, way_offset_m: float | None = None
) -> Drive:
    """Return a drive whose times count from `zero_ns`; without an offset it has no way to be compared."""
    rows = drive.rows
    reduction = Reduction.of(len(rows))
    shape = drive.meta.session.shape
    times_s = (rows["published_ns"] - zero_ns) / NS_PER_S
    return Drive(
        label=label,
        color=color,
        time=pack(reduction.pick(times_s), _TIME_DECIMALS),
        way=None if way_offset_m is None else pack(reduction.pick(drive.way_m + way_offset_m), _PLACE_DECIMALS),
        states=list(_find_states(rows, times_s)),
        ticks=_find_ticks(rows, times_s, drive.events),
        events=[_describe_event(event, zero_ns) for event in drive.events[:MAX_EVENTS]],
        events_left_out=max(0, len(drive.events) - MAX_EVENTS),
        track=Track(
            x=_pack_place(reduction.pick(_where_known(rows, "x_m"))),
            y=_pack_place(reduction.pick(_where_known(rows, "y_m"))),
            heading=pack(reduction.pick(_where_known(rows, "heading_rad")), _HEADING_DECIMALS),
            reference_x=_pack_place(reduction.pick(_where_known(rows, "spatial_reference_x_m", "has_reference"))),
            reference_y=_pack_place(reduction.pick(_where_known(rows, "spatial_reference_y_m", "has_reference"))),
            length_m=shape.length_m,
            width_m=shape.width_m,
            height_m=shape.height_m,
            wheelbase_m=shape.wheelbase_m,
            rear_overhang_m=shape.rear_overhang_m,
            paths=_join_paths(drive.paths),
        ),
    )


def describe_plots(drives: Sequence[LoadedDrive], colors: Sequence[str] = ()) -> list[Plot]:
    """Return all plots: with `colors`, one for each drive, only the curves that are compared."""
    ranges = [drive.meta.session.limits for drive in drives]
    plots = []
    for kind in PLOTS:
        curves = []
        for number, drive in enumerate(drives):
            reduction = Reduction.of(len(drive.rows))
            curves += [
                Curve(
                    drive=number,
                    key=curve.key,
                    label=f"{LETTERS[number]} {curve.label}" if colors else curve.label,
                    color=colors[number] if colors else curve.color,
                    width=1.6 if colors else curve.width,
                    values=pack(reduction.extremes(curve.read(drive.rows)), _VALUE_DECIMALS),
                )
                for curve in kind.curves
                if curve.is_compared or not colors
            ]
        lows, highs = zip(*(kind.range(limits) for limits in ranges), strict=True)
        plots.append(
            Plot(
                title=kind.title,
                unit=kind.unit,
                digits=kind.digits,
                low=min(lows),
                high=max(highs),
                limits=sorted({limit for limits in ranges for limit in kind.limits(limits)}),
                curves=curves,
            )
        )
    return plots


def _choose_paths(paths: Iterable[TrajectoryLine], begin_ns: int) -> Iterator[TrajectoryLine]:
    """Yield the trajectory that is in force at first, and then at most one in `PATH_PERIOD_NS`."""
    before: TrajectoryLine | None = None
    due_ns = begin_ns
    for path in paths:
        if path.stamp_ns < due_ns:
            before = path
            continue
        if before is not None and before.stamp_ns <= begin_ns:
            yield before
        before = None
        due_ns = path.stamp_ns + PATH_PERIOD_NS
        yield path
    if before is not None:
        yield before


def _join_paths(paths: Sequence[TrajectoryLine]) -> PathLine:
    """Return all paths as one line with gaps."""
    gap = np.array([np.nan])
    pieces = [part for path in paths for part in (_thin_out(path), gap[:, None].repeat(2, axis=1))]
    points = np.concatenate([np.empty((0, 2)), *pieces])
    return PathLine(x=_pack_place(points[:, 0], _PATH_DECIMALS), y=_pack_place(points[:, 1], _PATH_DECIMALS))


def _thin_out(path: TrajectoryLine) -> FloatArray:
    """Return points about `PATH_STEP_M` apart, with the first and the last (n, 2)."""
    points = np.column_stack([path.x_m, path.y_m])
    if len(points) < 2:
        return points
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    _, first = np.unique(np.floor(way_m / PATH_STEP_M), return_index=True)
    kept: FloatArray = points[np.union1d(first, [len(points) - 1])]
    return kept


def _pack_place(values: FloatArray, decimals: int = _PLACE_DECIMALS) -> Packed:
    """Pack coordinates: those of a map's grid are millions of metres."""
    known = values[np.isfinite(values)]
    return pack(values, decimals, offset=float(np.rint(known[0])) if len(known) else 0.0)


def _where_known(rows: Columns, name: str, flag: str = "has_state") -> FloatArray:
    return np.where(rows[flag], rows[name], np.nan)


def _find_states(rows: Columns, times_s: FloatArray) -> Iterator[StateSpan]:
    """Yield each change of state, reason, mode and gear."""
    columns = np.stack([rows["controller_state"], rows["reason"], rows["vehicle_mode"], rows["gear"]], axis=1)
    columns[~rows["has_status"], 2:] = UNKNOWN
    changed = np.flatnonzero(np.any(np.diff(columns, axis=0) != 0, axis=1)) + 1
    for row in (0, *changed.tolist()):
        at_s = round(float(times_s[row]), _TIME_DECIMALS)
        state, reason, mode, gear = columns[row].tolist()
        if state == UNKNOWN:
            yield StateSpan(at_s, "", "", "", "")
            continue
        has_status = mode != UNKNOWN
        yield StateSpan(
            at_s,
            name_of("controller_state", state),
            name_of("reason", reason),
            name_of("vehicle_mode", mode) if has_status else "",
            name_of("gear", gear) if has_status else "",
        )


def _find_ticks(rows: Columns, times_s: FloatArray, events: Iterable[LoopEvent]) -> list[Ticks]:
    def at(happened: Flags) -> list[float]:
        times: list[float] = (np.unique(np.floor(times_s[happened] * _TICKS_PER_S)) / _TICKS_PER_S).tolist()
        return times

    times_ns = rows["published_ns"]
    is_limited = np.zeros(len(rows), np.bool_)
    for begin_ns, end_ns in limit_spans(events, int(times_ns[0]), int(times_ns[-1])):
        first, last = np.searchsorted(times_ns, (begin_ns, end_ns))
        is_limited[first : max(last, first + 1)] = True
    return [
        Ticks(label="limited commands", color="limited", at_s=at(is_limited)),
        Ticks(label="dropped frames", color="dropped", at_s=at(_rises(rows["drops"]))),
        Ticks(label="late commands", color="late", at_s=at(_rises(rows["deadline_misses"]))),
    ]


def _rises(counts: FloatArray) -> Flags:
    rises: Flags = np.diff(counts, prepend=counts[0]) > 0
    return rises


def _describe_event(event: LoopEvent, zero_ns: int) -> PageEvent:
    at_s = round(s_from_ns(event.at_ns - zero_ns), _TIME_DECIMALS)
    return PageEvent(at_s=at_s, kind=event.kind, name=event.name, phase=event.phase, text=event.text)


def _count_limited(recording: RecordedDrive) -> dict[str, int]:
    """Commands that the gate changed, by limit, between the first and the last counters of the part."""
    first: dict[str, int] | None = None
    last: dict[str, int] = {}
    for line in recording.counters():
        last = line.counters.limited
        first = last if first is None else first
    if recording.is_whole or first is None:
        return last
    return {name: count - first.get(name, 0) for name, count in last.items()}
