"""The viewer's loop: updates the page from the telemetry thirty times a second."""

from __future__ import annotations

from collections.abc import Callable

from vehicle_iface import clock
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.bus_table.source import BusTableSource
from vehicle_iface_viewer.cameras import look_first
from vehicle_iface_viewer.host import Host, Replays, Visitor
from vehicle_iface_viewer.live import LiveLoops
from vehicle_iface_viewer.playback import Playback
from vehicle_iface_viewer.scene.scene import set_stage
from vehicle_iface_viewer.serving import open_server
from vehicle_iface_viewer.settings import configure_theme

_PERIOD_NS = NS_PER_S // 30
_PANEL_WIDTH_PX = 430


class App:
    """A server with its page, fed from running loops, or from a recording."""

    def __init__(self, access: Access, source: str | Playback | None, bus_table: BusTableSource | None = None) -> None:
        """`source`: the address of a loop; None: those of this machine, of which a browser chooses.

        `bus_table`: where the table of messages comes from; without it there is none.
        """
        is_recording = isinstance(source, Playback)
        self._visitors: dict[int, Visitor] = {}
        self.server = open_server(access)
        configure_theme(self.server.gui, is_dark=True)
        self.server.gui.set_panel_label("vehicle-iface: RECORDING" if is_recording else "vehicle-iface")
        self.server.gui.main_panel.dock_right()
        self.server.gui.main_panel.set_width(_PANEL_WIDTH_PX)
        set_stage(self.server, is_recording=is_recording)
        look_first(self.server)
        self._host: Host = Replays(source, bus_table) if isinstance(source, Playback) else LiveLoops(source, bus_table)

    @property
    def port(self) -> int:
        """TCP port of the page."""
        return self.server.get_port()

    def run(self, keep_running: Callable[[], bool]) -> None:
        """Update the page while `keep_running` returns True."""
        tick = 0
        due_ns = clock.monotonic_ns()
        while keep_running():
            self.update(tick)
            tick += 1
            # A late update is not caught up: that would only delay the next ones.
            due_ns = max(due_ns + _PERIOD_NS, clock.monotonic_ns())
            clock.sleep_until(due_ns)

    def update(self, tick: int) -> None:
        """Update the page in all browsers."""
        now_ns = clock.monotonic_ns()
        self._host.update(now_ns, tick)
        for visitor in self._update_visitors():
            visitor.update(now_ns, tick)
        self.server.flush()

    def close(self) -> None:
        """Stop serving."""
        self._host.close()
        self.server.stop()

    def _update_visitors(self) -> list[Visitor]:
        """Keep one visitor per connected browser. Polled: viser's callbacks for connect and disconnect may arrive in
        the wrong order, and a browser that stayed in the list would stay for ever."""
        clients = self.server.get_clients()
        for number in self._visitors.keys() - clients.keys():
            self._host.dismiss(self._visitors[number])
        self._visitors = {
            number: self._visitors.get(number) or self._host.admit(client) for number, client in clients.items()
        }
        return list(self._visitors.values())
