"""The running loops that a page shows: one that was named, or those of this machine, of which each browser chooses."""

from __future__ import annotations

from collections.abc import Mapping

import viser

from vehicle_iface import clock
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer import browser_memory
from vehicle_iface_viewer.browser import LiveBrowser
from vehicle_iface_viewer.bus_table.source import BusTableSource
from vehicle_iface_viewer.feed import LiveTelemetry
from vehicle_iface_viewer.host import Visitor
from vehicle_iface_viewer.loops import KnownLoop, LoopList
from vehicle_iface_viewer.panels.frozen import cover_html
from vehicle_iface_viewer.panels.loop_bar import BESIDE, LOOP, Beside, choice_html, shown_html
from vehicle_iface_viewer.panels.style import STYLE
from vehicle_iface_viewer.scene.companion import find_hindrance
from vehicle_iface_viewer.watched import Watched

_ORDER = 0.9
"""Above the banner."""
_BAR_EVERY = 15
_MOST_IN_LABEL = 20
_ANSWER_NS = 3 * NS_PER_S
"""A browser that has not said by then which loop it wants has none to say."""


class LiveLoops:
    """Each loop that a browser has chosen is read once, for all of them."""

    def __init__(self, address: str | None, bus_table: BusTableSource | None = None) -> None:
        """`address`: the only loop to show; None: all those of this machine can be chosen."""
        self._list = LoopList() if address is None else None
        self._bus_table = bus_table
        self._watched: dict[str, Watched] = {}
        if self._list is not None:
            self._list.update(clock.monotonic_ns())
        self.usual = address if self._list is None else self._list.find_usual()
        """The loop of a browser that names none; None: it must choose."""
        if self.usual is not None:
            self.watch(self.usual)

    @property
    def is_pinned(self) -> bool:
        """Whether no browser may choose."""
        return self._list is None

    @property
    def known(self) -> Mapping[str, KnownLoop]:
        """The loops that may be chosen, by address."""
        return self._list.known if self._list is not None else {}

    def watch(self, address: str) -> Watched:
        """Return what is known of a loop; from now on it is read."""
        if address not in self._watched:
            table = self._bus_table.fork() if self._bus_table is not None else None
            self._watched[address] = Watched(LiveTelemetry(address), table)
            self._watched[address].update(clock.monotonic_ns(), 0)
        return self._watched[address]

    def update(self, now_ns: int, tick: int) -> None:
        """Look for loops, and read those that were chosen."""
        if self._list is not None:
            self._list.update(now_ns)
            self.usual = self._list.find_usual()
        for watched in self._watched.values():
            watched.update(now_ns, tick)

    def admit(self, client: viser.ClientHandle) -> LiveVisitor:
        """Make the page of a new browser."""
        return LiveVisitor(client, self)

    def dismiss(self, gone: Visitor) -> None:
        """Go on reading: the next browser sees the last ten minutes, too."""

    def close(self) -> None:
        """Release all resources."""
        for watched in self._watched.values():
            watched.close()


class LiveVisitor:
    """One browser: it shows the loop that its address names, or the list to choose from."""

    def __init__(self, client: viser.ClientHandle, loops: LiveLoops) -> None:
        self.browser: LiveBrowser | None = None
        """None until a loop is shown."""
        self._client, self._loops = client, loops
        self._wanted: str | None = None
        self._beside: str | None = None
        self._due_ns = clock.monotonic_ns() + _ANSWER_NS
        self._cover = client.gui.add_html("", order=_ORDER)
        self._bar = client.gui.add_html("", order=_ORDER)
        if loops.is_pinned:
            assert loops.usual is not None
            self._open(loops.usual)
        else:
            browser_memory.ask(client, (LOOP, BESIDE), self._receive)

    def update(self, now_ns: int, tick: int) -> None:
        """Show the loop, or wait until one is chosen."""
        if self.browser is None and now_ns >= self._due_ns:
            self._choose(tick)
        if self.browser is None:
            return
        self.browser.update(now_ns, tick)
        if tick % _BAR_EVERY == 0:
            watched, known = self.browser.watched, self._loops.known.values()
            self._show(shown_html(watched.address, watched.info, known, _describe_beside(self.browser)))

    def _receive(self, answer: Mapping[str, str]) -> None:
        self._wanted, self._beside = answer.get(LOOP), answer.get(BESIDE)
        self._due_ns = 0

    def _choose(self, tick: int) -> None:
        """Open the wanted loop as soon as it is known, without a wish the usual one; else show the list."""
        address = self._loops.usual if self._wanted is None else self._wanted
        if address is not None and (address == self._loops.usual or address in self._loops.known):
            self._open(address)
            browser_memory.show_in_address(self._client, {LOOP: address})
        elif tick % _BAR_EVERY == 0:
            self._cover.content = STYLE + cover_html(tick)
            self._show(choice_html(self._loops.known.values(), self._wanted))

    def _open(self, address: str) -> None:
        self._cover.content = self._bar.content = ""
        self._client.gui.set_panel_label(f"vehicle-iface: {_shorten(address)}")
        is_other = self._beside is not None and self._beside != address and self._beside in self._loops.known
        beside = self._loops.watch(self._beside) if self._beside is not None and is_other else None
        self.browser = LiveBrowser(self._client, self._loops.watch(address), beside)

    def _show(self, content: str) -> None:
        """Show `content`, if it has changed: a link that is replaced cannot be clicked."""
        if self._bar.content != content:
            self._bar.content = content


def _shorten(address: str) -> str:
    """The end of a long address: the label of the panel is one line, and a phone is as wide as that."""
    return address if len(address) <= _MOST_IN_LABEL else f"…{address[1 - _MOST_IN_LABEL :]}"


def _describe_beside(browser: LiveBrowser) -> Beside | None:
    beside = browser.beside
    if beside is None or beside.view is None or browser.watched.view is None:
        return None
    return Beside(address=beside.address, hindrance=find_hindrance(browser.watched.view, beside.view))
