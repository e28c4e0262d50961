"""The loops of this user on this machine: those that run, and those that have ended since the viewer was started."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry.running import RunningLoop, find_running_loops
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.panels.text import enum_name

DEFAULT = "default"
_HEADER = ("ADDRESS", "PID", "PROFILE", "CHANNEL", "STATE", "LAST DATA")
_PERIOD_NS = NS_PER_S
_MAX_ENDED = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownLoop:
    """A loop that runs, or has run."""

    loop: RunningLoop
    """As it was last seen."""
    has_ended: bool = False


class LoopList:
    """The loops by address, looked for once a second."""

    def __init__(self) -> None:
        self.known: dict[str, KnownLoop] = {}
        self._due_ns = 0

    def update(self, now_ns: int) -> None:
        """Look for loops, if that is due."""
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + _PERIOD_NS
        running = {loop.address: KnownLoop(loop=loop) for loop in find_running_loops()}
        ended = {name: KnownLoop(loop=old.loop, has_ended=True) for name, old in self.known.items()}
        kept = [name for name in ended if name not in running][-_MAX_ENDED:]
        self.known = running | {name: ended[name] for name in kept}

    def find_usual(self) -> str | None:
        """Return the address of the loop that runs; the default one, to wait for it, where none does; None where one
        of several must be chosen."""
        running = [name for name, known in self.known.items() if not known.has_ended]
        return running[0] if len(running) == 1 else None if running else DEFAULT


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
