"""The words and curves beside the picture: banner, numbers, legend, plots, counters.

What comes from a DBC, a bus, a file or the telemetry goes through `plain` and stays text.
"""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import viser
from viser import uplot

from vehicle_iface.reason import Reason
from vehicle_iface.runtime.telemetry import Snapshot, WriterState
from vehicle_iface.status import ControllerState, Gear, VehicleMode
from vehicle_iface.units import NS_PER_S
from viewer import scene, shapes
from viewer.feed import View

OLD_STATE_S = 0.1
"""A state older than this is marked: the loop stops at half of it, the rest is the page's own delay."""
_MAX_TEXT = 160
_GREEN, _AMBER, _RED, _BLUE, _TEAL, _GREY = "#2b8a3e", "#e67700", "#c92a2a", "#1864ab", "#0b7285", "#495057"
_PURPLE, _LILAC = "#43305c", "#d0b8f5"
_STATE_COLORS = {
    ControllerState.ENGAGED: _GREEN,
    ControllerState.ENGAGING: _TEAL,
    ControllerState.STOPPING: _AMBER,
    ControllerState.FAULT: _RED,
    ControllerState.SHADOW: _BLUE,
    ControllerState.STARTING: _TEAL,
    ControllerState.STANDBY: _TEAL,
}
_GONE = {
    WriterState.ABSENT: "NO LOOP",
    WriterState.ENDED: "LOOP ENDED",
    WriterState.DEAD: "LOOP GONE",
    WriterState.OTHER_VERSION: "OTHER VERSION",
    WriterState.UNREADABLE: "UNREADABLE",
}
_WINDOW_S = 20.0
_PLOT_STEP_NS = NS_PER_S // 10
_PLOT_POINTS = int(_WINDOW_S * 10)
_WANTED, _IS, _SENT = "#fcc419", "#4dabf7", "#69db7c"

# title, then (label, colour, value) of each curve; a value is NaN where its flag says that there is none.
_Curve = tuple[str, str, Callable[[Snapshot], float]]
_PLOTS: tuple[tuple[str, tuple[_Curve, ...]], ...] = (
    (
        "Speed, m/s",
        (
            ("reference", _WANTED, lambda s: s.reference_speed_mps if s.has_reference else math.nan),
            ("vehicle", _IS, lambda s: s.speed_mps if s.has_state else math.nan),
        ),
    ),
    (
        "Tracking error: lateral, m · heading, rad",
        (
            ("lateral", "#ff8787", lambda s: s.lateral_error_m if s.has_reference else math.nan),
            ("heading", "#b197fc", lambda s: s.heading_error_rad if s.has_reference else math.nan),
        ),
    ),
    (
        "Front wheels, rad (left positive)",
        (
            ("wanted", _WANTED, lambda s: s.wanted_front_wheel_angle_rad if s.has_wanted else math.nan),
            ("sent", _SENT, lambda s: s.sent_front_wheel_angle_rad if s.sent else math.nan),
            ("vehicle", _IS, lambda s: s.front_wheel_angle_rad if s.has_state else math.nan),
        ),
    ),
    (
        "Acceleration, m/s²",
        (
            ("wanted", _WANTED, lambda s: s.wanted_accel_mps2 if s.has_wanted else math.nan),
            ("sent", _SENT, lambda s: s.sent_accel_mps2 if s.sent else math.nan),
            ("vehicle", _IS, lambda s: s.accel_mps2 if s.has_state else math.nan),
        ),
    ),
)


def plain(value: object) -> str:
    """`value` as text that no browser takes for markup, of bounded length, in one line."""
    text = str(value)
    text = text if len(text) <= _MAX_TEXT else text[: _MAX_TEXT - 1] + "…"
    return html.escape("".join(c if c.isprintable() else "�" for c in text), quote=True)


