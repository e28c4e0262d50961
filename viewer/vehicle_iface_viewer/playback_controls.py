"""Pause, time and speed of a recording, on its page.

The page of a running loop has none of these controls: of its browsers only the camera and their own
plots are handled.
"""

from __future__ import annotations

import math

import viser

from vehicle_iface.units import NS_PER_S, ns_from_s
from vehicle_iface_viewer.access import handle_checkbox, handle_key, handle_slider
from vehicle_iface_viewer.panels.strip import COLUMNS, Span, strip_html
from vehicle_iface_viewer.playback import SPEEDS, Playback
from vehicle_iface_viewer.recent import RecentSnapshots

ORDER = 1.5
"""Between the banner and the buttons of the camera."""
_HOLD_NS = 2 * NS_PER_S
"""For this time after the user moved the slider, it is not updated."""
_PERIOD_NS = NS_PER_S // 3
_STEP_S = 0.1


class PlaybackControls:
    """Shared by all browsers, which all show the same time."""

    def __init__(self, gui: viser.GuiApi, playback: Playback) -> None:
        self._playback = playback
        self._length_s = math.ceil(max(playback.length_s, 0.1) * 10.0) / 10.0
        self._due_ns = 0
        self._is_moved = False
        self._pause = gui.add_checkbox("Pause", initial_value=False, order=ORDER)
        gui.add_html(_strip(playback, self._length_s), order=ORDER + 0.09)  # below the slider, see the style sheet
        self._time = gui.add_slider("Time, s", 0.0, self._length_s, 0.1, round(playback.at_s, 1), order=ORDER + 0.1)
        self._previous = gui.add_button("Previous stop", order=ORDER + 0.3)
        self._next = gui.add_button("Next stop", order=ORDER + 0.4)
        self._speed = gui.add_slider("Speed, ×", *SPEEDS, 0.1, playback.speed, order=ORDER + 0.2)

    def connect(self, client: viser.ClientHandle) -> None:
        """Handle the controls of this browser."""
        handle_checkbox(client, self._pause._impl.uuid, self._set_pause)
        handle_slider(client, self._time._impl.uuid, 0.0, self._length_s, self._seek)
        handle_checkbox(client, self._previous._impl.uuid, lambda _: self._seek_stop(-1))
        handle_checkbox(client, self._next._impl.uuid, lambda _: self._seek_stop(1))
        handle_slider(client, self._speed._impl.uuid, *SPEEDS, self._set_speed)
        handle_key(client, "Pause, or go on", "space", self._toggle_pause)
        handle_key(client, "Back by 0.1 s", "arrowleft", lambda: self._step(-_STEP_S))
        handle_key(client, "Forward by 0.1 s", "arrowright", lambda: self._step(_STEP_S))
        handle_key(client, "Previous stop", "arrowup", lambda: self._seek_stop(-1))
        handle_key(client, "Next stop", "arrowdown", lambda: self._seek_stop(1))

    def update(self, now_ns: int) -> None:
        """Show the time of the playback, unless the user is moving the slider."""
        if self._is_moved:
            self._is_moved, self._due_ns = False, now_ns + _HOLD_NS
        if self._pause.value != self._playback.is_paused:
            self._pause.value = self._playback.is_paused  # type: ignore[misc]  # viser declares no setter
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + _PERIOD_NS
            at_s = round(self._playback.at_s, 1)
            if self._time.value != at_s:
                self._time.value = at_s  # type: ignore[misc]

    def _set_pause(self, is_paused: bool) -> None:
        self._playback.is_paused = is_paused

    def _seek(self, at_s: float) -> None:
        self._playback.seek(at_s)
        self._is_moved = True

    def _toggle_pause(self) -> None:
        self._playback.is_paused = not self._playback.is_paused

    def _step(self, step_s: float) -> None:
        self._playback.step(step_s)
        self._is_moved = True

    def _seek_stop(self, step: int) -> None:
        self._playback.seek_stop(step)

    def _set_speed(self, speed: float) -> None:
        self._playback.speed = speed


def _strip(playback: Playback, length_s: float) -> str:
    rows = RecentSnapshots(length_s=length_s + 1.0, rate_hz=2 * COLUMNS / length_s)
    rows.extend(playback.sample(2 * COLUMNS))
    span = Span.between(playback.begin_ns, playback.begin_ns + ns_from_s(length_s))
    ends = ("0 s", f"{length_s:.1f} s")
    return strip_html("drive", span, rows.between(0, span.end_ns), playback.all_events(), ends)
