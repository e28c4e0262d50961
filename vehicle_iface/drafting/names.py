"""The tables that translate a vehicle's names: modes, gears and frames of reference."""

import re
from collections.abc import Container, Iterator, Mapping

from vehicle_iface.drafting.draft import Draft
from vehicle_iface.drafting.field_lines import align, quote
from vehicle_iface.drafting.rules import (
    AUTONOMOUS_NAMES,
    EMERGENCY_NAMES,
    FAULT_NAMES,
    GEAR_NAMES,
    MANUAL_NAMES,
    MAP_FRAMES,
    ODOMETRY_FRAMES,
    READY_NAMES,
    Section,
)
from vehicle_iface.drafting.scoring import fold_names
from vehicle_iface.status import Gear, VehicleMode

_FRAMES: Mapping[str, frozenset[str]] = {"map": MAP_FRAMES, "odom": ODOMETRY_FRAMES}
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_MODES: Mapping[str, frozenset[str]] = {
    "MANUAL": MANUAL_NAMES,
    "READY": READY_NAMES,
    "AUTONOMOUS": AUTONOMOUS_NAMES,
    "FAULT": FAULT_NAMES,
    "EMERGENCY_STOP": EMERGENCY_NAMES,
}


def write_modes(draft: Draft) -> Iterator[str]:
    """Write `[status.modes]` for the names of the mode's table."""
    yield from _write_table(
        draft, [("status", "mode")], "status.modes", _MODES, VehicleMode.__members__, "READY AUTONOMOUS"
    )


def write_gears(draft: Draft) -> Iterator[str]:
    """Write `[status.gears]` for the names of the gear and its request."""
    fields: list[tuple[Section, str]] = [("status", "gear"), ("command", "gear_request")]
    yield from _write_table(draft, fields, "status.gears", GEAR_NAMES, Gear.__members__, "REVERSE DRIVE")


def write_frames(draft: Draft) -> Iterator[str]:
    """Write `[state.frames]`; an unusual name is left to the person."""
    names = _fold_tables(draft, [("state", "pose_frame")])
    if names:
        yield align("[state.frames]", "name in the DBC = frame of reference")
        for name, folded in names.items():
            known = next((frame for frame, spellings in _FRAMES.items() if folded in spellings), "")
            line = f'{_key(name)} = "{known or "…"}"'
            yield line if known else align(f"# {line}", "TODO which frame of reference is this?")
        yield ""


def _fold_tables(draft: Draft, fields: list[tuple[Section, str]]) -> dict[str, str]:
    """Return the names of these fields' tables, in the order of their numbers, and as the rules write them."""
    bound = [draft.fields[key] for key in fields if draft.fields[key].value is not None]
    tables = [one.signal.names for field in bound for one in field.chosen]
    return {name: text for table in tables for name, text in fold_names(dict(sorted(table.items())).values()).items()}


def _write_table(
    draft: Draft,
    fields: list[tuple[Section, str]],
    table: str,
    groups: Mapping[str, frozenset[str]],
    known: Container[str],
    needed: str,
) -> Iterator[str]:
    """Write names that differ from the program's; names or meanings without a counterpart are comments."""
    bound = [draft.fields[key] for key in fields if draft.fields[key].value is not None]
    names = _fold_tables(draft, fields)
    if not bound:
        return
    if not names:
        yield f'# [signals."{bound[0].chosen[0].signal.dotted}"]'
        yield align('# names = { 0 = "…" }', f"TODO the DBC has no names; needed are {needed.replace(' ', ' and ')}")
        yield ""
        return
    meanings = {name: name if name in known else _translate(folded, groups) for name, folded in names.items()}
    lines = [f'{_key(name)} = "{ours}"' for name, ours in meanings.items() if ours and name != ours]
    unknown = [name for name, ours in meanings.items() if not ours]
    missing = [name for name in needed.split() if name not in meanings.values()]
    if lines or unknown or missing:
        yield align(f"[{table}]", "name in the DBC = name in the program; TODO check each")
        yield from lines
        yield from (align(f'# {_key(name)} = "…"', "TODO what does this name mean?") for name in unknown)
        yield from (align(f"# missing: {name}", "TODO needed: which of the names means this?") for name in missing)
        yield ""


def _translate(folded: str, groups: Mapping[str, frozenset[str]]) -> str:
    """Return the program's name; empty where it is unknown."""
    return next((ours for ours, spellings in groups.items() if folded in spellings), "")


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else quote(name)