class Panels:
    """Everything in the control panel but the switch of each browser."""

    FOLLOW_ORDER = 2.0
    """Where the switch goes: under the banner."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._banner = gui.add_html(banner_html(None), order=1.0)
        self._numbers = gui.add_html("", order=3.0)
        self._legend = gui.add_html(legend_html(None), order=4.0)
        self._plots = Plots(gui)
        with gui.add_folder("Counters", expand_by_default=False, order=20.0):
            self._details = gui.add_html("")

    def show(self, view: View, turn: int) -> None:
        """Bring words and curves to `view`: the banner each time, the rest in turns to spare the browser."""
        _update(self._banner, banner_html(view))
        if turn % 2 == 0:
            _update(self._numbers, numbers_html(view))
        else:
            _update(self._legend, legend_html(view))
            _update(self._details, details_html(view))
        self._plots.extend(view)
        self._plots.send(turn)


def _update(handle: viser.GuiHtmlHandle, content: str) -> None:
    if handle.content != content:
        handle.content = content


class Plots:
    """Curves of the last seconds, in rings of a fixed length."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._due_ns = 0
        self._session = 0
        self._unsent: set[int] = set()
        count = sum(len(curves) for _, curves in _PLOTS)
        self._times_ns = np.zeros(_PLOT_POINTS)
        self._values = np.full((count, _PLOT_POINTS), np.nan)
        self._handles = [self._added(gui, title, curves, 10.0 + k) for k, (title, curves) in enumerate(_PLOTS)]

    def extend(self, view: View) -> None:
        """Add the newest values; old data adds nothing, and the curves stand still."""
        snapshot = view.snapshot
        if view.session != self._session:
            self._session, self._due_ns = view.session, 0
            self._times_ns[:], self._values[:] = 0.0, np.nan
        if snapshot is None or view.is_stale or view.now_ns < self._due_ns:
            return
        self._due_ns = view.now_ns + _PLOT_STEP_NS
        self._times_ns = np.roll(self._times_ns, -1)
        self._values = np.roll(self._values, -1, axis=1)
        self._times_ns[-1] = snapshot.published_ns
        self._values[:, -1] = [value(snapshot) for _, curves in _PLOTS for _, _, value in curves]
        self._unsent = set(range(len(_PLOTS)))

    def send(self, turn: int) -> None:
        """Send every other plot that has something new: whole arrays each time, and redrawing is dear."""
        ago_s = (self._times_ns - self._times_ns[-1]) / NS_PER_S
        kept = ago_s >= -_WINDOW_S
        row = 0
        for k, (_, curves) in enumerate(_PLOTS):
            if k % 2 == turn % 2 and k in self._unsent:
                self._unsent.remove(k)
                self._handles[k].data = (ago_s[kept], *self._values[row : row + len(curves), kept])
            row += len(curves)

    def _added(self, gui: viser.GuiApi, title: str, curves: tuple[_Curve, ...], order: float) -> viser.GuiUplotHandle:
        nothing = np.zeros(1)
        series = [uplot.Series(label="s")]
        series += [uplot.Series(label=label, stroke=color, width=1.6) for label, color, _ in curves]
        line = {"stroke": "#343a40", "width": 1}
        across, up = ({"stroke": "#adb5bd", "grid": line, "ticks": line, "size": size} for size in (30, 54))
        return gui.add_uplot(
            (nothing, *(nothing for _ in curves)),
            tuple(series),
            title=title,
            scales={"x": uplot.Scale(time=False, auto=False, range=(-_WINDOW_S, 0.0))},
            axes=(across, up),  # type: ignore[arg-type]  # plain dictionaries of the keys that matter
            legend=uplot.Legend(show=True, live=False),
            height=118,
            order=order,
        )


def banner_html(view: View | None) -> str:
    """What somebody across the room has to see."""
    if view is None or view.snapshot is None:
        title = _GONE.get(view.link, "WAITING") if view else "WAITING"
        lines = [f"<div>{plain(view.problem or 'no snapshot yet')}</div>"] if view else []
        if view and view.link is WriterState.ABSENT:
            lines.append(f"<div>waiting for a loop at {plain(view.address)}</div>")
        return _recording_box(view) + _banner(_GREY, title, "", lines, state="", reason="", stale=True)
    snapshot = view.snapshot
    state, reason = _named(ControllerState, snapshot.controller_state), _named(Reason, snapshot.reason)
    color = _GREY if view.is_stale else _STATE_COLORS.get(snapshot.controller_state, _RED)  # type: ignore[call-overload]
    if view.recording:
        color = f"repeating-linear-gradient(135deg,{color} 0 16px,{_PURPLE} 16px 32px)"
    lines = [*_staleness(view), *_handover(view), *_session_lines(view), _rates(view)]
    banner = _banner(color, state, reason, lines, state=state, reason=reason, stale=view.is_stale)
    return _recording_box(view) + banner


