"""The lines of a recording, as values with their times."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.recorder import files
from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.events import LoopEvent
from vehicle_iface.units import ns_from_s, s_from_ns

Line = TypeVar("Line")


class RecordedDrive:
    """A recording, or the part of it between two times. Damaged lines are left out and counted."""

    def __init__(self, folder: Path, *, begin_s: float = 0.0, end_s: float | None = None) -> None:
        """`begin_s` and `end_s` are seconds after the first snapshot. `ConfigError` when it is no recording."""
        self.folder = folder
        self.meta = files.load_meta(folder)
        self.damaged = 0
        """Number of lines that could not be read, so far."""
        first = next(self._all_snapshots(), None)
        if first is None:
            raise ConfigError(f"{folder}: no snapshot in {files.SNAPSHOTS}: there is nothing to export")
        self.damaged = 0
        self.first_ns = first.published_ns
        self._begin_ns = self.first_ns + ns_from_s(begin_s)
        self._end_ns = None if end_s is None else self.first_ns + ns_from_s(end_s)
        self.is_whole = begin_s == 0.0 and end_s is None
        """Whether nothing of the recording is left out."""

    def time_s(self, at_ns: int) -> float:
        """Seconds since the first snapshot."""
        return s_from_ns(at_ns - self.first_ns)

    def wall_ns(self, at_ns: int) -> int:
        """The time of the wall clock, in nanoseconds since 1970."""
        return at_ns - self.meta.monotonic_ns + self.meta.wall_ns

    def snapshots(self) -> Iterator[Snapshot]:
        """All snapshots."""
        return (one for one in self._all_snapshots() if self._is_within(one.published_ns))

    def events(self) -> Iterator[LoopEvent]:
        """All events."""
        return (one for one in self._lines(files.EVENTS, files.parse_event) if self._is_within(one.at_ns))

    def counters(self) -> Iterator[files.CountersLine]:
        """The counters, twice a second."""
        return (one for one in self._lines(files.COUNTERS, _parse_counters) if self._is_within(one.at_ns))

    def trajectories(self) -> Iterator[files.TrajectoryLine]:
        """The trajectories as they were drawn; those of earlier snapshots, too: one of them is in force at first."""
        lines = self._lines(files.TRAJECTORIES, _parse_trajectory)
        return (one for one in lines if self._end_ns is None or one.stamp_ns <= self._end_ns)

    def _is_within(self, at_ns: int) -> bool:
        return at_ns >= self._begin_ns and (self._end_ns is None or at_ns <= self._end_ns)

    def _all_snapshots(self) -> Iterator[Snapshot]:
        columns: list[str] = []

        def parse(line: str) -> Snapshot | None:
            return files.parse_snapshot(columns, line)

        path = self.folder / files.SNAPSHOTS
        try:
            with path.open(encoding="utf-8", errors="replace") as file:
                columns = file.readline().strip().split(",")
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
        yield from self._lines(files.SNAPSHOTS, parse, header_lines=1)

    def _lines(self, name: str, parse: Callable[[str], Line | None], *, header_lines: int = 0) -> Iterator[Line]:
        """The complete lines of a file; a missing file has none."""
        path = self.folder / name
        try:
            with path.open(encoding="utf-8", errors="replace", newline="\n") as file:
                for number, line in enumerate(file):
                    if number < header_lines:
                        continue
                    found = parse(line[:-1]) if line.endswith("\n") else None
                    if found is None:
                        self.damaged += 1
                    else:
                        yield found
        except FileNotFoundError:
            return
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def _parse_counters(line: str) -> files.CountersLine | None:
    counters = files.parse_counters(line)
    try:
        at_ns = msgspec.json.decode(line, type=_At).at_ns
    except msgspec.MsgspecError:
        return None
    return None if counters is None else files.CountersLine(at_ns, counters)


def _parse_trajectory(line: str) -> files.TrajectoryLine | None:
    try:
        return msgspec.json.decode(line, type=files.TrajectoryLine)
    except msgspec.MsgspecError:
        return None


class _At(msgspec.Struct):
    at_ns: int
