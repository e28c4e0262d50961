"""The viewer's loop: thirty times a second it looks at the telemetry and brings the page up to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import viser

from vehicle_iface import clock
from vehicle_iface.runtime.telemetry import TelemetryReader
from vehicle_iface.units import NS_PER_S
from viewer.access import Access, allow_switch, open_server
from viewer.feed import Feed, View
from viewer.panels import Panels
from viewer.recording import Recording
from viewer.scene import ROOT, Scene
from viewer.transport import Transport

_PERIOD_NS = NS_PER_S // 30
_PANELS_EVERY = 3
_PANEL_WIDTH_PX = 430


class App:
    """A server with its page, fed from one telemetry address, or from a recording."""

    def __init__(self, access: Access, source: str | Recording) -> None:
        self._recording = source if isinstance(source, Recording) else None
        self._reader = source if isinstance(source, Recording) else TelemetryReader(source)
        self._feed = Feed(self._reader)
        self.server = open_server(access)
        self.server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self.server.gui.set_panel_label("vehicle-iface" if self._recording is None else "vehicle-iface: RECORDING")
        self.server.gui.main_panel.dock_right()
        self.server.gui.main_panel.set_width(_PANEL_WIDTH_PX)
        self._scene = Scene(self.server, is_recording=self._recording is not None)
        self._panels = Panels(self.server.gui)
        self._transport = Transport(self.server.gui, self._recording) if self._recording is not None else None
        self._followers: dict[int, _Follower] = {}

    @property
    def port(self) -> int:
        """The port that the page is at."""
        return self.server.get_port()

    def run(self, is_wanted: Callable[[], bool]) -> None:
        """Keep the page up to date while `is_wanted` says so."""
        tick = 0
        due_ns = clock.monotonic_ns()
        while is_wanted():
            self.update(tick)
            tick += 1
            # Late is late: a viewer that tried to catch up would only be slower.
            due_ns = max(due_ns + _PERIOD_NS, clock.monotonic_ns())
            clock.sleep_until(due_ns)

    def update(self, tick: int) -> None:
        """One step: the picture each time, words and curves every third."""
        now_ns = clock.monotonic_ns()
        view = self._view(now_ns)
        with self.server.atomic():
            if self._transport is not None:
                self._transport.update(now_ns)
            place = self._scene.draw(view)
            if tick % _PANELS_EVERY == 0:
                self._panels.show(view, tick // _PANELS_EVERY)
        followers = self._present_followers()
        if place is not None:
            for follower in followers:
                follower.move(place)
        # Both at once: the vehicle's place and the world's shift belong into the same picture.
        self.server.flush()

    def close(self) -> None:
        """Stop serving."""
        self._reader.close()
        self.server.stop()

    def _view(self, now_ns: int) -> View:
        if self._recording is None:
            return self._feed.view(now_ns)
        view = self._feed.view(self._recording.turn_to(now_ns, is_watched=bool(self._followers)))
        return replace(view, recording=self._recording.words)

    def _present_followers(self) -> list[_Follower]:
        """One for each browser that is there. Asked, not told: viser's callbacks for coming and going may overtake
        each other, and a browser that stayed in the list would stay for ever."""
        clients = self.server.get_clients()
        self._followers = {
            number: self._followers.get(number) or self._welcomed(client) for number, client in clients.items()
        }
        return list(self._followers.values())

    def _welcomed(self, client: viser.ClientHandle) -> _Follower:
        if self._transport is not None:
            self._transport.hear(client)
        return _Follower(client)


class _Follower:
    """One browser's own choice to keep the vehicle in the middle of its picture."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._is_following = True
        self._frame = client.scene.add_frame(ROOT, show_axes=False)
        box = client.gui.add_checkbox("Follow", initial_value=True, order=Panels.FOLLOW_ORDER)
        allow_switch(client, box._impl.uuid, self._switch)

    def _switch(self, is_following: bool) -> None:
        self._is_following = is_following

    def move(self, place: tuple[float, float]) -> None:
        """Shift this browser's world so that `place` stays in the middle."""
        if self._is_following:
            self._frame.position = (-place[0], -place[1], 0.0)
            self._client.flush()
