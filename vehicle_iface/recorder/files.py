"""Files of a recording and the format of their lines; the recorder writes them, the viewer reads them.

| file | content |
|---|---|
| `meta.json` | what was recorded: command line, versions, start on both clocks, profile with its hashes |
| `frames.log` | every frame on the bus, in the format of `candump -L`, with the kernel's (wall-clock) timestamps |
| `inputs.log` | all inputs of the loop, exactly, for `vehicle-iface rerun` (`recorder.inputs`) |
| `snapshots.csv` | every snapshot of the telemetry, one a line; a gap in `sequence` means lost snapshots |
| `trajectories.jsonl` | every trajectory as it was drawn, to a micrometre, one a line |
| `events.jsonl` | every event (`telemetry.events.LoopEvent`), one a line |
| `counters.jsonl` | all counters, twice a second, one object a line |
| `recorder.json` | status of the recorder: what was written and lost so far; updated each second |
| `summary.json` | the loop's summary of the run |
| `events/` | the black boxes: the seconds around each stop, each a recording by itself |
| `profile/` | the profile and its DBC, copied |
| `inputs/` | the files of trajectory and controller, copied |

A file of lines is intact up to its last line end, whichever process was killed.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import numpy as np

from vehicle_iface.errors import ConfigError
from vehicle_iface.telemetry import DrawnTrajectory, SessionInfo, Snapshot
from vehicle_iface.telemetry.details import LiveDetails
from vehicle_iface.telemetry.events import LoopEvent

STATUS_BYTES = 4096
"""Fixed size of `recorder.json`: each status overwrites the one before, which works on a full disk, too."""
STATUS_PERIOD_S = 1.0
META, STATUS, SUMMARY, PROFILE = "meta.json", "recorder.json", "summary.json", "profile"
FRAMES, SNAPSHOTS = "frames.log", "snapshots.csv"
INPUTS, INPUT_FILES, BLACK_BOXES = "inputs.log", "inputs", "events"
TRAJECTORIES, COUNTERS, EVENTS = "trajectories.jsonl", "counters.jsonl", "events.jsonl"
FORMAT = 1

_DECIMALS = 6
_TYPES = [str(getattr(kind, "__forward_arg__", kind)) for kind in Snapshot.__annotations__.values()]
_FORMATS = {"int": "%d", "bool": "%d", "float": "%r", "str": "%s"}
_ROW = ",".join(_FORMATS[kind] for kind in _TYPES) + "\n"
_FRAME_ID = Snapshot._fields.index("frame_id")
_PARSERS: dict[str, Callable[[str], object]] = {"int": int, "bool": "1".__eq__, "float": float, "str": str}
_PARSER_OF = {name: _PARSERS[kind] for name, kind in zip(Snapshot._fields, _TYPES, strict=True)}
_RENAMED = {
    "has_wanted": "has_requested",
    "wanted_accel_mps2": "requested_accel_mps2",
    "wanted_front_wheel_angle_rad": "requested_front_wheel_angle_rad",
    "hands_over": "handover_pending",
    "handover_ns": "handover_in_ns",
}
"""Columns of `snapshots.csv` as version 0.1 named them."""
_RENAMED_COUNTERS = {"not_let_out": "tx_blocked", "without_a_sample": "unmatched_commands", "apart": "mismatches"}
"""Fields of `counters.jsonl` as version 0.1 named them."""
_OLD_COUNTER = re.compile(f'"({"|".join(_RENAMED_COUNTERS)})":')

SNAPSHOT_HEADER = (",".join(Snapshot._fields) + "\n").encode()


class RunOptions(msgspec.Struct, kw_only=True, frozen=True):
    """The options of `run` that decide what is sent."""

    armed: bool
    profile: str
    """The profile's file, in `profile/`."""
    controller: str
    """As given; a FILE.py is in `inputs/`."""
    frame_id: str
    """The frame of reference of a route."""
    speed_cap_mps: float | None = None
    route: str | None = None
    trajectory: str | None = None
    """A file in `inputs/`; without it and without a route, trajectories came from outside and are recorded."""
    channels: list[str] = []
    """What `frames.log` calls each bus, in their order."""


class Meta(msgspec.Struct, kw_only=True, frozen=True):
    """Content of `meta.json`: what was recorded."""

    format: int
    session: SessionInfo
    wall_ns: int
    """When the recording began, nanoseconds since 1970: the clock of `frames.log`."""
    monotonic_ns: int
    """The same time on the monotonic clock, which everything else uses."""
    frames: str
    """Source of the frames, or why there are none."""
    command_line: list[str]
    versions: dict[str, str]
    sha256: dict[str, str]
    """Hashes of the copies in `profile/`, by file name."""
    run: RunOptions | None = None
    """For `rerun`; None in a recording of version 0.1."""