def _recording_box(view: View | None) -> str:
    """Above everything else: this is not now."""
    if view is None or not view.recording:
        return ""
    return (
        f'<div id="recording" style="border:3px solid {_LILAC};background:{_PURPLE};color:#fff;border-radius:8px;'
        'padding:8px 14px;margin:4px 8px;line-height:1.45;font-size:13px;font-variant-numeric:tabular-nums">'
        f'<div style="font-size:25px;font-weight:750;letter-spacing:2px;color:{_LILAC}">RECORDING, NOT LIVE</div>'
        f"<div>{plain(view.recording)}</div></div>"
    )


def _banner(color: str, title: str, subtitle: str, lines: list[str], *, state: str, reason: str, stale: bool) -> str:
    return (
        f'<div id="banner" data-state="{plain(state)}" data-reason="{plain(reason)}" data-stale="{str(stale).lower()}"'
        f' style="background:{color};color:#fff;border-radius:8px;padding:10px 14px;margin:4px 8px;line-height:1.45;'
        'font-size:13px;font-variant-numeric:tabular-nums">'
        f'<div style="display:flex;justify-content:space-between;align-items:baseline;gap:12px;flex-wrap:wrap">'
        f'<span id="state" style="font-size:25px;font-weight:750;letter-spacing:.5px">{plain(title)}</span>'
        f'<span id="reason" style="font-size:15px;font-weight:600">{plain(subtitle)}</span></div>'
        f"{''.join(lines)}</div>"
    )


def _handover(view: View) -> Iterator[str]:
    """Words for the person who has to take over."""
    assert view.snapshot is not None
    if view.snapshot.hands_over and not view.is_stale:
        left_s = view.snapshot.handover_ns / NS_PER_S
        when = f"in {left_s:.1f} s at the earliest" if left_s > 0.0 else "at standstill"
        yield f'<div id="handover" style="font-weight:700;font-size:15px">TAKE OVER: control is given back {when}</div>'


def _staleness(view: View) -> Iterator[str]:
    assert view.snapshot is not None
    if view.is_stale:
        gone = f"{_GONE[view.link]}: " if view.link in _GONE else ""
        yield (
            f'<div id="stale" style="font-weight:700;font-size:15px">{gone}no data for {view.data_age_s:.1f} s</div>'
        )
        if view.problem:
            yield f"<div>{plain(view.problem)}</div>"
    path = view.trajectory
    if path is not None and len(path.x_m) and path.frame_id != view.snapshot.frame_id:
        frames = f"trajectory in frame {plain(path.frame_id)}, vehicle in {plain(view.snapshot.frame_id)}"
        yield f"<div><b>{frames}: not drawn together</b></div>"


def _session_lines(view: View) -> Iterator[str]:
    info = view.info
    if info is None:
        return
    yield f'<div id="bus">{plain(info.bus)} · channel {plain(info.channel)} · <b>{plain(info.arming)}</b></div>'
    yield from _link_lines(view)
    yield from _shadow_lines(view)
    if info.bus_hint:
        yield f'<div style="opacity:.85;font-size:12px">{plain(info.bus_hint)}</div>'
    if view.recorder is not None and view.recorder.fault:
        yield f'<div id="recorder" style="font-weight:700">RECORDER: {plain(view.recorder.fault)}</div>'
    elif view.recorder is not None:
        yield f'<div id="recorder">recorded to {plain(view.recorder.folder)}</div>'
    yield f"<div>profile {plain(info.profile or '–')} · route {plain(info.route or '–')}</div>"


