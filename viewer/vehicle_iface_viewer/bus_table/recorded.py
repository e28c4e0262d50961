"""The table of messages at the time that a recording shows, and the signals that are plotted, from its frames."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile
from vehicle_iface.recorder import files
from vehicle_iface.units import NS_PER_S, ns_from_s
from vehicle_iface_viewer.bus_table.bus_signals import BusSignals
from vehicle_iface_viewer.bus_table.finder import MessageFinder
from vehicle_iface_viewer.bus_table.frame_log import FrameLog
from vehicle_iface_viewer.bus_table.monitor import WINDOW_NS, BusMonitor
from vehicle_iface_viewer.bus_table.report import BusReport, SignalKey
from vehicle_iface_viewer.bus_table.sampler import SignalSampler
from vehicle_iface_viewer.bus_table.source import parse_channels
from vehicle_iface_viewer.feed import RECORDED_S, View

_PERIOD_NS = NS_PER_S // 2
_MOST_LINES = 5000
"""Read at once; where a playback is faster than that, the frames before them are left out."""
_MOST_SEARCHED_LINES = 10_000
"""Searched at once for signals that are plotted; the rest follows in the next reads."""


class RecordedBusTable:
    """Counts begin at the last jump, with the frames of the two seconds before it."""

    def __init__(self, folder: str, wall_offset_ns: int, profile: str | None) -> None:
        """Read the recording's own copy of the profile, or `profile`.

        `wall_offset_ns` is added to times of the monotonic clock to get those of the frames.
        """
        self._log = FrameLog(Path(folder), wall_offset_ns)
        self._finder: MessageFinder | None = None
        self._session = self._next = 0
        self._now_ns = 0
        self._report: BusReport | None = None
        self.signals = BusSignals()
        """Those of one browser."""
        if not len(self._log):
            self._report = BusReport(note="No frames were recorded.")
            return
        try:
            self._finder = MessageFinder(_load(Path(folder), profile))
        except ConfigError as error:
            self._report = BusReport(problem=str(error))

    def read(self, view: View) -> BusReport | None:
        """Return the table at the time of `view`."""
        if self._finder is not None:
            channels = {} if view.info is None else parse_channels(view.info.channel)
            buses = {channel: number for number, channel in enumerate(channels.values())}
            self._read_frames(view, self._finder, buses)
            self._samples.read(view, buses)
        self.signals.update(self._report)
        return self._report

    def fork(self) -> RecordedBusTable:
        """Return another table of the same frames, for a browser that shows another time."""
        other = copy.copy(self)
        other._session = 0  # begins with a monitor of its own
        other.signals = BusSignals()
        return other

    def close(self) -> None:
        """Close the file."""
        self._log.close()

    def _read_frames(self, view: View, finder: MessageFinder, buses: Mapping[str, int]) -> None:
        if view.session != self._session or view.now_ns < self._now_ns:
            self._session = view.session
            self._monitor = BusMonitor(finder)
            self._samples = _PlottedSignals(self._log, finder, self.signals)
            self._next = self._log.count_until(view.now_ns - WINDOW_NS)
        elif view.now_ns < self._now_ns + _PERIOD_NS:
            return
        self._now_ns = view.now_ns
        end = self._log.count_until(view.now_ns)
        if end - self._next > _MOST_LINES:
            self._next = end - _MOST_LINES
            self._monitor.forget_sequences()
        self._monitor.add(self._log.frames(self._next, end, buses))
        self._next = end
        self._report = self._monitor.report(view.now_ns)


class _PlottedSignals:
    """The samples of the signals that one browser plots: those of the last two minutes, then those that follow."""

    def __init__(self, log: FrameLog, finder: MessageFinder, signals: BusSignals) -> None:
        self._log, self._signals = log, signals
        self._sampler = SignalSampler(finder)
        self._keys: list[SignalKey] = []
        self._next = 0
        signals.clear_samples()

    def read(self, view: View, buses: Mapping[str, int]) -> None:
        keys = self._signals.advance()
        if keys != self._keys:
            self._keys = keys
            self._sampler.choose(keys)
            self._signals.clear_samples()
            self._next = self._log.count_until(view.now_ns - ns_from_s(RECORDED_S))
        if keys:
            end = min(self._log.count_until(view.now_ns), self._next + _MOST_SEARCHED_LINES)
            self._sampler.add(self._log.frames(self._next, end, buses, self._sampler.identifiers))
            self._signals.extend(keys, self._sampler.take())
            self._next = end


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
