"""Plays a recording back: the interface of a `TelemetryReader`, at the time that is being played.

Only the offsets of the lines are read in advance, so an hour opens as quickly as a minute. Damaged lines and a partial
last line are skipped.
"""

from __future__ import annotations

import copy
import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.recorder import files
from vehicle_iface.telemetry import DrawnTrajectory, SessionInfo, Snapshot, WriterState
from vehicle_iface.telemetry.details import LiveDetails
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.units import NS_PER_S, ns_from_s, s_from_ns
from vehicle_iface_viewer.lines import Lines

SPEEDS = (0.1, 10.0)
"""Slowest and fastest playback, as multiples of real time."""
_BEFORE_EVENT_S = 1.0
"""An event is shown from so long before it."""
_SAME_EVENT_NS = NS_PER_S // 10
_MOST_LINES = 3000
"""After a jump: parsing more would delay the page."""


class Playback:
    """One recording, at the time set by `advance`. `ConfigError` when the folder is not a recording."""

    writer_state = WriterState.LIVE
    problem = ""

    def __init__(self, folder: str, *, speed: float = 1.0, begin_s: float = 0.0) -> None:
        """Start `begin_s` seconds after the first snapshot, at `speed` times real time."""
        self.address = folder
        self._meta = _load_meta(Path(folder))
        self._snapshots = Lines(Path(folder) / files.SNAPSHOTS)
        self._trajectories = Lines(Path(folder) / files.TRAJECTORIES)
        self._counters = Lines(Path(folder) / files.COUNTERS)
        self._events = _load_events(Path(folder) / files.EVENTS)
        self._columns = self._snapshots.text(0).split(",") if len(self._snapshots) else []
        if len(self._snapshots) < 2 or "published_ns" not in self._columns:
            raise ConfigError(f"{folder}: no snapshot in {files.SNAPSHOTS}: there is nothing to show")
        self._time_column = self._columns.index("published_ns")
        self._begin_ns, self._end_ns = self._published_ns(1), self._published_ns(len(self._snapshots) - 1)
        self.session = 1
        """Number that changes with each seek: earlier drawings belong to another time."""
        self.is_paused = False
        self.speed = speed
        self._seek_s: float | None = None
        self._at_ns = self._begin_ns + (ns_from_s(begin_s) if math.isfinite(begin_s) else 0)
        self._advanced_ns: int | None = None

    def fork(self) -> Playback:
        """Return another playback of the same files, at the same place: each browser has its own."""
        other = copy.copy(self)
        other._advanced_ns = None
        return other

    @property
    def info(self) -> SessionInfo:
        """The session as the loop described it."""
        return replace(self._meta.session, recording="")  # it is no longer being recorded

    @property
    def begin_ns(self) -> int:
        """Time of the first snapshot."""
        return self._begin_ns

    @property
    def length_s(self) -> float:
        """Time from the first snapshot to the last."""
        return s_from_ns(self._end_ns - self._begin_ns)

    @property
    def at_s(self) -> float:
        """Displayed time in s after the first snapshot."""
        return s_from_ns(self._at_ns - self._begin_ns)

    @property
    def description(self) -> str:
        """Position, speed and date, so that it is not mistaken for a live drive."""
        wall_ns = self._meta.wall_ns + self._at_ns - self._meta.monotonic_ns
        when = datetime.fromtimestamp(wall_ns / NS_PER_S, UTC)
        mode = "at its end" if self._at_ns >= self._end_ns else "paused" if self.is_paused else f"speed ×{self.speed:g}"
        return f"{self.at_s:.1f} s of {self.length_s:.1f} s · {mode} · recorded on {when:%Y-%m-%d at %H:%M:%S} UTC"

    def seek(self, at_s: float) -> None:
        """Show that time next. May be called from another thread."""
        self._seek_s = at_s

    def step(self, step_s: float) -> None:
        """Show the time `step_s` later next, or earlier: from the place of a seek that has not been shown yet."""
        place_s = self._seek_s
        at_s = self.at_s if place_s is None else place_s
        self.seek(min(max(at_s + step_s, 0.0), self.length_s))

    def advance(self, now_ns: int) -> int:
        """Advance by the time since the last call; return the time of the drive now shown, in ns."""
        elapsed_ns = now_ns - self._advanced_ns if self._advanced_ns is not None else 0
        self._advanced_ns = now_ns
        if self._seek_s is not None:
            self._at_ns, self._seek_s = self._begin_ns + ns_from_s(self._seek_s), None
            self.session += 1
        elif not self.is_paused:
            self._at_ns += round(elapsed_ns * self.speed)
        self._at_ns = min(max(self._at_ns, self._begin_ns), self._end_ns)
        return self._at_ns

    def poll(self) -> WriterState:
        """Do nothing: a recording is always live."""
        return self.writer_state

    def newest(self) -> Snapshot | None:
        """Return the last snapshot before the time that is shown."""
        return self.at(self._at_ns)

    def at(self, at_ns: int) -> Snapshot | None:
        """Return the last snapshot before that time."""
        return files.parse_snapshot(self._columns, self._snapshots.text(self._index(at_ns)))

    def between(self, begin_ns: int, end_ns: int) -> list[Snapshot]:
        """Return the snapshots after `begin_ns` and up to `end_ns`; of more than `_MOST_LINES` some are left out."""
        lines = self._snapshots.texts(self._index(begin_ns) + 1, self._index(end_ns) + 1)
        lines = lines[:: -(-len(lines) // _MOST_LINES) or 1]
        found = (files.parse_snapshot(self._columns, line) for line in lines)
        return [snapshot for snapshot in found if snapshot is not None]

    def trajectory(self, version: int) -> DrawnTrajectory | None:
        """Return the trajectory of that version; None when it was lost."""
        index = bisect_right(range(len(self._trajectories)), version, key=self._version) - 1
        try:
            line = msgspec.json.decode(self._trajectories.text(index), type=files.TrajectoryLine)
        except msgspec.MsgspecError:
            return None
        return line.to_drawn() if line.version == version else None

    @property
    def wall_offset_ns(self) -> int:
        """What to add to a time of the monotonic clock to get that of the wall clock, at the recording."""
        return self._meta.wall_ns - self._meta.monotonic_ns

    def events(self, after: int = 0) -> list[LoopEvent]:
        """Return the events with a number above `after`, up to the time that is shown."""
        first = bisect_right(self._events, after, key=lambda event: event.number)
        return self._events[first : bisect_right(self._events, self._at_ns, key=lambda event: event.at_ns)]

    def all_events(self) -> Sequence[LoopEvent]:
        """Return the events of the whole drive."""
        return self._events

    def sample(self, count: int) -> Iterator[Snapshot]:
        """Yield about `count` snapshots of the whole drive, evenly spaced, the first and the last one."""
        step = max((len(self._snapshots) - 1) // count, 1)
        for index in [*range(1, len(self._snapshots) - 1, step), len(self._snapshots) - 1]:
            snapshot = files.parse_snapshot(self._columns, self._snapshots.text(index))
            if snapshot is not None:
                yield snapshot

    def seek_event(self, step: int, *, stops_only: bool = False) -> None:
        """Show the beginning of the next event (`step` 1), or of the previous one (−1), if there is one."""
        wanted = (event for event in self._events if event.phase is not Phase.ENDED)
        times_ns = sorted(event.at_ns for event in wanted if not stops_only or event.kind is EventKind.STOP)
        ahead_ns = self._at_ns + ns_from_s(_BEFORE_EVENT_S)
        place = (
            bisect_right(times_ns, ahead_ns + _SAME_EVENT_NS)
            if step > 0
            else -1 + bisect_right(times_ns, ahead_ns - _SAME_EVENT_NS)
        )
        if 0 <= place < len(times_ns):
            self.seek(s_from_ns(times_ns[place] - self._begin_ns) - _BEFORE_EVENT_S)

    def details(self) -> LiveDetails | None:
        """Return the last counters before the time that is shown."""
        index = bisect_right(range(len(self._counters)), self._at_ns, key=self._counted_ns) - 1
        return files.parse_counters(self._counters.text(index))

    def close(self) -> None:
        """Close the files."""
        for lines in (self._snapshots, self._trajectories, self._counters):
            lines.close()

    def _index(self, at_ns: int) -> int:
        """Return the index of the last snapshot before that time."""
        return bisect_right(range(len(self._snapshots)), at_ns, lo=1, key=self._published_ns) - 1

    def _published_ns(self, index: int) -> int:
        cells = self._snapshots.text(index).split(",", self._time_column + 1)
        return _parse_int(cells[self._time_column]) if len(cells) > self._time_column else 0

    def _version(self, index: int) -> int:
        return _parse_key(self._trajectories.text(index), _OnlyVersion)

    def _counted_ns(self, index: int) -> int:
        return _parse_key(self._counters.text(index), _OnlyTime)


class _OnlyVersion(msgspec.Struct):
    version: int

    @property
    def key(self) -> int:
        return self.version


class _OnlyTime(msgspec.Struct):
    at_ns: int

    @property
    def key(self) -> int:
        return self.at_ns


def _load_events(path: Path) -> list[LoopEvent]:
    lines = Lines(path)
    found = [files.parse_event(line) for line in lines.texts(0, len(lines))]
    lines.close()
    return sorted((event for event in found if event is not None), key=lambda event: event.number)


def _load_meta(folder: Path) -> files.Meta:
    path = folder / files.META
    try:
        meta = msgspec.json.decode(path.read_bytes(), type=files.Meta)
    except OSError as error:
        raise ConfigError(f"{folder}: not a recording: {files.META}: {error.strerror}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise ConfigError(f"{path}: damaged: {error}") from None
    if meta.format != files.FORMAT:
        raise ConfigError(f"{path}: of format {meta.format}; this version shows format {files.FORMAT}")
    return meta


def _parse_int(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        return 0


def _parse_key(text: str, kind: type[_OnlyVersion | _OnlyTime]) -> int:
    try:
        return msgspec.json.decode(text, type=kind).key
    except msgspec.MsgspecError:
        return 0
