"""Summary of a run: JSON for programs, a table for people."""

import msgspec
from msgspec import UNSET

from vehicle_iface.bus.link_state import LinkState
from vehicle_iface.telemetry.details import (
    ByCause,
    ErrorSummary,
    LatencySummary,
    LimitSummary,
    LinkSummary,
    RunSummary,
    ShadowSummary,
    StopSummary,
    TrackingSummary,
)

SHOWN_COUNTS = (
    "samples_before_engagement",
    "stops_on_stale_state",
    "commands_refused",
    "frames_not_sent",
    "messages_not_encoded",
    "foreign_commands",
    "controller_errors",
    "controller_too_slow",
    "link_losses",
)
"""Counters of the loop that the table shows where they are not zero."""

SHOWN_STOPS, SHOWN_LAPS = 10, 20
"""Rows of the table; JSON has all."""

_LOST = (LinkState.DOWN.name, LinkState.GONE.name)


def as_json(summary: RunSummary) -> bytes:
    """The summary for programs, indented."""
    return msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n"


def table(summary: RunSummary) -> str:
    """The summary for the terminal: one line for each thing that is not zero."""
    rows = [
        ("bus", summary.bus),
        ("wire", summary.wire),
        ("link", _link(summary.link)),
        *[("link lost", change.why) for change in summary.link.transitions if change.state in _LOST][-1:],
        ("ended", f"{summary.controller_state}, {summary.reason}"),
        *([("review", summary.review)] if summary.review is not UNSET else []),
        *([("latched fault", summary.latched_fault)] if summary.latched_fault else []),
        *_stops(summary.stops),
        ("duration", f"{summary.duration_s:.1f} s"),
        ("samples", f"{summary.samples} complete, {summary.incomplete_samples} incomplete"),
        ("commands", f"{summary.commands} sent"),
        ("deadline misses", str(summary.deadline_misses)),
    ]
    if summary.part_ages_s is not UNSET:
        ages = ", ".join(f"{name} {age_s * 1e3:.0f} ms" for name, age_s in summary.part_ages_s.items())
        rows.append(("oldest parts of a sample", ages))
    if summary.odometry_m is not UNSET:
        rows.append(("odometry", f"{summary.odometry_m:.1f} m driven; its error grows with the distance"))
    if summary.latency.count:
        rows.append(("latency state→command", "  ".join(_quantiles(summary.latency))))
    if summary.tracking is not UNSET:
        rows += _tracking(summary.tracking)
    rows += [(f"limit: {name}", _limit(limit)) for name, limit in summary.limits.items()]
    if summary.shadow is not UNSET and summary.shadow.takeovers:
        rows += _shadow(summary.shadow)
    for name in ("drops", "lost", "implausible", "deviations", "tx_blocked"):
        counts: ByCause = getattr(summary, name)
        rows += [(f"{name}: {cause}", str(count)) for cause, count in counts.items() if count]
    for name in SHOWN_COUNTS:
        if summary.counts[name]:
            rows.append((name.replace("_", " "), str(summary.counts[name])))
    if summary.recorder is not UNSET:
        rows.append(("recorder", summary.recorder.text))
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"  {name:<{width}}  {value}" for name, value in rows)


def _stops(stops: list[StopSummary]) -> list[tuple[str, str]]:
    """The first `SHOWN_STOPS` stops, and the number of the others."""
    rows = [("stop", _stop(stop)) for stop in stops[:SHOWN_STOPS]]
    more = len(stops) - len(rows)
    return [*rows, ("stops", f"{more} more, see --summary")] if more else rows


def _stop(stop: StopSummary) -> str:
    how = f"{stop.reaction}, latched" if stop.latched else stop.reaction
    return f"{stop.reason} at {stop.at_s:.1f} s, for {stop.duration_s:.1f} s: {how}"


def _limit(limit: LimitSummary) -> str:
    return f"{limit.commands} commands changed, {limit.times} times, {limit.duration_s:.1f} s in all"


def _tracking(tracking: TrackingSummary) -> list[tuple[str, str]]:
    rows = [("lateral error", _error(tracking.lateral_m, "m")), ("heading error", _error(tracking.heading_rad, "rad"))]
    if len(tracking.laps) > 1:
        for number, lap in enumerate(tracking.laps[:SHOWN_LAPS], start=1):
            errors = f"{_error(lap.lateral_m, 'm')}; {_error(lap.heading_rad, 'rad')}"
            rows.append((f"lap {number}: lateral; heading", errors))
    return rows


def _error(error: ErrorSummary, unit: str) -> str:
    return f"RMS {error.rms:.3f}  95 % {error.p95:.3f}  max {error.max:.3f} {unit}"


def _link(link: LinkSummary) -> str:
    changes = f", changed {len(link.transitions)} times" if link.transitions else ""
    if link.load_percent is UNSET or link.frames_per_s is UNSET:
        return f"{link.state}{changes}"
    by_bus = {} if link.loads_percent is UNSET else link.loads_percent
    loads = ", ".join(f"{name} {load} %" for name, load in by_bus.items()) or f"{link.load_percent} %"
    load = f"bus load {loads} (at most {link.highest_load_percent} %)"
    return f"{link.state}{changes}, {load}, {link.frames_per_s:.0f} frames/s"


def _shadow(shadow: ShadowSummary) -> list[tuple[str, str]]:
    mismatches = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in shadow.mismatches.items())
    rows = [("other commander", f"{shadow.compared} commands compared, {shadow.unmatched_commands} unmatched")]
    rows.append(("other commander: unlike ours", mismatches))
    for name, spread, unit in (
        ("accel", shadow.accel_mps2, "m/s²"),
        ("front wheel angle", shadow.front_wheel_angle_rad, "rad"),
    ):
        figures = "  ".join(f"{field} {getattr(spread, field):.4f}" for field in spread.__struct_fields__)
        rows.append((f"difference: {name}", f"{figures} {unit}"))
    return rows


def _quantiles(latency: LatencySummary) -> list[str]:
    return [f"{name} {getattr(latency, f'{name}_s') * 1e3:.2f} ms" for name in ("p50", "p95", "p99", "max")]