def _link_lines(view: View) -> Iterator[str]:
    """The link's state where it is not up, and the bus load where it is known."""
    link = view.details.get("link")
    if not isinstance(link, dict):
        return
    state, load, frames = link.get("state"), link.get("load_percent"), link.get("frames_per_s")
    if state not in (None, "UP"):
        yield f'<div id="link" style="font-weight:700">link {plain(state)}</div>'
    if isinstance(load, float) and isinstance(frames, float):
        yield f'<div id="load">bus load {load:.1f} % · {frames:.0f} frames/s</div>'


def _shadow_lines(view: View) -> Iterator[str]:
    """How far a loop in shadow is from another commander, once there is one."""
    shadow = view.details.get("shadow")
    if not isinstance(shadow, dict) or not shadow.get("compared"):
        return
    sizes = [shadow.get(name) for name in ("accel_mps2", "front_wheel_angle_rad")]
    accel, angle = (size.get("p95") if isinstance(size, dict) else None for size in sizes)
    if isinstance(accel, float) and isinstance(angle, float):
        apart = f"95 % within {accel:.3f} m/s², {angle:.4f} rad of ours"
        yield f'<div id="shadow">another commander: {plain(shadow["compared"])} commands, {apart}</div>'


def _rates(view: View) -> str:
    snapshot = view.snapshot
    assert snapshot is not None
    state_age = f"{min(view.state_age_s, 9999.0) * 1e3:.0f} ms" if snapshot.has_state else "none"
    latency = f"{snapshot.latency_ns / 1e6:.2f} ms" if snapshot.sent else "–"
    tiles = (
        _tile("samples/s", f"{view.sample_rate_hz:.0f}"),
        _tile("commands/s", f"{view.command_rate_hz:.0f}"),
        _tile("state age", state_age, is_bad=view.state_age_s > OLD_STATE_S),
        _tile("latency", latency),
    )
    return f'<div style="display:flex;gap:6px;margin-top:6px">{"".join(tiles)}</div>'


def _tile(name: str, value: str, *, is_bad: bool = False) -> str:
    back = _RED if is_bad else "rgba(0,0,0,.22)"
    return (
        f'<div style="flex:1;background:{back};border-radius:5px;padding:3px 7px;white-space:nowrap">'
        f'<div style="font-size:11px;opacity:.85">{name}</div>'
        f'<div style="font-size:15px;font-weight:650">{value}</div></div>'
    )


def numbers_html(view: View) -> str:
    """The state and the references in figures."""
    s = view.snapshot
    if s is None:
        return ""
    no = "–"
    left = (
        ("x", _figure(s.x_m, ".2f", "m") if s.has_state else no),
        ("y", _figure(s.y_m, ".2f", "m") if s.has_state else no),
        ("heading", _figure(math.degrees(s.heading_rad), ".1f", "°") if s.has_state else no),
        ("speed", _figure(s.speed_mps, ".2f", "m/s") if s.has_state else no),
        ("mode", _named(VehicleMode, s.vehicle_mode) if s.has_status else no),
        ("gear", _named(Gear, s.gear) if s.has_status and s.gear != Gear.NO_REQUEST else no),
        ("frame", plain(s.frame_id)),
    )
    total = f" / {view.trajectory.original_count - 1}" if view.trajectory and len(view.trajectory.x_m) else ""
    right = (
        ("in space", f"{s.spatial_index}{total}" if s.has_reference else no),
        ("in time", f"{s.temporal_index}{total}" if s.has_reference else no),
        ("lateral error", _figure(s.lateral_error_m, ".3f", "m") if s.has_reference else no),
        ("heading error", _figure(math.degrees(s.heading_error_rad), ".2f", "°") if s.has_reference else no),
        ("commands", f"{s.commands}"),
        ("frames dropped", f"{s.drops}"),
        ("deadlines missed", f"{s.deadline_misses}"),
    )
    rows = "".join(f"<tr>{_cell(a, 'left')}{_cell(b, 'right')}</tr>" for a, b in zip(left, right, strict=True))
    return (
        '<table id="numbers" style="width:calc(100% - 16px);margin:2px 8px;border-collapse:collapse;font-size:13px;'
        f'font-variant-numeric:tabular-nums">{rows}</table>'
    )


