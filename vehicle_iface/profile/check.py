"""Every fault of a profile's document as text, each with its place: `$.limits.speed_max_mps: Expected float`."""

import itertools
import math
import typing
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

import msgspec

from vehicle_iface.profile.check_buses import check_bus_names, check_bus_tables
from vehicle_iface.profile.check_command import check_command
from vehicle_iface.profile.check_pose import check_pose
from vehicle_iface.profile.check_sends import check_sends
from vehicle_iface.profile.command_forms import needed_command_signals
from vehicle_iface.profile.forms import SIGNAL_NAME, FieldForm, check_form, signals_of
from vehicle_iface.profile.mismatch import describe_mismatch
from vehicle_iface.profile.notes import is_whole_number
from vehicle_iface.profile.placeholders import add_placeholders, fields_of
from vehicle_iface.profile.schema import Profile
from vehicle_iface.profile.signals import Command, State
from vehicle_iface.profile.state_pose import needed_pose_signals

NOTHING_MORE: Mapping[str, str] = MappingProxyType({})
_NEEDED_KEYS: Mapping[tuple[type, str], Callable[[Mapping[str, object]], Mapping[str, str]]] = {
    (State, "signals"): needed_pose_signals,
    (Command, "signals"): needed_command_signals,
    (Profile, "command"): lambda _: {"signals": "; a vehicle that is only watched has no [command]"},
}
"""Keys that a table needs in addition to its type's, by the type around it and its key there."""


def check_document(document: dict[str, object]) -> Iterator[str]:
    """Check what the types cannot express: numbers are finite, `file` is no key, a path has no NUL."""
    for place, number in _numbers(document, "$"):
        if not math.isfinite(number):
            yield f"{place}: {number}: must be finite"
    if "file" in document:
        yield "$.file: unknown key"
    buses = document.get("buses")
    tables = {f"$.buses.{name}": bus for name, bus in buses.items()} if isinstance(buses, dict) else {}
    for place, table in ({"$": document} | tables).items():
        dbc = table.get("dbc") if isinstance(table, dict) else None
        if isinstance(dbc, str) and (not dbc or "\0" in dbc):
            yield f"{place}.dbc: {dbc!r}: must be a file's name"
    yield from check_bus_tables(document)


def check_tables(
    document: object, kind: type[msgspec.Struct], place: str = "$", needed: Mapping[str, str] = NOTHING_MORE
) -> tuple[dict[str, object], list[str]]:
    """Return the part of a table that its type allows, and the faults of the rest.

    `needed` are keys that it must have although its type does not say so, each with the end of its error.
    """
    if not isinstance(document, dict):
        return {}, [f"{place}: Expected a table, got {type(document).__name__}"]
    fields = {field.encode_name: field for field in fields_of(kind)}
    missing = [name for name, field in fields.items() if (field.required or name in needed) and name not in document]
    sound: dict[str, object] = {}
    faults: list[str] = []
    for key, value in document.items():
        there = f"{place}.{key}"
        if key not in fields:
            nearest = _nearest(key, list(fields))
            hint = f"did you mean {nearest!r}?" if nearest else f"must be one of: {', '.join(fields)}"
            faults.append(f"{there}: unknown key; {hint}")
            missing = [name for name in missing if name != nearest]  # one mistake is one fault
        else:
            find_needed = _NEEDED_KEYS.get((kind, key))
            more = find_needed(document) if find_needed is not None else NOTHING_MORE
            faults += _check_value(sound, key, value, fields[key].type, there, more)
    faults += (f"{place}: {name} is missing{needed.get(name, '')}" for name in missing)
    add_placeholders(sound, kind, document)
    return sound, faults


def _check_value(
    sound: dict[str, object],
    key: str,
    value: object,
    kind: object,
    place: str,
    needed: Mapping[str, str] = NOTHING_MORE,
) -> list[str]:
    """Put the part of a value that its type allows into `sound`; give the faults of the rest."""
    named = _type_of_values(kind)
    table = _table_type(named or kind)
    if named is not None and isinstance(value, dict):
        tables: dict[str, object] = {}
        sound[key] = tables
        return [
            fault for name, one in value.items() for fault in _check_value(tables, name, one, named, f"{place}.{name}")
        ]
    if table is not None and typing.get_origin(kind) is tuple and isinstance(value, list):
        rows: list[dict[str, object]] = []
        sound[key] = rows
        found: list[str] = []
        for index, row in enumerate(value):
            part, faults = check_tables(row, table, f"{place}[{index}]")
            rows.append(part)
            found += faults
        return found
    if table is not None and named is None and (isinstance(value, dict) or str not in typing.get_args(kind)):
        sound[key], faults = check_tables(value, table, place, needed)
        return faults
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        return [describe_mismatch(str(error), value, kind, place)]
    if all(math.isfinite(number) for _, number in _numbers(value, "")):
        sound[key] = value
    return []


def check_profile(profile: Profile) -> Iterator[str]:
    """Check names of signals, and numbers that depend on one another."""
    yield from _check_names(profile)
    yield from check_bus_names(profile)
    yield from _check_status(profile)
    yield from _check_notes(profile)
    yield from check_pose(profile)
    yield from check_command(profile)
    yield from check_sends(profile)
    yield from _check_timing(profile)
    yield from _check_geometry(profile)
    yield from _check_limits(profile)
    yield from _check_behavior(profile)


def _numbers(value: object, place: str) -> Iterator[tuple[str, float]]:
    """List every float in a TOML document with its place."""
    if isinstance(value, float):
        yield place, value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _numbers(inner, f"{place}.{key}")
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _numbers(inner, f"{place}[{index}]")


