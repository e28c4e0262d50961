"""The signals that one can choose for the free plot: every number of a snapshot, with its unit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from vehicle_iface.telemetry.columns import NUMBERS, Columns, Reader, known, of_flag, of_state
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_MS

_UNITS = {
    "_mps2": ("m/s²", 1.0),
    "_mps": ("m/s", 1.0),
    "_radps": ("°/s", math.degrees(1.0)),
    "_rad": ("°", math.degrees(1.0)),
    "_m": ("m", 1.0),
    "_ns": ("ms", 1.0 / NS_PER_MS),
}
"""By the end of a field's name: unit, and factor."""
_FLAGS = {
    "spatial_": "has_reference",
    "temporal_": "has_reference",
    "reference_": "has_reference",
    "lateral_error": "has_reference",
    "heading_error": "has_reference",
    "lookahead_": "has_lookahead",
    "requested_": "has_requested",
    "sent_": "sent",
    "latency_": "sent",
    "vehicle_mode": "has_status",
    "gear": "has_status",
    "handover_in": "handover_pending",
}
"""By the beginning of a field's name: the flag of its group."""
_ALWAYS_KNOWN = ("controller_state", "reason", "trajectory_version", "samples", "commands", "drops", "deadline_misses")
_NO_SIGNALS = ("published_ns", "stamp_ns", "sequence")


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeSignal:
    """One signal that can be drawn."""

    name: str
    """With the unit, if there is one."""
    unit: str
    read: Reader


def _signals() -> Iterator[FreeSignal]:
    yield FreeSignal(name="state age, ms", unit="ms", read=_read_state_age)
    for field in NUMBERS:
        if field in _NO_SIGNALS or field == "sent" or field.startswith("has_") or field.endswith("_pending"):
            continue
        ending = next((each for each in _UNITS if field.endswith(each)), "")
        unit, factor = _UNITS.get(ending, ("", 1.0))
        name = field.removesuffix(ending).replace("_", " ")
        yield FreeSignal(name=f"{name}, {unit}" if unit else name, unit=unit, read=_reader(field, factor))


def _reader(field: str, factor: float) -> Reader:
    if field in _ALWAYS_KNOWN:
        return lambda rows: known(rows[field] * factor, rows["published_ns"] > 0)
    flag = next((flag for beginning, flag in _FLAGS.items() if field.startswith(beginning)), "has_state")
    of_old_too = flag in ("sent", "has_requested", "has_status", "handover_pending")
    return of_flag(field, flag, factor) if of_old_too else of_state(field, factor, flag)


def _read_state_age(rows: Columns) -> FloatArray:
    return known((rows["published_ns"] - rows["stamp_ns"]) / NS_PER_MS, rows["has_state"])


FREE_SIGNALS = {signal.name: signal for signal in _signals()}
