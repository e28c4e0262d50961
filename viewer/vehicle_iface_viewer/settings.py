"""What one browser has chosen for its page: light or dark, the length of the plots, the signals of the free plot, the
camera, map or 3-D picture, the filter of the table, the open tab and the widths of the panels.

Each browser remembers it, and the address of its page carries it, for another browser or another day.
"""

from __future__ import annotations

from collections.abc import Mapping

import viser

from vehicle_iface_viewer import browser_memory
from vehicle_iface_viewer.browser_memory import LEFT, RIGHT, TAB
from vehicle_iface_viewer.cameras import Camera
from vehicle_iface_viewer.controls import handle_text
from vehicle_iface_viewer.panels.big_map import BigMap
from vehicle_iface_viewer.panels.free_plot import FreePlot
from vehicle_iface_viewer.panels.left_panel import LeftPanel
from vehicle_iface_viewer.panels.plot_time import PlotTime

AS_BROWSER, LIGHT, DARK = "as the browser", "light", "dark"
_THEMES = (AS_BROWSER, LIGHT, DARK)
_THEME, _PLOTS, _FREE, _AND, _CAMERA, _PICTURE, _FILTER = (
    "theme",
    "plots",
    "free",
    "and",
    "camera",
    "picture",
    "filter",
)
_NAMES = (_THEME, _PLOTS, _FREE, _AND, _CAMERA, _PICTURE, _FILTER, LEFT, RIGHT, TAB)
"""Names in the address of the page."""
_WIDTHS_PX = (200, 1200)
"""Narrowest and widest panel that is remembered."""
_RESET = "Reset"
_ORDER = 30.0


def configure_theme(gui: viser.GuiApi, *, is_dark: bool) -> None:
    """Make a page dark or light."""
    gui.configure_theme(dark_mode=is_dark, show_logo=False, show_share_button=False)


class Settings:
    """The choices of one browser."""

    def __init__(
        self,
        client: viser.ClientHandle,
        camera: Camera,
        big_map: BigMap,
        left_panel: LeftPanel,
        time: PlotTime,
        free_plot: FreePlot,
    ) -> None:
        self._client, self._camera, self._big_map, self._left_panel = client, camera, big_map, left_panel
        self._time, self._free_plot = time, free_plot
        self._theme, self._prefers = AS_BROWSER, DARK
        self._is_dark = True
        self._box = client.gui.add_dropdown("Theme", _THEMES, initial_value=AS_BROWSER, order=_ORDER)
        handle_text(client, self._box._impl.uuid, max(map(len, _THEMES)), self._choose_theme)
        reset = client.gui.add_button_group("Layout", (_RESET,), order=_ORDER + 0.1)
        handle_text(client, reset._impl.uuid, len(_RESET), lambda _: browser_memory.forget(client, _NAMES))
        self._known: dict[str, str] | None = None
        """What the browser remembers; None until it has answered."""
        browser_memory.ask(client, _NAMES, self._apply)

    def keep(self) -> None:
        """Have the browser remember what has changed."""
        chosen = self._chosen()
        if self._known is not None and chosen != self._known:
            self._known = chosen
            browser_memory.remember(self._client, chosen)

    def _chosen(self) -> dict[str, str]:
        free, second = self._free_plot.wanted
        return {
            _THEME: self._theme,
            _PLOTS: self._time.window,
            _FREE: free,
            _AND: second,
            _CAMERA: self._camera.chosen,
            _PICTURE: self._big_map.chosen,
            _FILTER: self._left_panel.search,
        }

    def _apply(self, answer: Mapping[str, str]) -> None:
        """Choose what the browser says; values that do not exist are ignored."""
        self._prefers = answer.get(browser_memory.PREFERS, DARK)
        theme = answer.get(_THEME, AS_BROWSER)
        self._choose_theme(theme)
        if self._theme == theme:
            self._box.value = theme  # type: ignore[misc]  # viser declares no setter
        self._time.choose_window(answer.get(_PLOTS, ""))
        for place, name in enumerate((_FREE, _AND)):
            self._free_plot.choose(place, answer.get(name, ""))
        self._camera.choose(answer.get(_CAMERA, ""))
        self._big_map.note_gpu(has_gpu=answer.get(browser_memory.DRAWS) != "software")
        self._big_map.choose(answer.get(_PICTURE, ""))
        self._left_panel.choose_search(answer.get(_FILTER, ""))
        for name, panel in ((LEFT, self._left_panel.panel), (RIGHT, self._client.gui.main_panel)):
            width = answer.get(name, "")
            if width.isdecimal() and len(width) < 5 and _WIDTHS_PX[0] <= int(width) <= _WIDTHS_PX[1]:
                panel.set_width(int(width))
        browser_memory.keep_layout(self._client, self._left_panel.tabs, answer.get(TAB, ""))
        self._known = self._chosen()

    def _choose_theme(self, theme: str) -> None:
        if theme not in _THEMES:
            return
        self._theme = theme
        is_dark = (self._prefers if theme == AS_BROWSER else theme) != LIGHT
        if is_dark != self._is_dark:
            self._is_dark = is_dark
            configure_theme(self._client.gui, is_dark=is_dark)
