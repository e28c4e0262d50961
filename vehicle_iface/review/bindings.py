"""The notes of a profile on the signals of its fields, and the lines that would correct them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vehicle_iface.codec.binding import Binding
from vehicle_iface.codec.quantities import find_unit, unit_of_field
from vehicle_iface.review.explanations import Cause, GivenUnit, Kind
from vehicle_iface.review.findings import BindingVerdict, Judgement
from vehicle_iface.review.kinematics import COMMANDED
from vehicle_iface.review.series import NOT_MEASURED, POSITION, RecordedDrive, Series


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldNotes:
    """Notes of a profile on a field: field = scale · (value in SI) + offset."""

    series: Series
    unit: str
    scale: float
    offset: float
    given: GivenUnit | None
    """None where the signal is of another quantity than the field."""


def read_notes(drive: RecordedDrive) -> dict[str, FieldNotes]:
    """Return the notes by the names that relations use: fields of the state and of commands."""
    named = {**drive.state, **{COMMANDED + name: series for name, series in drive.commands.items()}}
    return {name: _notes_of(drive.binding, name, series) for name, series in named.items()}


def find_missing(drive: RecordedDrive) -> list[BindingVerdict]:
    """Return the bound fields of the state without a value in the whole log."""
    state = drive.binding.sections["state"]
    fields = {POSITION if field in ("x_m", "latitude_deg") else field: signals for field, signals in state.items()}
    unmeasured = (*NOT_MEASURED, "y_m", "longitude_deg", "valid", "negative_if", *drive.state)
    return [
        BindingVerdict(
            field=field,
            signal=" and ".join(signals),
            judgement=Judgement.UNKNOWN,
            text="no value in this log",
            relations=(),
        )
        for field, signals in fields.items()
        if field not in unmeasured
    ]


def units_of(notes: Mapping[str, FieldNotes]) -> dict[str, GivenUnit]:
    """Return the stated unit of each field that has one."""
    return {name: one.given for name, one in notes.items() if one.given is not None}


def _notes_of(binding: Binding, name: str, series: Series) -> FieldNotes:
    dotted = series.signals[0]
    signal, notes = binding.find_signal(dotted), binding.notes_of(dotted)
    spelling = (notes.unit if notes.unit is not None else signal.unit if signal is not None else "") or ""
    field = "x_m" if name == POSITION else name
    unit, wanted = find_unit(spelling), unit_of_field(field)
    is_geographic = name == POSITION and binding.profile.state.pose.source == "geographic"
    given = None
    if wanted is not None and unit is not None and unit.quantity == wanted.unit.quantity and not is_geographic:
        given = GivenUnit(quantity=unit.quantity, factor=unit.factor, is_scaled=notes.scale not in (None, 1.0, -1.0))
    scale = notes.scale if notes.scale is not None else 1.0
    return FieldNotes(series=series, unit=spelling, scale=scale, offset=notes.offset, given=given)


def write_fix(notes: FieldNotes, causes: Sequence[Cause], offset_rad: float = 0.0) -> str:
    """Write the notes on a field's signals that correct the causes; true field = field / gain + `offset_rad`."""
    gain = math.prod(cause.gain for cause in causes)
    rest = math.prod(cause.gain for cause in causes if cause.kind is not Kind.UNIT)
    unit = next((cause.unit for cause in causes if cause.kind is Kind.UNIT), "")
    scale, offset = notes.scale / rest, notes.offset / gain + offset_rad
    lines = [f'unit = "{unit}"'] if unit else []
    lines += [f"scale = {scale:.4g}"] if not math.isclose(scale, 1.0, rel_tol=1e-3) or notes.scale != 1.0 else []
    lines += [f"offset = {offset:.4f}"] if abs(offset) > 1e-4 or notes.offset else []
    return "\n".join(f'[signals."{dotted}"]\n' + "\n".join(lines) for dotted in notes.series.signals)
