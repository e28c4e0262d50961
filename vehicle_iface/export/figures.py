"""What a drive amounts to: errors of tracking, stops, limited commands, latency."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry.columns import Columns
from vehicle_iface.telemetry.details import ErrorSummary
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_MS, s_from_ns

UNKNOWN = "–"


@dataclass(frozen=True, slots=True, kw_only=True)
class Latencies:
    """From the arrival of a sample to the sending of its command, in ms."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveFigures:
    """Figures of a drive, or of a part of it. An error is None where nothing was driven."""

    duration_s: float
    driven_s: float
    """Time in ENGAGED."""
    distance_m: float
    """Along the path."""
    max_speed_mps: float
    lateral_m: ErrorSummary | None
    heading_deg: ErrorSummary | None
    stops: Sequence[str]
    """Reason and reaction of each, in the order of time."""
    commands: int
    limited: dict[str, int]
    """Commands that the gate changed, by limit; limits that did not act are left out."""
    latency: Latencies | None


def measure_drive(
    rows: Columns, way_m: FloatArray, events: Iterable[LoopEvent], limited: dict[str, int]
) -> DriveFigures:
    """Return the figures of rows as `to_columns` returns them; `limited` are the gate's counts."""
    times_ns = rows["published_ns"]
    steps_ns = np.diff(times_ns, append=times_ns[-1])
    is_engaged = rows["controller_state"] == ControllerState.ENGAGED
    follows = is_engaged & rows["sent"] & rows["has_reference"] & (rows["reason"] == Reason.NOMINAL)
    speeds = np.abs(rows["speed_mps"][rows["has_state"] & np.isfinite(rows["speed_mps"])])
    return DriveFigures(
        duration_s=s_from_ns(int(times_ns[-1] - times_ns[0])),
        driven_s=s_from_ns(int(steps_ns[is_engaged].sum())),
        distance_m=float(way_m[-1] - way_m[0]),
        max_speed_mps=float(speeds.max(initial=0.0)),
        lateral_m=_measure_error(rows["lateral_error_m"][follows]),
        heading_deg=_measure_error(np.degrees(rows["heading_error_rad"][follows])),
        stops=[f"{event.name} {event.text}".strip() for event in events if _is_stop(event)],
        commands=int(rows["commands"][-1] - rows["commands"][0] + rows["sent"][0]),
        limited={name: count for name, count in limited.items() if count},
        latency=_measure_latency(rows["latency_ns"][rows["sent"]]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureRow:
    """One line of the table: its name and the value of each drive, as text."""

    name: str
    values: Sequence[str]


def tabulate(drives: Sequence[DriveFigures]) -> list[FigureRow]:
    """Return the table of the figures of one drive or of several."""
    return [FigureRow(name=name, values=[write(drive) for drive in drives]) for name, write in _ROWS]


def _is_stop(event: LoopEvent) -> bool:
    return event.kind is EventKind.STOP and event.phase is Phase.BEGAN


def _measure_error(errors: FloatArray) -> ErrorSummary | None:
    sizes = np.abs(errors[np.isfinite(errors)])
    if not len(sizes):
        return None
    rms = float(np.sqrt(np.mean(np.square(sizes))))
    return ErrorSummary(rms=rms, p95=float(np.percentile(sizes, 95)), max=float(sizes.max()))


def _measure_latency(latency_ns: FloatArray) -> Latencies | None:
    if not len(latency_ns):
        return None
    p50, p99, highest = np.percentile(latency_ns / NS_PER_MS, (50, 99, 100))
    return Latencies(p50=float(p50), p99=float(p99), max=float(highest))


def _write_error(error: ErrorSummary | None, unit: str, digits: int) -> str:
    if error is None:
        return UNKNOWN
    return f"{error.rms:.{digits}f} · {error.p95:.{digits}f} · {error.max:.{digits}f} {unit}"


def _write_stops(drive: DriveFigures) -> str:
    counts = {stop: drive.stops.count(stop) for stop in drive.stops}
    return ", ".join(f"{count} × {stop}" if count > 1 else stop for stop, count in counts.items()) or "none"


def _write_limited(drive: DriveFigures) -> str:
    return ", ".join(f"{name} {count:,}" for name, count in drive.limited.items()) or "none"


def _write_latency(drive: DriveFigures) -> str:
    found = drive.latency
    return UNKNOWN if found is None else f"{found.p50:.2f} · {found.p99:.2f} · {found.max:.2f} ms"


_ROWS: tuple[tuple[str, Callable[[DriveFigures], str]], ...] = (
    ("Duration", lambda drive: f"{drive.duration_s:.1f} s, {drive.driven_s:.1f} s of it engaged"),
    ("Way along the path", lambda drive: f"{drive.distance_m:.1f} m"),
    ("Highest speed", lambda drive: f"{drive.max_speed_mps:.2f} m/s"),
    ("Lateral error: RMS · 95 % · max", lambda drive: _write_error(drive.lateral_m, "m", 3)),
    ("Heading error: RMS · 95 % · max", lambda drive: _write_error(drive.heading_deg, "°", 2)),
    ("Stops", _write_stops),
    ("Commands", lambda drive: f"{drive.commands:,}"),
    ("Commands changed by a limit", _write_limited),
    ("Latency: p50 · p99 · max", _write_latency),
)
