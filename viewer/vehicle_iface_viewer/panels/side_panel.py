"""The panel beside the scene: banner, numbers, legend."""

from __future__ import annotations

import viser

from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.banner import banner_html
from vehicle_iface_viewer.panels.frozen import cover_html
from vehicle_iface_viewer.panels.legend import legend_html
from vehicle_iface_viewer.panels.numbers import numbers_html
from vehicle_iface_viewer.panels.style import STYLE


class SidePanel:
    """The control panel, except for what each browser has of its own: the camera and the plots."""

    def __init__(self, gui: viser.GuiApi) -> None:
        gui.add_html(STYLE, order=0.1)
        self._cover = gui.add_html(cover_html(0), order=0.2)
        self._banner = gui.add_html(banner_html(None), order=1.0)
        self._numbers = gui.add_html("", order=3.0)
        self._legend = gui.add_html(legend_html(None), order=4.0)

    def show(self, view: View, turn: int) -> None:
        """Update texts and plots to `view`: the banner each time, the rest in turns to save the browser work."""
        _update(self._banner, banner_html(view))
        if turn % 2 == 0:
            self._cover.content = cover_html(turn)
            _update(self._numbers, numbers_html(view))
        else:
            _update(self._legend, legend_html(view))


def _update(handle: viser.GuiHtmlHandle, content: str) -> None:
    if handle.content != content:
        handle.content = content
