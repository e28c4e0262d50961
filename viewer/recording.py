"""A recording in the place of a running loop: the same answers as a `TelemetryReader`, about another time.

Nothing is read before it is wanted but where each line begins, so an hour opens as quickly as a minute. What is
damaged is passed over; a last line that was cut off is not there.
"""

from __future__ import annotations

import math
import os
from bisect import bisect_right
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vehicle_iface.errors import ConfigError
from vehicle_iface.recorder import files
from vehicle_iface.runtime.telemetry import DrawnTrajectory, SessionInfo, Snapshot, WriterState
from vehicle_iface.units import NS_PER_S, ns_from_s, s_from_ns

SPEEDS = (0.1, 10.0)
"""Of the replay, as multiples of the drive's own: the slowest and the fastest."""
_CHUNK_BYTES = 1 << 20


class Recording:
    """One recording, at the instant that `turn_to` has chosen. `ConfigError` where there is none to show."""

    link = WriterState.LIVE
    problem = ""

    def __init__(self, folder: str, *, speed: float = 1.0, begin_s: float = 0.0) -> None:
        """`begin_s` seconds after the first snapshot, at `speed` times the drive's own."""
        self.address = folder
        self._meta = _meta(Path(folder))
        self._snapshots = _Lines(Path(folder) / files.SNAPSHOTS)
        self._trajectories = _Lines(Path(folder) / files.TRAJECTORIES)
        self._counters = _Lines(Path(folder) / files.COUNTERS)
        self._columns = self._snapshots.text(0).split(",") if len(self._snapshots) else []
        if len(self._snapshots) < 2 or "published_ns" not in self._columns:
            raise ConfigError(f"{folder}: no snapshot in {files.SNAPSHOTS}: there is nothing to show")
        self._time_column = self._columns.index("published_ns")
        self._begin_ns, self._end_ns = self._published_ns(1), self._published_ns(len(self._snapshots) - 1)
        self.session = 1
        """Changes with each jump: what was drawn before it belongs to another time."""
        self.is_paused = False
        self.speed = speed
        self._wanted_s: float | None = None
        self._at_ns = self._begin_ns + (ns_from_s(begin_s) if math.isfinite(begin_s) else 0)
        self._turned_ns: int | None = None

    @property
    def info(self) -> SessionInfo:
        """What the loop said about itself."""
        return replace(self._meta.session, recording="")  # nobody writes it any more

    @property
    def length_s(self) -> float:
        """From the first snapshot to the last."""
        return s_from_ns(self._end_ns - self._begin_ns)

    @property
    def at_s(self) -> float:
        """The instant that is shown, after the first snapshot."""
        return s_from_ns(self._at_ns - self._begin_ns)

    @property
    def words(self) -> str:
        """What is shown, for whoever might take it for the present."""
        wall_ns = self._meta.wall_ns + self._at_ns - self._meta.monotonic_ns
        when = datetime.fromtimestamp(wall_ns / NS_PER_S, UTC)
        how = "at its end" if self._at_ns >= self._end_ns else "paused" if self.is_paused else f"speed ×{self.speed:g}"
        return f"{self.at_s:.1f} s of {self.length_s:.1f} s · {how} · driven on {when:%Y-%m-%d at %H:%M:%S} UTC"

    def go_to(self, at_s: float) -> None:
        """Show that instant next. May be called from another thread."""
        self._wanted_s = at_s

    def turn_to(self, now_ns: int, *, is_watched: bool = True) -> int:
        """Go on by the time since the last call, if anybody watches; the instant of the drive that is shown now."""
        elapsed_ns = now_ns - self._turned_ns if self._turned_ns is not None else 0
        self._turned_ns = now_ns
        if self._wanted_s is not None:
            self._at_ns, self._wanted_s = self._begin_ns + ns_from_s(self._wanted_s), None
            self.session += 1
        elif is_watched and not self.is_paused:
            self._at_ns += round(elapsed_ns * self.speed)
        self._at_ns = min(max(self._at_ns, self._begin_ns), self._end_ns)
        return self._at_ns

    def poll(self) -> WriterState:
        """It is always there."""
        return self.link

    def newest(self) -> Snapshot | None:
        """The last snapshot before the instant that is shown."""
        place = bisect_right(range(len(self._snapshots)), self._at_ns, lo=1, key=self._published_ns) - 1
        return files.snapshot_of(self._columns, self._snapshots.text(place))

    def trajectory(self, version: int) -> DrawnTrajectory | None:
        """The trajectory of that version; None when it was lost."""
        place = bisect_right(range(len(self._trajectories)), version, key=self._version) - 1
        try:
            line = msgspec.json.decode(self._trajectories.text(place), type=files.TrajectoryLine)
        except msgspec.MsgspecError:
            return None
        return line.drawn() if line.version == version else None

    def details(self) -> dict[str, Any]:
        """The last counters before the instant that is shown."""
        place = bisect_right(range(len(self._counters)), self._at_ns, key=self._counted_ns) - 1
        try:
            return msgspec.json.decode(self._counters.text(place), type=files.Counters).counters
        except msgspec.MsgspecError:
            return {}

    def close(self) -> None:
        """Let go of the files."""
        for lines in (self._snapshots, self._trajectories, self._counters):
            lines.close()

    def _published_ns(self, place: int) -> int:
        cells = self._snapshots.text(place).split(",", self._time_column + 1)
        return _integer(cells[self._time_column]) if len(cells) > self._time_column else 0

    def _version(self, place: int) -> int:
        return _key(self._trajectories.text(place), _OnlyVersion)

    def _counted_ns(self, place: int) -> int:
        return _key(self._counters.text(place), _OnlyTime)


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


class _Lines:
    """The whole lines of a file, by their place; a file that is not there has none."""

    def __init__(self, path: Path) -> None:
        ends = [np.zeros(1, np.int64)]
        self._file = -1
        try:
            # Read, not mapped: a map of a file that is still being written and cut kills the process that touches it.
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
            at = 0
            while chunk := os.pread(self._file, _CHUNK_BYTES, at):
                ends.append(np.flatnonzero(np.frombuffer(chunk, np.uint8) == ord("\n")) + at + 1)
                at += len(chunk)
        except FileNotFoundError:
            pass
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
        self._begins = np.concatenate(ends)

    def __len__(self) -> int:
        return len(self._begins) - 1

    def text(self, place: int) -> str:
        """That line without its end; nothing where there is none."""
        if not 0 <= place < len(self):
            return ""
        begin, end = int(self._begins[place]), int(self._begins[place + 1])
        try:
            return os.pread(self._file, end - begin - 1, begin).decode(errors="replace")
        except OSError:
            return ""

    def close(self) -> None:
        if self._file >= 0:
            os.close(self._file)
        self._file = -1


def _meta(folder: Path) -> files.Meta:
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


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        return 0


def _key(text: str, kind: type[_OnlyVersion | _OnlyTime]) -> int:
    try:
        return msgspec.json.decode(text, type=kind).key
    except msgspec.MsgspecError:
        return 0