def _type_of_values(kind: object) -> object:
    """Return the value type of a table with arbitrary keys; None where the field is none and may not be one."""
    tables = (one for one in (kind, *typing.get_args(kind)) if typing.get_origin(one) is dict)
    return next((typing.get_args(table)[1] for table in tables), None)


def _nearest(key: str, known: list[str]) -> str | None:
    """Return the most similar known key."""
    import difflib  # only where there is a fault: it takes a while

    return next(iter(difflib.get_close_matches(key, known, n=1)), None)


def _table_type(kind: object) -> type[msgspec.Struct] | None:
    """Return the table that a field is, or may be."""
    kinds = (kind, *typing.get_args(kind))
    return next((one for one in kinds if isinstance(one, type) and issubclass(one, msgspec.Struct)), None)


def _check_names(profile: Profile) -> Iterator[str]:
    """Check that signals are written MESSAGE.SIGNAL."""
    named: dict[str, object] = {"$.ignored": profile.ignored or None, "$.constants": tuple(profile.constants) or None}
    named["$.signals"] = tuple(profile.signals) or None
    for section in ("state", "status", "command", "body", "report"):
        table = getattr(profile, section)
        for field in table.signals.__struct_fields__ if table is not None else ():
            named[f"$.{section}.signals.{field}"] = getattr(table.signals, field)
    named["$.state.pose.valid"] = profile.state.pose.valid
    for kind in ("when", "driver"):
        table = getattr(profile.status, kind)
        for field in table.__struct_fields__ if table is not None else ():
            named[f"$.status.{kind}.{field}"] = getattr(table, field)
    for place, names in named.items():
        if names == ():
            yield f"{place}: must name at least one signal"
        yield from (f"{place}: {name} is listed twice" for name in _repeated(names))
        yield from check_form(names, place)
        for name in signals_of(names):
            if not SIGNAL_NAME.fullmatch(name):
                yield f"{place}: {name!r}: must be MESSAGE.SIGNAL"


def _repeated(names: object) -> list[str]:
    """Return the signals that a list, a mean or a sum names more than once."""
    parts = (names.mean or names.sum) if isinstance(names, FieldForm) else names if isinstance(names, tuple) else ()
    return [name for name, count in Counter(parts or ()).items() if count > 1]


def _check_status(profile: Profile) -> Iterator[str]:
    status = profile.status
    if status.when is None and status.signals.mode is None:
        yield "$.status.signals: mode is missing; bind it, or say in $.status.when who drives"
    elif status.when is not None and status.signals.mode is not None:
        yield "$.status.when: $.status.signals.mode says who drives already; remove one of them"
    elif status.when is not None and status.when.autonomous is None:
        yield "$.status.when: autonomous is missing: the vehicle would never be driven"


def _check_notes(profile: Profile) -> Iterator[str]:
    for dotted, notes in profile.signals.items():
        place = f"$.signals.{dotted}"
        if notes.scale == 0.0:
            yield f"{place}.scale: 0: must be another number"
        if notes.range is not None and not notes.range[0] < notes.range[1]:
            yield f"{place}.range: {list(notes.range)}: the first number must be below the second"
        for number in notes.names or ():
            if not is_whole_number(number):
                yield f"{place}.names: {number!r}: must be a whole number"


def _check_timing(profile: Profile) -> Iterator[str]:
    timing = profile.timing
    for smaller, greater in (
        ("sample_period_s", "state_stale_s"),
        ("state_stale_s", "state_silent_s"),
        ("status_period_s", "status_stale_s"),
    ):
        low, high = getattr(timing, smaller), getattr(timing, greater)
        if not low < high:
            yield f"$.timing.{greater}: {high}: must be above {smaller} = {low}"
    warning_s = profile.handover.warning_s
    if not warning_s < timing.shutdown_s:
        yield f"$.handover.warning_s: {warning_s}: must be below $.timing.shutdown_s = {timing.shutdown_s}"


def _check_geometry(profile: Profile) -> Iterator[str]:
    geometry = profile.geometry
    shortest_m = geometry.wheelbase_m + geometry.rear_overhang_m
    if geometry.length_m < shortest_m:
        text = f"{geometry.length_m}: must be at least wheelbase_m + rear_overhang_m = {shortest_m}"
        yield f"$.geometry.length_m: {text}"


def _check_limits(profile: Profile) -> Iterator[str]:
    warn_m, stop_m = profile.deviation.lateral_warn_m, profile.deviation.lateral_stop_m
    if not warn_m < stop_m:
        yield f"$.deviation.lateral_stop_m: {stop_m}: must be above lateral_warn_m = {warn_m}"
    for key in ("front_wheel_angle_by_speed", "accel_max_by_speed"):
        speeds = [speed_mps for speed_mps, _ in getattr(profile.limits, key)]
        for row, (slower, faster) in enumerate(itertools.pairwise(speeds), start=1):
            if not slower < faster:
                yield f"$.limits.{key}[{row}][0]: {faster}: must be above the row before it, {slower}"


def _check_behavior(profile: Profile) -> Iterator[str]:
    behavior = profile.behavior
    safe_mps2, most_mps2 = behavior.safe_deceleration_mps2, -profile.limits.accel_min_mps2
    if safe_mps2 > most_mps2:
        text = f"{safe_mps2}: must be at most {most_mps2}, what $.limits.accel_min_mps2 allows"
        yield f"$.behavior.safe_deceleration_mps2: {text}"
    least_mps3 = safe_mps2 / behavior.stop_release_time_constant_s
    if behavior.stop_jerk_mps3 < least_mps3 * (1.0 - 1e-9):
        text = f"must be at least safe_deceleration_mps2 / stop_release_time_constant_s = {least_mps3}"
        yield f"$.behavior.stop_jerk_mps3: {behavior.stop_jerk_mps3}: {text}"
