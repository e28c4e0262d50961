"""Pause, time and speed of a recording, for one browser: each has its own place in the drive.

The page of a running loop has none of these controls.
"""

from __future__ import annotations

import math
from functools import partial

import viser

from vehicle_iface.units import NS_PER_S, ns_from_s
from vehicle_iface_viewer.controls import handle_checkbox, handle_key, handle_slider, handle_text
from vehicle_iface_viewer.panels.strip import COLUMNS, Span, strip_html
from vehicle_iface_viewer.playback import Playback
from vehicle_iface_viewer.recent import RecentSnapshots

ORDER = 1.5
"""Between the banner and the buttons of the camera."""
_HOLD_NS = 2 * NS_PER_S
"""For this time after the user moved the slider, it is not updated."""
_PERIOD_NS = NS_PER_S // 3
_STEP_S = 0.1
_SPEEDS = {"¼×": 0.25, "½×": 0.5, "1×": 1.0, "2×": 2.0, "4×": 4.0, "8×": 8.0}
_CHOSEN = "● "
_LONGEST = 20


class PlaybackControls:
    """The transport of one browser."""

    def __init__(self, client: viser.ClientHandle, playback: Playback) -> None:
        gui = client.gui
        self._playback = playback
        self._length_s = math.ceil(max(playback.length_s, 0.1) * 10.0) / 10.0
        self._due_ns = 0
        self._is_moved = False
        self._pause = gui.add_checkbox("Pause", initial_value=playback.is_paused, order=ORDER)
        gui.add_html(_strip(playback, self._length_s), order=ORDER + 0.09)  # below the slider, see the style sheet
        at_s = round(playback.at_s, 1)
        self._time = gui.add_slider("Time, s", 0.0, self._length_s, 0.1, at_s, order=ORDER + 0.1)
        self._speed = gui.add_button_group("Speed", _options(playback.speed), order=ORDER + 0.2)
        self._jumps = {
            "◀ Event": partial(playback.seek_event, -1),
            "Event ▶": partial(playback.seek_event, 1),
            "◀ Stop": partial(playback.seek_event, -1, stops_only=True),
            "Stop ▶": partial(playback.seek_event, 1, stops_only=True),
        }
        jumps = gui.add_button_group("Go to", tuple(self._jumps), order=ORDER + 0.3)
        handle_checkbox(client, self._pause._impl.uuid, self._set_pause)
        handle_slider(client, self._time._impl.uuid, 0.0, self._length_s, self._seek)
        handle_text(client, self._speed._impl.uuid, _LONGEST, self._choose_speed)
        handle_text(client, jumps._impl.uuid, _LONGEST, self._jump)
        handle_key(client, "Pause, or go on", "space", self._toggle_pause)
        handle_key(client, "Back by 0.1 s", "arrowleft", lambda: self._step(-_STEP_S))
        handle_key(client, "Forward by 0.1 s", "arrowright", lambda: self._step(_STEP_S))
        handle_key(client, "Previous stop", "arrowup", self._jumps["◀ Stop"])
        handle_key(client, "Next stop", "arrowdown", self._jumps["Stop ▶"])
        handle_key(client, "Previous event", "B", self._jumps["◀ Event"])
        handle_key(client, "Next event", "N", self._jumps["Event ▶"])
        handle_key(client, "Slower", "pagedown", lambda: self._change_speed(-1))
        handle_key(client, "Faster", "pageup", lambda: self._change_speed(1))

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

    def _jump(self, option: str) -> None:
        if option in self._jumps:
            self._jumps[option]()

    def _choose_speed(self, option: str) -> None:
        self._set_speed(_SPEEDS.get(option.removeprefix(_CHOSEN), self._playback.speed))

    def _change_speed(self, step: int) -> None:
        """Choose the next of the speeds that is faster (`step` 1) or slower (−1)."""
        now = self._playback.speed
        others = [speed for speed in _SPEEDS.values() if (speed - now) * step > 0.0]
        if others:
            self._set_speed(min(others) if step > 0 else max(others))

    def _set_speed(self, speed: float) -> None:
        self._playback.speed = speed
        self._speed.options = _options(speed)


def _options(chosen: float) -> tuple[str, ...]:
    return tuple(f"{_CHOSEN}{name}" if speed == chosen else name for name, speed in _SPEEDS.items())


def _strip(playback: Playback, length_s: float) -> str:
    rows = RecentSnapshots(length_s=length_s + 1.0, rate_hz=2 * COLUMNS / length_s)
    rows.extend(playback.sample(2 * COLUMNS))
    span = Span.between(playback.begin_ns, playback.begin_ns + ns_from_s(length_s))
    ends = ("0 s", f"{length_s:.1f} s")
    return strip_html("drive", span, rows.between(0, span.end_ns), playback.all_events(), ends)
