"""The map of one browser: below the tabs on the left, and in the main panel of a phone."""

from __future__ import annotations

import viser

from vehicle_iface_viewer.panels.map_drawing import MapDrawing

_PHONE_ORDER = 2.5
"""Between the buttons of the camera and the numbers."""
_NOTHING = '<div class="vi-note">no place of the vehicle is known yet</div>'


class MapPanel:
    """Shows a drawing; of it only what has changed is sent."""

    def __init__(self, client: viser.ClientHandle, above: viser.PanelHandle) -> None:
        panel = client.gui.add_panel(order=6.0)
        with panel.add_tab("Map"):
            self._picture = client.gui.add_html(_NOTHING)
        panel.dock_below(above)
        self._beside = client.gui.add_html("", order=_PHONE_ORDER + 0.05)
        self._parts = [client.gui.add_html("", order=_PHONE_ORDER + part / 100) for part in range(5)]

    def show_beside(self, content: str) -> None:
        """Show the second vehicle, as `MapDrawing.draw_beside` draws it."""
        if self._beside.content != content:
            self._beside.content = content

    def show(self, drawing: MapDrawing) -> None:
        """Show `drawing` as it is now."""
        picture = drawing.picture or _NOTHING
        phone = f'<div class="vi-phone">{drawing.picture}</div>' if drawing.picture else ""
        contents = (drawing.ahead, drawing.route, drawing.track, drawing.moving, phone)
        for handle, content in zip((*self._parts, self._picture), (*contents, picture), strict=True):
            if handle.content != content:
                handle.content = content
