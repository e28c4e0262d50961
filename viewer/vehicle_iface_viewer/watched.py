"""One drive at one time, read once for all browsers that show it: a running loop, or a recording for one browser."""

from __future__ import annotations

from dataclasses import replace

from vehicle_iface.telemetry import SessionInfo
from vehicle_iface_viewer.bus_table.bus_signals import BusSignals
from vehicle_iface_viewer.bus_table.report import BusReport
from vehicle_iface_viewer.bus_table.source import BusTableSource, has_frames
from vehicle_iface_viewer.feed import LIVE_S, RECORDED_S, Feed, LiveTelemetry, View
from vehicle_iface_viewer.journey import Journey
from vehicle_iface_viewer.panels.map_drawing import MapDrawing
from vehicle_iface_viewer.playback import Playback

PANELS_EVERY, MAP_EVERY = 3, 6
"""Updates of which one is for texts, for tables or for plots, and of which one is for the map."""
_NO_TABLE = BusReport(problem="nothing is received")


class Watched:
    """What is known of the drive: the newest data, those of the last minutes, its way, its map, the messages."""

    def __init__(
        self,
        reader: LiveTelemetry | Playback,
        bus_table: BusTableSource | None = None,
        whole: Journey | None = None,
    ) -> None:
        """`whole` is the way of the whole drive, if it is known in advance."""
        self.is_live = isinstance(reader, LiveTelemetry)
        self.feed = Feed(reader, LIVE_S if self.is_live else RECORDED_S)
        self.journey = whole or Journey()
        self.map = MapDrawing()
        self.view: View | None = None
        """None before the first `update`."""
        self.report: BusReport | None = _NO_TABLE
        self._reader = reader
        self._bus_table = bus_table
        self.bus_signals = bus_table.signals if bus_table is not None else BusSignals()
        self._is_whole = whole is not None
        self._session = 0

    @property
    def address(self) -> str:
        """Where its telemetry is."""
        return self._reader.address

    @property
    def info(self) -> SessionInfo | None:
        """Constant data of its session; None before there was one."""
        return self._reader.info

    @property
    def has_frames(self) -> bool:
        """Whether the drive's buses have frames that can be listed."""
        return has_frames(self.info)

    def update(self, now_ns: int, tick: int) -> View:
        """Read what is new, table and map in turns, so that no update is long; return what is shown."""
        view = self.view = self._read(now_ns)
        if not self._is_whole:
            self._follow(view)
        if tick % PANELS_EVERY == 1 and self._bus_table is not None:
            self.report = self._bus_table.read(view)
        if tick % MAP_EVERY == MAP_EVERY - 2:
            if not self._is_whole:
                self.journey.mark(self.feed.events, self.feed.recent)
            self.map.update(view, self.journey)
        return view

    def close(self) -> None:
        """Release all resources."""
        self._reader.close()
        if self._bus_table is not None:
            self._bus_table.close()

    def _read(self, now_ns: int) -> View:
        if isinstance(self._reader, LiveTelemetry):
            return self.feed.read(now_ns)
        view = self.feed.read(self._reader.advance(now_ns))
        return replace(view, recording=self._reader.description)

    def _follow(self, view: View) -> None:
        if view.session != self._session:
            self._session = view.session
            self.journey.clear()
        if view.snapshot is not None:
            self.journey.add(view.snapshot)
