"""The legend: what colours and shapes of the scene mean."""

from __future__ import annotations

import numpy as np

from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.text import css
from vehicle_iface_viewer.scene import event_marks, ground, guides, markers, scene, trail


def legend_html(view: View | None) -> str:
    """Return the legend of speed colours and markers."""
    path = view.trajectory if view else None
    speeds = np.abs(path.speed_mps) if path is not None and len(path.x_m) else np.zeros(0)
    fastest = float(speeds.max()) if len(speeds) and np.isfinite(speeds).all() else 0.0
    ends = (0.0, fastest / 2, fastest)
    scale = "".join(f"<span>{v:.1f}</span>" for v in ends) if fastest else "<span>no trajectory</span>"
    colors = ",".join(css(c) for c in shapes.SPEED_COLORS)
    marks = (
        ("border-radius:50%", markers.SPATIAL_COLOR, "spatial ref"),
        ("", markers.TEMPORAL_COLOR, "temporal ref"),
        ("clip-path:polygon(0 0,100% 0,50% 100%)", markers.LOOKAHEAD_COLOR, "look-ahead"),
        ("height:3px;margin-bottom:3px", trail.TRAIL_COLOR, "trail"),
        ("height:3px;margin-bottom:3px", scene.ROUTE_COLOR, "path behind"),
        ("height:3px;margin-bottom:3px", guides.ERROR_COLOR, "error"),
        ("height:3px;margin-bottom:3px", guides.BRAKING_COLOR, "braking distance"),
        ("clip-path:polygon(0 0,100% 0,50% 100%)", event_marks.MARK_COLOR, "stop"),
    )
    items = "".join(
        '<span style="white-space:nowrap"><i style="display:inline-block;width:10px;height:10px;margin-right:5px;'
        f'background:{css(color)};{form}"></i>{word}</span>'
        for form, color, word in marks
    )
    return (
        '<div id="legend" style="margin:4px 14px 4px 8px;font-size:12px;line-height:1.5">'
        '<div style="display:flex;gap:10px;align-items:center"><span style="white-space:nowrap;opacity:.75">'
        f'speed, m/s</span><div style="flex:1"><div style="height:8px;border-radius:4px;background:linear-gradient('
        f'90deg,{colors})"></div><div style="display:flex;justify-content:space-between">{scale}</div></div></div>'
        f'<div style="display:flex;flex-wrap:wrap;column-gap:14px">{items}'
        f'<span style="opacity:.75;white-space:nowrap">{ground.GRID_TEXT}'
        "</span></div></div>"
    )
