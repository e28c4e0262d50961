"""Which time the plots of one browser show: how long, paused or not, and how far back.

Picture and map of this browser show the same time; the head and the numbers stay live.
"""

from __future__ import annotations

import viser

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry.columns import Columns
from vehicle_iface.units import NS_PER_S, ns_from_s, s_from_ns
from vehicle_iface_viewer.controls import handle_checkbox, handle_key, handle_slider, handle_text
from vehicle_iface_viewer.panels.text import MAX_SHOWN, enum_name, plain
from vehicle_iface_viewer.recent import RecentSnapshots

WINDOWS = {"10 s": 10.0, "20 s": 20.0, "30 s": 30.0, "120 s": 120.0}
USUAL_WINDOW = "20 s"
BACK_S = 600.0
"""How far one can look back."""
RECENT_S = 30.0
"""How far the strip below the banner goes back."""
ORDER, RECENT_ORDER = 9.3, 1.3
"""Positions of the sliders: each over its strip."""
_ORDER = 9.0
_YELLOW, _BLACK = "#ffd43b", "#000000"


class PlotTime:
    """The time controls of one browser's plots."""

    def __init__(self, client: viser.ClientHandle, *, is_live: bool) -> None:
        """A recording has controls of its own for the time: here only the length of the plots can be chosen."""
        self.window = USUAL_WINDOW
        self._is_paused = False
        self._paused_ns: int | None = None
        self._back_s = 0.0
        self._sliders: list[viser.GuiSliderHandle[float]] = []
        self._note = client.gui.add_html("", order=_ORDER + 0.4)
        self._windows = client.gui.add_dropdown("Plots", tuple(WINDOWS), initial_value=USUAL_WINDOW, order=_ORDER + 0.1)
        handle_text(client, self._windows._impl.uuid, max(map(len, WINDOWS)), self._set_window)
        if is_live:
            pause = client.gui.add_checkbox("Pause plots", initial_value=False, order=_ORDER + 0.2)
            handle_checkbox(client, pause._impl.uuid, self._set_pause)
            handle_key(client, "Pause the plots, or go on", "P", lambda: self._toggle_pause(pause))
            self._add_slider(client, "Last 30 s", RECENT_S, 0.1, RECENT_ORDER)
            self._add_slider(client, "Last ten minutes", BACK_S, 0.5, ORDER)

    def _add_slider(self, client: viser.ClientHandle, name: str, length_s: float, step_s: float, order: float) -> None:
        slider = client.gui.add_slider(name, -length_s, 0.0, step_s, 0.0, order=order)
        self._sliders.append(slider)
        handle_slider(client, slider._impl.uuid, -length_s, 0.0, lambda at_s: self._set_back(-at_s, moved=slider))

    @property
    def is_present(self) -> bool:
        """Whether neither a pause nor a slider shows the past."""
        return self._back_s == 0.0 and not self._is_paused

    def end_ns(self, newest_ns: int) -> int:
        """Return when the plots end, given the time of the newest snapshot; both in ns."""
        if not self._is_paused:
            self._paused_ns = None
        elif self._paused_ns is None:
            self._paused_ns = newest_ns
        now_ns = newest_ns if self._paused_ns is None else self._paused_ns
        return max(now_ns - ns_from_s(self._back_s), 0)

    def show(self, recent: RecentSnapshots) -> None:
        """Say what the plots show where it is not the present."""
        end_ns = self.end_ns(recent.newest_ns)
        content = "" if self.is_present else _note(recent.between(end_ns - NS_PER_S, end_ns), recent.newest_ns - end_ns)
        if self._note.content != content:
            self._note.content = content

    @property
    def window_s(self) -> float:
        """Length of the plots."""
        return WINDOWS[self.window]

    def choose_window(self, name: str) -> None:
        """Choose the length of the plots for the browser; a name that is none is ignored."""
        self._set_window(name)
        self._windows.value = self.window  # type: ignore[misc]  # viser declares no setter

    def _set_window(self, name: str) -> None:
        if name in WINDOWS:
            self.window = name

    def _set_pause(self, is_paused: bool) -> None:
        self._is_paused = is_paused

    def _toggle_pause(self, box: viser.GuiCheckboxHandle) -> None:
        self._is_paused = not self._is_paused
        box.value = self._is_paused  # type: ignore[misc]  # viser declares no setter

    def _set_back(self, back_s: float, moved: viser.GuiSliderHandle[float] | None = None) -> None:
        self._back_s = back_s
        for slider in self._sliders:
            if slider is not moved:
                slider.value = max(-back_s, slider.min)  # type: ignore[misc]  # viser declares no setter


def _note(rows: Columns, ago_ns: int) -> str:
    """Return the time at which the plots end, and what was known then."""
    if len(rows):
        last = rows[-1]
        state, reason = int(last["controller_state"]), int(last["reason"])
        values = [enum_name(ControllerState, state), enum_name(Reason, reason)]
        values += [f"speed {_figure(last['speed_mps'])} m/s"] if last["has_state"] else []
        values += [f"lateral error {_figure(last['lateral_error_m'])} m"] if last["has_reference"] else []
        known = " · ".join(map(plain, values))
    else:
        known = "nothing is kept of that time"
    return (
        f'<div id="past" style="background:{_YELLOW};color:{_BLACK};border-radius:8px;padding:6px 14px;'
        'margin:4px 14px 4px 8px;font-size:13px;line-height:1.4;font-variant-numeric:tabular-nums">'
        f"<b>PLOTS END {s_from_ns(ago_ns):.1f} s AGO</b>, as do picture and map; all else is live<br>{known}</div>"
    )


def _figure(value: float) -> str:
    return f"{value:z.2f}" if abs(value) < MAX_SHOWN else "out of range"
