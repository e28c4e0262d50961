"""The map in the middle of the page instead of the 3-D picture, which a processor without a GPU draws too slowly.

Each browser says what draws its pictures; its user may choose otherwise.
"""

from __future__ import annotations

import viser

from vehicle_iface_viewer.controls import handle_text
from vehicle_iface_viewer.panels.map_drawing import MapDrawing

MAP, SCENE = "Map", "3-D"
_ORDER = 1.9
"""Above the buttons of the camera."""
_CHOSEN = "● "
_PATIENCE = 50
"""Calls of `show`, ten seconds, after which a browser that says nothing is taken to have a GPU."""
_NO_GPU = (
    "<b>This browser draws without a GPU: here is the map instead of the 3-D picture.</b> "
    "“Picture: 3-D”, in the panel on the right, shows it all the same."
)
_NOTHING_KNOWN = "No place of the vehicle is known yet."


class BigMap:
    """Whether a browser shows the map in the middle, and the map."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self.chosen = ""
        """`MAP` or `SCENE`; empty: as its GPU demands."""
        self._has_gpu: bool | None = None
        """None: the browser has not said so yet."""
        self._waits_left = _PATIENCE
        self._buttons = client.gui.add_button_group("Picture", self._options(), order=_ORDER)
        handle_text(client, self._buttons._impl.uuid, 20, self.choose)
        self._html = client.gui.add_html("", order=_ORDER + 0.01)
        self._is_named = False
        """Whether the buttons name `MAP` as chosen."""

    @property
    def is_shown(self) -> bool:
        """Whether the middle has the map, and no 3-D picture."""
        return self.chosen == MAP or (self.chosen != SCENE and self._has_gpu is False)

    @property
    def draws_scene(self) -> bool:
        """Whether the middle has the 3-D picture: not before it is known whether there is a GPU, as without one the
        first picture takes seconds, and all else waits for it."""
        return not self.is_shown and (self._has_gpu is not None or self.chosen == SCENE)

    def note_gpu(self, *, has_gpu: bool) -> None:
        """Without a GPU the map is shown, unless the user has chosen."""
        self._has_gpu = has_gpu

    def choose(self, option: str) -> None:
        """Show the map or the 3-D picture; another name is ignored."""
        name = option.removeprefix(_CHOSEN)
        if name in (MAP, SCENE):
            self.chosen = name

    def show(self, drawing: MapDrawing) -> None:
        """Show `drawing` as it is now, if the map is to be shown."""
        self._waits_left -= 1
        if self._has_gpu is None and self._waits_left <= 0:
            self._has_gpu = True
        if self.is_shown is not self._is_named:
            self._is_named = self.is_shown
            self._buttons.options = self._options()
        content = ""
        if self.is_shown:
            notes = "" if self._has_gpu is not False else f'<div class="vi-note" id="no-gpu">{_NO_GPU}</div>'
            notes += "" if drawing.picture else f'<div class="vi-note">{_NOTHING_KNOWN}</div>'
            content = f'<div id="big-map">{notes}{drawing.picture}</div>'
        if self._html.content != content:
            self._html.content = content

    def _options(self) -> tuple[str, ...]:
        return tuple(f"{_CHOSEN}{name}" if (name == MAP) is self.is_shown else name for name in (SCENE, MAP))
