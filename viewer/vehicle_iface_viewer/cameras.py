"""The camera of one browser: four ways to look at the drive, or none of them.

The world of a browser hangs on a frame of its own, which is moved and turned under the camera. So turning and zooming
stay the user's own while the picture follows the vehicle.
"""

from __future__ import annotations

import math
from enum import StrEnum
from functools import partial

import viser
from viser._messages import HotkeyKey

from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.box import Box
from vehicle_iface_viewer.controls import handle_key, handle_text
from vehicle_iface_viewer.scene.nodes import ROOT, Place

ORDER = 2.0
"""Position of the buttons: under the banner."""
Point = tuple[float, float, float]


class Look(StrEnum):
    """What the camera does."""

    FOLLOW = "Follow"
    CHASE = "Chase"
    TOP = "Top"
    FIT = "Fit"
    STAY = "Stay"


_KEYS: tuple[tuple[Look, HotkeyKey, str], ...] = (
    (Look.FOLLOW, "F", "Camera: follow the vehicle, or stay"),
    (Look.CHASE, "C", "Camera: behind the vehicle"),
    (Look.TOP, "T", "Camera: from above, north is up"),
    (Look.FIT, "R", "Camera: the whole drive"),
)
_CHOSEN = "● "
_POSES: dict[Look, tuple[Point, Point]] = {
    Look.FOLLOW: ((-11.0, -11.0, 12.0), (0.0, 0.0, 0.0)),
    Look.CHASE: ((-13.0, 0.0, 6.5), (6.0, 0.0, 1.0)),
    Look.TOP: ((0.0, -0.05, 50.0), (0.0, 0.0, 0.0)),
}
"""Camera and the point that it looks at, m from the vehicle; the vehicle looks along x in CHASE."""
_FIRST = _POSES[Look.FOLLOW]
_SLANT = 1e-3
"""From exactly above, north would be undefined."""


class Camera:
    """The camera of one browser, with its buttons and keys."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._frame = client.scene.add_frame(ROOT, show_axes=False)
        self._wanted = self._view = Look.FOLLOW
        self._fitted: Box | None = None
        self._buttons = client.gui.add_button_group("Camera", _options(self._view), order=ORDER)
        handle_text(client, self._buttons._impl.uuid, 20, self.choose)
        for view, key, label in _KEYS:
            handle_key(client, label, key, partial(self._choose, view))

    @property
    def chosen(self) -> str:
        """Name of what the camera does."""
        return str(self._wanted)

    def choose(self, option: str) -> None:
        """Choose what the camera does by its name; a name that is none is ignored."""
        name = option.removeprefix(_CHOSEN)
        if name in list(Look):
            self._wanted = Look(name)

    def show_buttons(self, *, are_useful: bool) -> None:
        """Show the buttons, or hide them where there is no picture."""
        if self._buttons.visible is not are_useful:
            self._buttons.visible = are_useful

    def move(self, place: Place, drive: Box | None) -> None:
        """Look at the vehicle, or at the whole `drive`; both relative to the local origin."""
        view = self._wanted
        if view is not self._view:
            self._view, self._fitted = view, None
            self._buttons.options = _options(view)
            if view in _POSES:
                self._look(*_POSES[view])
        if view is Look.FIT and drive is not None:
            self._fit(drive)
        elif view in _POSES:
            is_turned = view is Look.CHASE and math.isfinite(place.heading_rad)
            self._shift(place.x_m, place.y_m, -place.heading_rad if is_turned else 0.0)
        self._client.flush()

    def _choose(self, view: Look) -> None:
        """Choose by a key: that of FOLLOW stops it, too."""
        self._wanted = Look.STAY if view is Look.FOLLOW is self._wanted else view

    def _shift(self, x_m: float, y_m: float, turn_rad: float) -> None:
        cos, sin = math.cos(turn_rad), math.sin(turn_rad)
        self._frame.wxyz = shapes.quaternion_z(turn_rad)
        self._frame.position = (-cos * x_m + sin * y_m, -sin * x_m - cos * y_m, 0.0)

    def _fit(self, drive: Box) -> None:
        if drive == self._fitted:
            return
        self._fitted = drive
        self._shift(drive.west + drive.width / 2.0, drive.south + drive.height / 2.0, 0.0)
        half = math.tan(self._client.camera.fov / 2.0)
        height_m = max(drive.height / 2.0 / half, drive.width / 2.0 / half / max(self._client.camera.aspect, 0.1))
        self._look((0.0, -_SLANT * height_m, height_m), (0.0, 0.0, 0.0))

    def _look(self, position: Point, look_at: Point) -> None:
        self._client.camera.position = position
        self._client.camera.look_at = look_at


def look_first(server: viser.ViserServer) -> None:
    """Set the camera of each new browser."""
    server.initial_camera.position, server.initial_camera.look_at = _FIRST


def _options(chosen: Look) -> tuple[str, ...]:
    return tuple(f"{_CHOSEN}{view}" if view is chosen else str(view) for view in Look)
