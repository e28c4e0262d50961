"""The table of numbers: vehicle state on the left, references and counters on the right."""

from __future__ import annotations

import math

from vehicle_iface.status import Gear, VehicleMode
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.text import MAX_SHOWN, enum_name, plain


def numbers_html(view: View) -> str:
    """Return the table of numbers; empty without a snapshot."""
    s = view.snapshot
    if s is None:
        return ""
    no = "–"
    left = (
        ("x", _figure(s.x_m, ".2f", "m") if s.has_state else no),
        ("y", _figure(s.y_m, ".2f", "m") if s.has_state else no),
        ("heading", _figure(math.degrees(s.heading_rad), ".1f", "°") if s.has_state else no),
        ("speed", _figure(s.speed_mps, ".2f", "m/s") if s.has_state else no),
        ("mode", enum_name(VehicleMode, s.vehicle_mode) if s.has_status else no),
        ("gear", enum_name(Gear, s.gear) if s.has_status and s.gear != Gear.NO_REQUEST else no),
        ("frame", plain(s.frame_id)),
    )
    total = f" / {view.trajectory.original_count - 1}" if view.trajectory and len(view.trajectory.x_m) else ""
    right = (
        ("spatial ref", f"{s.spatial_index}{total}" if s.has_reference else no),
        ("temporal ref", f"{s.temporal_index}{total}" if s.has_reference else no),
        ("lateral error", _figure(s.lateral_error_m, ".3f", "m") if s.has_reference else no),
        ("heading error", _figure(math.degrees(s.heading_error_rad), ".2f", "°") if s.has_reference else no),
        ("commands", f"{s.commands}"),
        ("frames dropped", f"{s.drops}"),
        ("deadlines missed", f"{s.deadline_misses}"),
    )
    limited = "" if view.details is None else _limited(view.details.limited)
    rows = "".join(f"<tr>{_cell(a, 'left')}{_cell(b, 'right')}</tr>" for a, b in zip(left, right, strict=True))
    return (
        '<table id="numbers" style="width:calc(100% - 22px);margin:2px 14px 2px 8px;border-collapse:collapse;'
        f'font-size:13px;font-variant-numeric:tabular-nums">{rows}</table>{limited}'
    )


def _limited(counts: dict[str, int]) -> str:
    """Return how often the loop limited each field of the commands; empty if never."""
    fields = ", ".join(f"{plain(name)} {count}" for name, count in counts.items() if count)
    style = "margin:2px 14px 2px 8px;font-size:12px;border-left:3px solid #f06595;padding-left:7px"
    return f'<div id="limited" style="{style}">commands limited: {fields}</div>' if fields else ""


def _cell(pair: tuple[str, str], side: str) -> str:
    name, value = pair
    gap = "padding-left:18px" if side == "right" else ""
    key = name.replace(" ", "-")
    return (
        f'<td style="opacity:.65;padding:1px 0;{gap}">{name}</td>'
        f'<td id="n-{key}" style="text-align:right;font-weight:600">{value}</td>'
    )


def _figure(value: float, form: str, unit: str) -> str:
    # "z": no minus sign before a zero
    return f"{value:z{form}} {unit}" if abs(value) < MAX_SHOWN else "out of range"