def _cell(pair: tuple[str, str], side: str) -> str:
    name, value = pair
    gap = "padding-left:18px" if side == "right" else ""
    key = name.replace(" ", "-")
    return (
        f'<td style="opacity:.65;padding:1px 0;{gap}">{name}</td>'
        f'<td id="n-{key}" style="text-align:right;font-weight:600">{value}</td>'
    )


def _figure(value: float, form: str, unit: str) -> str:
    return f"{value:{form}} {unit}" if math.isfinite(value) and abs(value) < 1e12 else "not a number to show"


def legend_html(view: View | None) -> str:
    """What the colours and shapes mean."""
    path = view.trajectory if view else None
    speeds = np.abs(path.speed_mps) if path is not None and len(path.x_m) else np.zeros(0)
    fastest = float(speeds.max()) if len(speeds) and np.isfinite(speeds).all() else 0.0
    ends = (0.0, fastest / 2, fastest)
    scale = "".join(f"<span>{v:.1f}</span>" for v in ends) if fastest else "<span>no trajectory</span>"
    colors = ",".join(_css(c) for c in shapes.SPEED_COLORS)
    marks = (
        ("border-radius:50%", scene.SPATIAL_COLOR, "reference in space"),
        ("", scene.TEMPORAL_COLOR, "reference in time"),
        ("clip-path:polygon(0 0,100% 0,50% 100%)", scene.LOOKAHEAD_COLOR, "look-ahead"),
        ("height:3px;margin-bottom:3px", scene.TRAIL_COLOR, "trail"),
    )
    items = "".join(
        '<span style="white-space:nowrap"><i style="display:inline-block;width:10px;height:10px;margin-right:5px;'
        f'background:{_css(color)};{form}"></i>{word}</span>'
        for form, color, word in marks
    )
    return (
        '<div id="legend" style="margin:4px 8px;font-size:12px;line-height:1.5">'
        '<div style="display:flex;gap:10px;align-items:center"><span style="white-space:nowrap;opacity:.75">'
        f'speed, m/s</span><div style="flex:1"><div style="height:8px;border-radius:4px;background:linear-gradient('
        f'90deg,{colors})"></div><div style="display:flex;justify-content:space-between">{scale}</div></div></div>'
        f'<div style="display:flex;flex-wrap:wrap;column-gap:14px">{items}'
        f'<span style="opacity:.75;white-space:nowrap">{scene.GRID_TEXT}</span></div></div>'
    )


def details_html(view: View) -> str:
    """Counters as the loop names them, nested names joined."""
    rows = "".join(
        f'<tr><td style="opacity:.75">{plain(name)}</td><td style="text-align:right">{plain(value)}</td></tr>'
        for name, value in _flat("", view.details, depth=0)
    )
    if not rows:
        return '<div style="margin:4px 8px;font-size:12px;opacity:.75">nothing counted yet</div>'
    return (
        '<table id="details" style="width:calc(100% - 16px);margin:2px 8px;font-size:12px;'
        f'font-variant-numeric:tabular-nums">{rows}</table>'
    )


def _flat(prefix: str, value: Any, *, depth: int, limit: int = 100) -> list[tuple[str, object]]:
    """At most `limit` leaves of nested counters."""
    if not isinstance(value, dict) or depth > 4:
        return [(prefix, f"{value:.6g}" if isinstance(value, float) else value)]
    found: list[tuple[str, object]] = []
    for name, inner in value.items():
        if len(found) >= limit:
            return [*found[: limit - 1], ("…", "more than can be shown")]
        found += _flat(f"{prefix} · {name}" if prefix else str(name), inner, depth=depth + 1, limit=limit)
    return found


def _named(kind: Any, value: int) -> str:
    try:
        return str(kind(value).name)
    except ValueError:
        return f"{kind.__name__} {value}"


def _css(color: tuple[int, int, int]) -> str:
    return "rgb({},{},{})".format(*color)
