"""What a page shows: running loops, or a recording."""

from __future__ import annotations

from typing import Protocol

import viser

from vehicle_iface_viewer.browser import ReplayBrowser
from vehicle_iface_viewer.bus_table.source import BusTableSource
from vehicle_iface_viewer.journey import Journey
from vehicle_iface_viewer.playback import Playback
from vehicle_iface_viewer.watched import Watched


class Visitor(Protocol):
    """One browser."""

    def update(self, now_ns: int, tick: int) -> None:
        """Update its page."""


class Host(Protocol):
    """Where the pages of all browsers come from."""

    def update(self, now_ns: int, tick: int) -> None:
        """Read what all browsers show."""

    def admit(self, client: viser.ClientHandle) -> Visitor:
        """Make the page of a new browser."""

    def dismiss(self, gone: Visitor) -> None:
        """Forget a browser."""

    def close(self) -> None:
        """Release all resources."""


class Replays:
    """A recording, which each browser plays at a place of its own."""

    def __init__(self, playback: Playback, bus_table: BusTableSource | None) -> None:
        self.playback = playback
        self._bus_table = bus_table
        self._whole = Journey.of(playback)

    def update(self, now_ns: int, tick: int) -> None:
        """Nothing is common to all browsers."""

    def admit(self, client: viser.ClientHandle) -> ReplayBrowser:
        """Make the page of a new browser."""
        playback = self.playback.fork()
        table = self._bus_table.fork() if self._bus_table is not None else None
        return ReplayBrowser(client, Watched(playback, table, self._whole), playback)

    def dismiss(self, gone: Visitor) -> None:
        """Let the next browser begin where this one has left: a page that is loaded again continues."""
        if isinstance(gone, ReplayBrowser):
            self.playback = gone.playback

    def close(self) -> None:
        """Close the files."""
        self.playback.close()
        if self._bus_table is not None:
            self._bus_table.close()
