"""The banner: state, reason, session and rates, legible from across the room."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import UNSET

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import Snapshot, WriterState
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.colors import GREY, RED, state_color
from vehicle_iface_viewer.panels.text import enum_name, plain
from vehicle_iface_viewer.panels.words import Words, find_words, is_armed, vehicle_fault

OLD_STATE_S = 0.1
"""An older state is marked. The loop stops at half of this; the rest allows for the delay of the page."""
_TAKE_OVER, _BLACK = "#ffe600", "#000000"
_SMALL = "opacity:.85;font-size:12px"
_MOST_NAMES = 6
_PURPLE, _LILAC = "#43305c", "#d0b8f5"


def banner_html(view: View | None) -> str:
    """Return the banner; grey where the data is stale."""
    if view is None:
        return _banner(GREY, Words(headline="WAITING", sentence=""), [], state="", reason="", stale=True)
    words = find_words(view)
    snapshot = view.snapshot
    if snapshot is None:
        lines = [f"<div>{plain(view.problem)}</div>"] if view.problem else []
        if view.writer_state is WriterState.ABSENT:
            lines.append(f"<div>waiting for a loop at {plain(view.address)}</div>")
        return _recording_box(view) + _banner(GREY, words, lines, state="", reason="", stale=True)
    state, reason = enum_name(ControllerState, snapshot.controller_state), enum_name(Reason, snapshot.reason)
    lines = [*_vehicle_fault(view), *_staleness(view), *_session_lines(view), _rates(view)]
    banner = _banner(_color(view, snapshot), words, lines, state=state, reason=reason, stale=view.is_stale)
    return _recording_box(view) + "".join(_handover(view)) + banner


def _color(view: View, snapshot: Snapshot) -> str:
    color = state_color(snapshot.controller_state, snapshot.reason)
    if view.is_stale:
        color = RED if view.writer_state is WriterState.DEAD else GREY
    return f"repeating-linear-gradient(135deg,{color} 0 16px,{_PURPLE} 16px 32px)" if view.recording else color


def _recording_box(view: View | None) -> str:
    """Return a box above the banner that marks a recording."""
    if view is None or not view.recording:
        return ""
    return (
        f'<div id="recording" style="border:3px solid {_LILAC};background:{_PURPLE};color:#fff;border-radius:8px;'
        'padding:8px 14px;margin:4px 14px 4px 8px;line-height:1.45;font-size:13px;font-variant-numeric:tabular-nums">'
        f'<div style="font-size:25px;font-weight:750;letter-spacing:2px;color:{_LILAC}">RECORDING, NOT LIVE</div>'
        f"<div>{plain(view.recording)}</div></div>"
    )


def _banner(color: str, words: Words, lines: list[str], *, state: str, reason: str, stale: bool) -> str:
    way_on = f'<div id="way-on" style="font-size:14px;font-weight:600">{words.way_on}</div>' if words.way_on else ""
    was = "last known: " if stale else ""
    codes = (
        f'<div style="{_SMALL}">{was}<span id="state">{plain(state)}</span> · <span id="reason">{plain(reason)}</span>'
        "</div>"
        if state
        else ""
    )
    return (
        f'<div id="banner" data-state="{plain(state)}" data-reason="{plain(reason)}" data-stale="{str(stale).lower()}"'
        f' style="background:{color};color:#fff;border-radius:8px;padding:10px 14px;margin:4px 14px 4px 8px;'
        'line-height:1.45;font-size:13px;font-variant-numeric:tabular-nums">'
        f'<div id="headline" style="font-size:28px;line-height:1.2;font-weight:750">{words.headline}</div>'
        f'<div id="sentence" style="font-size:15px;font-weight:600">{words.sentence}</div>'
        f"{way_on}{codes}{''.join(lines)}</div>"
    )


def _handover(view: View) -> Iterator[str]:
    """Return the request to the driver to take over, legible from across the car."""
    assert view.snapshot is not None
    if view.snapshot.handover_pending and not view.is_stale:
        left_s = view.snapshot.handover_in_ns / NS_PER_S
        when = f"in {left_s:.1f} s at the earliest" if left_s > 0.0 else "at standstill"
        yield (
            f'<div id="handover" style="background:{_TAKE_OVER};color:{_BLACK};border:4px solid {_BLACK};border-radius:'
            '8px;padding:10px 14px;margin:4px 14px 4px 8px;line-height:1.2;font-size:18px;font-weight:700">'
            f'<div style="font-size:52px;font-weight:900">TAKE OVER</div>control is returned {when}</div>'
        )


def _vehicle_fault(view: View) -> Iterator[str]:
    assert view.snapshot is not None
    fault = vehicle_fault(view.snapshot)
    if fault and not view.is_stale:
        yield (
            f'<div id="vehicle-fault" style="background:{RED};border:2px solid #fff;border-radius:5px;padding:2px 8px;'
            f'margin:4px 0;font-size:20px;font-weight:750">{fault}</div>'
        )


def _staleness(view: View) -> Iterator[str]:
    assert view.snapshot is not None
    if view.is_stale:
        yield f'<div id="stale" style="font-weight:700;font-size:15px">no data for {view.data_age_s:.1f} s</div>'
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
    has_writer = view.writer_state is WriterState.LIVE
    was_armed = info.arming == "armed" and not (has_writer and view.snapshot and is_armed(view.snapshot))
    yield f'<div id="bus"><b>{"not armed any more" if was_armed else plain(info.arming)}</b> · {plain(info.bus)}</div>'
    yield from _link_lines(view)
    yield from _shadow_lines(view)
    if info.bus_hint:
        yield f'<div style="{_SMALL}">{plain(info.bus_hint)}</div>'
    if view.recorder is not None and view.recorder.fault:
        yield f'<div id="recorder" style="font-weight:700">RECORDER: {plain(view.recorder.fault)}</div>'
    elif view.recorder is not None:
        yield f'<div id="recorder">recording to {plain(view.recorder.folder)}</div>'
    yield f"<div>profile {plain(info.profile or '–')} · route {plain(info.route or '–')}</div>"
    if info.unprotected:
        yield f'<div id="unprotected" style="{_SMALL}">unprotected: {_names(info.unprotected)}</div>'
    yield from _sample_lines(view)


def _names(names: Sequence[str]) -> str:
    """Return the first names, and how many more there are."""
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(plain(name) for name in names[:_MOST_NAMES]) + more


def _link_lines(view: View) -> Iterator[str]:
    """Return the link's state when it is not UP, and the bus load when it is known."""
    if view.details is None:
        return
    link = view.details.link
    if link.state != "UP":
        why = "" if link.why is UNSET else f": {plain(link.why)}"
        yield f'<div id="link" style="font-weight:700">link {plain(link.state)}{why}</div>'
    if link.load_percent is not UNSET and link.frames_per_s is not UNSET:
        by_bus = {} if link.loads_percent is UNSET else link.loads_percent
        loads = ", ".join(f"{plain(name)} {load:.1f} %" for name, load in by_bus.items())
        shown = f"{loads or f'{link.load_percent:.1f} %'} · {link.frames_per_s:.0f} frames/s"
        yield f'<div id="load">bus load {shown}</div>'


