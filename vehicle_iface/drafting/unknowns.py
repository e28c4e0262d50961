"""The tables of numbers that no DBC contains, with all of their keys, to be filled in."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from vehicle_iface.drafting.field_lines import align
from vehicle_iface.profile import load_profile

_HEADER = re.compile(r"\[([\w.]+)\]")
_KEY = re.compile(r"(\w+) = ")
_TASKS = {
    "geometry": "measure; the reference point is the rear axle's centre",
    "limits": "decide; begin well below what the vehicle can do",
    "limits.while_engaging": "decide; additional limits until the vehicle reports AUTONOMOUS",
    "timing": "decide",
    "behavior": "decide how the vehicle is stopped",
    "deviation": "decide how far the vehicle may be from its trajectory and speed limit",
    "plausibility": "decide what the vehicle can do; implausible samples are dropped",
}
"""Tables that each profile must have, with the user's task."""


def write_unknown_tables(known: Mapping[str, Mapping[str, str]], hints: Mapping[str, list[str]]) -> Iterator[str]:
    """Write the lines of these tables. `known` are lines of keys that have a value, `hints` comments below the headers.

    The examples are the reference car's numbers. As comments they leave the profile incomplete, so `check-dbc` lists
    the keys and nothing can be driven by them.
    """
    yield "# What no DBC contains. The numbers below are examples: replace each, then remove `# TODO`."
    yield ""
    for table, lines in _reference_tables().items():
        if table not in _TASKS:
            continue
        yield align(f"[{table}]", f"TODO {_TASKS[table]}")
        yield from (f"# {hint}" for hint in hints.get(table, ()))
        for line in lines:
            key = _KEY.match(line)
            stated = known.get(table, {}).get(key[1]) if key else None
            yield stated if stated is not None else f"# TODO {line}"
        yield ""


def _reference_tables() -> dict[str, list[str]]:
    """Return the lines of each table of the reference vehicle's profile, its comments included."""
    tables: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in Path(load_profile("reference").file).read_text(encoding="utf-8").splitlines():
        if header := _HEADER.match(line):
            lines = tables.setdefault(header[1], [])
        elif _KEY.match(line):
            lines.append(line)
    return tables
