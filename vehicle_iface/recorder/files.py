"""What a recording consists of, and the form of its lines: the recorder writes them, the viewer reads them.

| file | content |
|---|---|
| `meta.json` | what was recorded: command line, versions, start on both clocks, profile with its hashes |
| `frames.log` | every frame on the bus, as `candump -L` writes it, with the kernel's (wall-clock) stamps |
| `snapshots.csv` | every snapshot of the telemetry, one a line; a number that `sequence` leaves out was lost |
| `trajectories.jsonl` | every trajectory as it was drawn, to a micrometre, one a line |
| `counters.jsonl` | all counters, twice a second, one object a line |
| `recorder.json` | what was written and lost so far, each second anew |
| `summary.json` | the loop's own account, at its end |
| `profile/` | the profile and its DBC, copied |

A file of lines is whole up to its last line end, whoever was killed when.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np

from vehicle_iface.runtime.telemetry import DrawnTrajectory, SessionInfo, Snapshot

REPORT_BYTES = 4096
"""`recorder.json` is always as long: each report is written over the one before, for which a full disk has room."""
REPORT_S = 1.0
META, REPORT, SUMMARY, PROFILE = "meta.json", "recorder.json", "summary.json", "profile"
FRAMES, SNAPSHOTS = "frames.log", "snapshots.csv"
TRAJECTORIES, COUNTERS = "trajectories.jsonl", "counters.jsonl"
FORMAT = 1

_DECIMALS = 6
_KINDS = [str(getattr(kind, "__forward_arg__", kind)) for kind in Snapshot.__annotations__.values()]
_FORMS = {"int": "%d", "bool": "%d", "float": "%r", "str": "%s"}
_ROW = ",".join(_FORMS[kind] for kind in _KINDS) + "\n"
_FRAME_ID = Snapshot._fields.index("frame_id")
_READERS: dict[str, Callable[[str], object]] = {"int": int, "bool": "1".__eq__, "float": float, "str": str}
_READ = {name: _READERS[kind] for name, kind in zip(Snapshot._fields, _KINDS, strict=True)}

SNAPSHOT_HEADER = (",".join(Snapshot._fields) + "\n").encode()


class Meta(msgspec.Struct, kw_only=True, frozen=True):
    """`meta.json`."""

    format: int
    session: SessionInfo
    wall_ns: int
    """When the recording began, nanoseconds since 1970: the clock of `frames.log`."""
    monotonic_ns: int
    """The same instant on the clock of everything else."""
    frames: str
    """Where the frames come from, or why there are none."""
    command_line: list[str]
    versions: dict[str, str]
    sha256: dict[str, str]
    """Of the copies in `profile/`, by file name."""


class Counters(msgspec.Struct, frozen=True):
    """A line of `counters.jsonl`."""

    at_ns: int
    counters: dict[str, Any]


class Report(msgspec.Struct, kw_only=True, frozen=True):
    """`recorder.json`: how many lines of each kind were written, and how many of what there was are lost."""

    at_ns: int
    """When that was so, on the monotonic clock."""
    is_over: bool = False
    written: dict[str, int]
    lost: dict[str, int]
    trouble: str = ""
    """Why nothing is written at present, in words."""

    @property
    def in_words(self) -> str:
        """For people, in one line."""
        return f"{_listed(self.written) or 'nothing'} written, {self.loss or 'nothing lost'}"

    @property
    def loss(self) -> str:
        """What is lost, in words; empty where nothing is."""
        lost = _listed(self.lost)
        return f"{lost} LOST" if lost else ""


class TrajectoryLine(msgspec.Struct, kw_only=True, frozen=True):
    """A line of `trajectories.jsonl`: a `DrawnTrajectory`."""

    version: int
    stamp_ns: int
    frame_id: str
    original_count: int
    x_m: list[float]
    y_m: list[float]
    heading_rad: list[float]
    speed_mps: list[float]
    time_s: list[float]

    def drawn(self) -> DrawnTrajectory:
        """As the viewer takes it."""
        columns = {name: np.array(getattr(self, name)) for name in _COLUMNS}
        return DrawnTrajectory(
            version=self.version,
            stamp_ns=self.stamp_ns,
            frame_id=self.frame_id,
            original_count=self.original_count,
            **columns,
        )


_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps", "time_s")


def snapshot_line(snapshot: Snapshot) -> bytes:
    """A row of `snapshots.csv`; floats in full."""
    values: list[object] = [*snapshot]
    values[_FRAME_ID] = _csv_text(snapshot.frame_id)
    return (_ROW % tuple(values)).encode()


def snapshot_of(columns: Sequence[str], line: str) -> Snapshot | None:
    """A row as a snapshot again, whatever version wrote it; None when it is none."""
    try:
        (cells,) = csv.reader([line])
        values = {name: _READ[name](cell) for name, cell in zip(columns, cells, strict=True) if name in _READ}
        return Snapshot(**values)  # type: ignore[arg-type]  # by name, of the kind that the name has
    except (ValueError, TypeError, csv.Error):
        return None


def trajectory_line(path: DrawnTrajectory) -> bytes:
    """A line of `trajectories.jsonl`."""
    columns = {name: np.round(getattr(path, name), _DECIMALS).tolist() for name in _COLUMNS}
    line = TrajectoryLine(
        version=path.version,
        stamp_ns=path.stamp_ns,
        frame_id=path.frame_id,
        original_count=path.original_count,
        **columns,
    )
    return msgspec.json.encode(line) + b"\n"


def counters_line(at_ns: int, counters: dict[str, Any]) -> bytes:
    """A line of `counters.jsonl`."""
    return msgspec.json.encode(Counters(at_ns, counters)) + b"\n"


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{count:,} {name}" for name, count in counts.items() if count)


def _csv_text(text: str) -> str:
    """In one line, and quoted where a comma or a quote would end the cell."""
    line = "".join(c if c.isprintable() else "�" for c in text)
    return '"' + line.replace('"', '""') + '"' if set(line) & set(',"') else line
