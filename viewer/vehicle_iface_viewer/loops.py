"""Which loop the page shows when none was named: the one that is running."""

from __future__ import annotations

from collections.abc import Sequence

from vehicle_iface.errors import ConfigError
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry.running import RunningLoop, find_running_loops
from vehicle_iface_viewer.panels.text import enum_name

DEFAULT = "default"
_HEADER = ("ADDRESS", "PID", "PROFILE", "CHANNEL", "STATE", "LAST DATA")


def choose_loop() -> str:
    """Return the address of the loop that is running; the default one when there is none, to wait for it.

    Raises `ConfigError` with the list when there are several.
    """
    loops = find_running_loops()
    if len(loops) > 1:
        raise ConfigError(f"{len(loops)} loops are running; choose one with --connect ADDRESS\n{list_loops(loops)}")
    return loops[0].address if loops else DEFAULT


def list_loops(loops: Sequence[RunningLoop]) -> str:
    """Return a table of loops."""
    rows = [_HEADER, *map(_row, loops)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows)
    return "\n".join(f"  {line}" for line in lines)


def _row(loop: RunningLoop) -> tuple[str, ...]:
    info, newest = loop.info, loop.newest
    state = enum_name(ControllerState, newest.controller_state) if newest is not None else "-"
    age = f"{loop.age_s:.1f} s ago" if newest is not None else "none yet"
    return (loop.address, str(info.pid), *map(_printable, (info.profile, info.channel)), state, age)


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text[:40])