def _sample_lines(view: View) -> Iterator[str]:
    """How far odometry has come, and how old the oldest part of a sample was."""
    if view.details is None:
        return
    if view.details.odometry_m is not UNSET:
        distance = f"{view.details.odometry_m:.1f} m driven; its error grows with the distance"
        yield f'<div id="odometry">position by odometry: {distance}</div>'
    ages_s = view.details.part_ages_s
    if ages_s is not UNSET and ages_s:
        oldest = max(ages_s, key=lambda name: ages_s[name])
        yield f'<div id="oldest">oldest part of a sample: {plain(oldest)}, {ages_s[oldest] * 1e3:.0f} ms</div>'


def _shadow_lines(view: View) -> Iterator[str]:
    """Return the differences between another commander's commands and those of a loop in shadow mode."""
    shadow = view.details.shadow if view.details is not None else UNSET
    if shadow is UNSET or not shadow.compared:
        return
    accel_mps2, angle_rad = shadow.accel_mps2.p95, shadow.front_wheel_angle_rad.p95
    difference = f"95 % differ by at most {accel_mps2:.3f} m/s², {angle_rad:.4f} rad"
    yield f'<div id="shadow">other commander: {shadow.compared} commands, {difference}</div>'


def _rates(view: View) -> str:
    snapshot = view.snapshot
    assert snapshot is not None
    state_age = f"{min(view.state_age_s, 9999.0) * 1e3:.0f} ms" if snapshot.has_state else "none"
    latency = f"{snapshot.latency_ns / 1e6:.2f} ms" if snapshot.sent else "–"
    tiles = (
        _tile("samples/s", _rate(view.sample_rate_hz)),
        _tile("commands/s", _rate(view.command_rate_hz)),
        _tile("state age", state_age, is_bad=view.state_age_s > OLD_STATE_S),
        _tile("latency", latency),
    )
    return f'<div style="display:flex;gap:6px;margin-top:6px">{"".join(tiles)}</div>'


def _rate(rate_hz: float | None) -> str:
    return "–" if rate_hz is None else f"{rate_hz:.0f}"


def _tile(name: str, value: str, *, is_bad: bool = False) -> str:
    back = f"{RED};outline:2px solid #fff" if is_bad else "rgba(0,0,0,.22)"
    return (
        f'<div style="flex:1;background:{back};border-radius:5px;padding:3px 7px;white-space:nowrap">'
        f'<div style="font-size:11px;opacity:.85">{name}</div>'
        f'<div style="font-size:15px;font-weight:650">{value}</div></div>'
    )