class CountersLine(msgspec.Struct, frozen=True):
    """A line of `counters.jsonl`."""

    at_ns: int
    counters: LiveDetails


class RecorderStatus(msgspec.Struct, kw_only=True, frozen=True):
    """Content of `recorder.json`: how many lines of each kind were written and lost."""

    at_ns: int
    """Time of this status, on the monotonic clock."""
    is_over: bool = False
    written: dict[str, int]
    lost: dict[str, int]
    trouble: str = ""
    """Why nothing is written at present; empty when all is well."""

    @property
    def text(self) -> str:
        """Describe what was written and lost, in one line."""
        return f"{_format_counts(self.written) or 'nothing'} written, {self.loss or 'nothing lost'}"

    @property
    def loss(self) -> str:
        """Describe what is lost; empty when nothing is."""
        lost = _format_counts(self.lost)
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

    def to_drawn(self) -> DrawnTrajectory:
        """Return the trajectory as telemetry publishes it."""
        columns = {name: np.array(getattr(self, name)) for name in _COLUMNS}
        return DrawnTrajectory(
            version=self.version,
            stamp_ns=self.stamp_ns,
            frame_id=self.frame_id,
            original_count=self.original_count,
            **columns,
        )


_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps", "time_s")


def load_meta(folder: Path) -> Meta:
    """Load `meta.json` of a recording; `ConfigError` when it is none, damaged or of another format."""
    path = folder / META
    try:
        meta = msgspec.json.decode(path.read_bytes(), type=Meta)
    except OSError as error:
        raise ConfigError(f"{folder}: not a recording: {META}: {error.strerror}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise ConfigError(f"{path}: damaged: {error}") from None
    if meta.format != FORMAT:
        raise ConfigError(f"{path}: of format {meta.format}; this version reads format {FORMAT}")
    return meta


def format_snapshot(snapshot: Snapshot) -> bytes:
    """Format a row of `snapshots.csv`; floats in full precision."""
    values: list[object] = [*snapshot]
    values[_FRAME_ID] = _quote_csv(snapshot.frame_id)
    return (_ROW % tuple(values)).encode()


def parse_snapshot(columns: Sequence[str], line: str) -> Snapshot | None:
    """Return the snapshot of a row of any version; None when the row is damaged."""
    try:
        (cells,) = csv.reader([line])
        named = zip((_RENAMED.get(column, column) for column in columns), cells, strict=True)
        values = {name: _PARSER_OF[name](cell) for name, cell in named if name in _PARSER_OF}
        return Snapshot(**values)  # type: ignore[arg-type]  # by name, of the kind that the name has
    except (ValueError, TypeError, csv.Error):
        return None


def format_trajectory(path: DrawnTrajectory) -> bytes:
    """Format a line of `trajectories.jsonl`."""
    columns = {name: np.round(getattr(path, name), _DECIMALS).tolist() for name in _COLUMNS}
    line = TrajectoryLine(
        version=path.version,
        stamp_ns=path.stamp_ns,
        frame_id=path.frame_id,
        original_count=path.original_count,
        **columns,
    )
    return msgspec.json.encode(line) + b"\n"


def format_counters(at_ns: int, counters: LiveDetails) -> bytes:
    """Format a line of `counters.jsonl`."""
    return msgspec.json.encode(CountersLine(at_ns, counters)) + b"\n"


def parse_counters(line: str) -> LiveDetails | None:
    """Return the counters of a line of any version; None when the line is damaged."""
    try:
        renamed = _OLD_COUNTER.sub(lambda found: f'"{_RENAMED_COUNTERS[found[1]]}":', line)
        return msgspec.json.decode(renamed, type=CountersLine).counters
    except msgspec.MsgspecError:
        return None


def format_event(event: LoopEvent) -> bytes:
    """Format a line of `events.jsonl`."""
    return msgspec.json.encode(event) + b"\n"


def parse_event(line: str) -> LoopEvent | None:
    """Return the event of a line; None when the line is damaged."""
    try:
        return msgspec.json.decode(line, type=LoopEvent)
    except msgspec.MsgspecError:
        return None


def _format_counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count:,} {name}" for name, count in counts.items() if count)


def _quote_csv(text: str) -> str:
    """Return text as one CSV cell: in one line, and quoted where it has a comma or a quote."""
    line = "".join(c if c.isprintable() else "�" for c in text)
    return '"' + line.replace('"', '""') + '"' if set(line) & set(',"') else line
