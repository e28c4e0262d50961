"""The table of messages at the time that a recording shows, from its frames."""

from __future__ import annotations

import copy
import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from pathlib import Path

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.recorder import files
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.bus_table.monitor import WINDOW_NS, BusMonitor
from vehicle_iface_viewer.bus_table.report import BusReport
from vehicle_iface_viewer.bus_table.source import parse_channels
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.lines import Lines

_PERIOD_NS = NS_PER_S // 2
_MOST_LINES = 5000
"""Read at once; where a playback is faster than that, the frames before them are left out."""
_STAMP = re.compile(r"\((\d{1,10})\.(\d{6})\)")
_FRAME = re.compile(
    r"\((\d{1,10})\.(\d{6})\) (\S+) ([0-9A-F]{3}|[0-9A-F]{8})#(#[0-9A-F])?((?:[0-9A-F]{2}){0,64})", re.ASCII
)
_ERROR, _LAST_ID, _LAST_STANDARD_ID = 0x20000000, 0x1FFFFFFF, 0x7FF


class RecordedBusTable:
    """Counts begin at the last jump, with the frames of the two seconds before it."""

    def __init__(self, folder: str, wall_offset_ns: int, profile: str | None) -> None:
        """Read the recording's own copy of the profile, or `profile`.

        `wall_offset_ns` is added to times of the monotonic clock to get those of the frames.
        """
        self._offset_ns = wall_offset_ns
        self._lines = Lines(Path(folder) / files.FRAMES)
        self._database: VehicleDatabase | None = None
        self._session = self._next = 0
        self._now_ns = 0
        self._report: BusReport | None = None
        if not len(self._lines):
            self._report = BusReport(note="No frames were recorded.")
            return
        try:
            self._database = _load(Path(folder), profile)
        except ConfigError as error:
            self._report = BusReport(problem=str(error))

    def read(self, view: View) -> BusReport | None:
        """Return the table at the time of `view`."""
        if self._database is None:
            return self._report
        if view.session != self._session or view.now_ns < self._now_ns:
            self._session = view.session
            self._monitor = BusMonitor(self._database)
            self._next = self._index(view.now_ns - WINDOW_NS)
        elif view.now_ns < self._now_ns + _PERIOD_NS:
            return self._report
        self._now_ns = view.now_ns
        end = self._index(view.now_ns)
        if end - self._next > _MOST_LINES:
            self._next = end - _MOST_LINES
            self._monitor.forget_sequences()
        channels = {} if view.info is None else parse_channels(view.info.channel)
        numbers = {channel: number for number, channel in enumerate(channels.values())}
        self._monitor.add(_frames(self._lines.texts(self._next, end), numbers, self._offset_ns))
        self._next = end
        self._report = self._monitor.report(view.now_ns)
        return self._report

    def fork(self) -> RecordedBusTable:
        """Return another table of the same frames, for a browser that shows another time."""
        other = copy.copy(self)
        other._session = 0  # begins with a monitor of its own
        return other

    def close(self) -> None:
        """Close the file."""
        self._lines.close()

    def _index(self, at_ns: int) -> int:
        """Return the number of frames up to that time."""
        return bisect_right(range(len(self._lines)), at_ns + self._offset_ns, key=self._stamp_ns)

    def _stamp_ns(self, index: int) -> int:
        found = _STAMP.match(self._lines.text(index))
        return int(found[1]) * NS_PER_S + int(found[2]) * 1000 if found is not None else 0


def _load(folder: Path, profile: str | None) -> VehicleDatabase:
    if profile is not None:
        return load_database(load_profile(profile))
    copies = sorted((folder / files.PROFILE).glob("*.toml"))
    if len(copies) != 1:
        raise ConfigError(f"{folder / files.PROFILE}: no profile; give it with --profile FILE")
    found = load_profile(copies[0])
    if found.checksum_files:
        names = ", ".join(file.name for file in found.checksum_files)
        raise ConfigError(f"{copies[0]} would run Python code of the recording ({names}): give --profile FILE instead")
    return load_database(found)


def _frames(lines: Iterable[str], numbers: dict[str, int], offset_ns: int) -> Iterator[CanFrame]:
    """Yield the frames of these lines; remote frames, damaged lines and other channels are left out."""
    for line in lines:
        found = _FRAME.fullmatch(line)
        if found is None or found[3] not in numbers:
            continue
        can_id, is_extended, is_fd = int(found[4], 16), len(found[4]) == 8, found[5] is not None
        data, is_error = bytes.fromhex(found[6]), is_extended and bool(can_id & _ERROR)
        if (can_id & ~_ERROR) > (_LAST_ID if is_extended else _LAST_STANDARD_ID) or (len(data) > 8 and not is_fd):
            continue
        yield CanFrame(
            can_id & _LAST_ID,
            data,
            int(found[1]) * NS_PER_S + int(found[2]) * 1000 - offset_ns,
            is_extended=is_extended,
            is_fd=is_fd,
            is_error=is_error,
            bus=numbers[found[3]],
        )
