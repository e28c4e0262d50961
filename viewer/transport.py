"""Pause, place and speed of a recording, on its page.

The page of a running loop has none of this: there a browser has nothing to say but where it looks from.
"""

from __future__ import annotations

import math

import viser

from vehicle_iface.units import NS_PER_S
from viewer.access import allow_number, allow_switch
from viewer.recording import SPEEDS, Recording

ORDER = 1.5
"""Between the banner and the switch of each browser."""
_HANDS_OFF_NS = 2 * NS_PER_S
"""A slider that was moved is the hand's for so long."""
_FOLLOW_NS = NS_PER_S // 3


class Transport:
    """One for all browsers: they look at the same instant."""

    def __init__(self, gui: viser.GuiApi, recording: Recording) -> None:
        self._recording = recording
        self._length_s = math.ceil(max(recording.length_s, 0.1) * 10.0) / 10.0
        self._due_ns = 0
        self._is_moved = False
        self._pause = gui.add_checkbox("Pause", initial_value=False, order=ORDER)
        self._place = gui.add_slider("Time, s", 0.0, self._length_s, 0.1, round(recording.at_s, 1), order=ORDER + 0.1)
        self._speed = gui.add_slider("Speed, ×", *SPEEDS, 0.1, recording.speed, order=ORDER + 0.2)

    def hear(self, client: viser.ClientHandle) -> None:
        """Let this browser use it."""
        allow_switch(client, self._pause._impl.uuid, self._set_pause)
        allow_number(client, self._place._impl.uuid, 0.0, self._length_s, self._go_to)
        allow_number(client, self._speed._impl.uuid, *SPEEDS, self._set_speed)

    def update(self, now_ns: int) -> None:
        """Show where the recording is, unless a hand is at it."""
        if self._is_moved:
            self._is_moved, self._due_ns = False, now_ns + _HANDS_OFF_NS
        if self._pause.value != self._recording.is_paused:
            self._pause.value = self._recording.is_paused  # type: ignore[misc]  # viser declares no setter
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + _FOLLOW_NS
            place_s = round(self._recording.at_s, 1)
            if self._place.value != place_s:
                self._place.value = place_s  # type: ignore[misc]

    def _set_pause(self, is_paused: bool) -> None:
        self._recording.is_paused = is_paused

    def _go_to(self, at_s: float) -> None:
        self._recording.go_to(at_s)
        self._is_moved = True

    def _set_speed(self, speed: float) -> None:
        self._recording.speed = speed
