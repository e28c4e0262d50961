"""The map: what it draws, that each part changes only when it must, and that its size is bounded."""

import math
import re
from collections import deque
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.telemetry import DrawnTrajectory, Snapshot, WriterState
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.journey import MAX_POINTS, Journey, Places
from vehicle_iface_viewer.panels.map_drawing import MapDrawing
from vehicle_iface_viewer.recent import RecentSnapshots


def path(x_m: npt.ArrayLike, y_m: npt.ArrayLike) -> DrawnTrajectory:
    x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
    return DrawnTrajectory(
        version=1,
        stamp_ns=0,
        frame_id="map",
        original_count=len(x),
        x_m=x,
        y_m=y,
        heading_rad=np.zeros(len(x)),
        speed_mps=np.ones(len(x)),
        time_s=np.arange(len(x), dtype=np.float64),
    )


def snapshot(at_ns: int, x_m: float, y_m: float = 0.0, heading_rad: float = 0.0) -> Snapshot:
    return Snapshot(
        at_ns,
        3,
        0,
        has_state=True,
        stamp_ns=at_ns,
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        has_reference=True,
        spatial_reference_x_m=x_m,
        spatial_reference_y_m=y_m + 1.0,
        sequence=at_ns,
    )


def view(shown: Snapshot, trajectory: DrawnTrajectory | None = None) -> View:
    return View(
        now_ns=shown.published_ns,
        address="a",
        writer_state=WriterState.LIVE,
        session=1,
        snapshot=shown,
        trajectory=trajectory,
    )


def points(html: str) -> list[tuple[float, float]]:
    """The places of all lines, m east and south of the map's origin."""
    found = []
    for path in re.findall(r'<path d="([^"]*)" transform="scale\(.01\)"', html):
        x = y = 0
        for dx, dy in re.findall(r"[ml](-?\d+) (-?\d+)", path):
            x, y = x + int(dx), y + int(dy)
            found.append((x / 100, y / 100))
    return found


def box(drawing: MapDrawing) -> tuple[float, float, float, float]:
    found = re.search(r'viewBox="(\S+) (\S+) (\S+) (\S+)"', drawing.picture)
    assert found is not None
    west, top, width, height = map(float, found.groups())
    return west, top, width, height


def test_without_a_place_there_is_no_map() -> None:
    drawing = MapDrawing()
    drawing.update(view(Snapshot(1, 0, 0)), Journey())
    assert drawing.picture == drawing.moving == ""


def test_far_from_the_origin_north_is_up_and_centimetres_are_kept() -> None:
    drawing, journey = MapDrawing(), Journey()
    for k in range(100):
        journey.add(snapshot(k, 500_000.0 + k, 5_400_000.0 + 2.0 * k))
    drawing.update(view(snapshot(100, 500_099.5, 5_400_198.25, math.pi / 2)), journey)
    track = points(drawing.track)
    assert max(abs(east) for east, _ in track) < 1000.0
    assert (track[-1][0] - track[0][0], track[-1][1] - track[0][1]) == (99.0, -198.0)
    x, y = map(float, re.findall(r"translate\((\S+) (\S+)\)", drawing.moving)[0])
    assert (x - track[-1][0], y - track[-1][1]) == pytest.approx((0.5, -0.25))
    assert "rotate(-90.0)" in drawing.moving


def test_only_what_moves_changes_while_the_vehicle_drives_within_the_picture() -> None:
    drawing, journey = MapDrawing(), Journey()
    route = path(np.arange(0.0, 200.0), np.zeros(200))
    journey.add(snapshot(0, 10.0))
    drawing.update(view(snapshot(1, 10.0), route), journey)
    before, moving = (drawing.ahead, drawing.route, drawing.track, drawing.picture), drawing.moving
    journey.add(snapshot(1, 11.0))  # the lines are not drawn again for each metre
    drawing.update(view(snapshot(2, 10.4), route), journey)
    assert (drawing.ahead, drawing.route, drawing.track, drawing.picture) == before
    assert drawing.moving != moving
    assert len(points(drawing.ahead)) == 200
    drawing.update(view(snapshot(2, 400.0), route), journey)
    west, _, width, _ = box(drawing)
    assert west + width > 400.0
    assert drawing.ahead == before[0]
    drawing.update(view(snapshot(3 * NS_PER_S, 11.0), route), journey)
    assert points(drawing.track)[-1][0] - points(drawing.track)[0][0] == 1.0


def test_the_map_of_a_very_long_drive_is_small() -> None:
    drawing, journey = MapDrawing(), Journey()
    for k in range(20_000):
        journey.add(snapshot(k, 3.0 * k, 40.0 * math.sin(k / 50)))
    drawing.update(view(snapshot(20_000, 60_000.0), path(np.arange(5000.0), np.zeros(5000))), journey)
    assert len(points(drawing.track)) <= MAX_POINTS
    assert len(points(drawing.route)) <= MAX_POINTS
    assert len(points(drawing.ahead)) == 400
    assert len(drawing.ahead + drawing.route + drawing.track) < 25_000


def test_a_jump_is_not_drawn_as_a_line() -> None:
    places = Places()
    for x_m in (0.0, 1.0, 2.0, 500.0, 501.0, math.nan, 1e300):
        places.add(x_m, 0.0)
    assert places.joints().tolist() == [False, True, True, False, True]
    assert places.positions_m()[:, 0].tolist() == [0.0, 1.0, 2.0, 500.0, 501.0]


def test_a_stop_is_marked_where_the_vehicle_was_and_once() -> None:
    recent, journey, drawing = RecentSnapshots(length_s=20.0), Journey(), MapDrawing()
    recent.extend(snapshot(k * NS_PER_S // 10 + 1, float(k)) for k in range(100))
    names = (("<b>DEVIATION", EventKind.STOP, Phase.BEGAN), ("DEVIATION", EventKind.STOP, Phase.ENDED))
    events = deque(
        LoopEvent(number=n, at_ns=5 * NS_PER_S, kind=kind, name=name, phase=phase)
        for n, (name, kind, phase) in enumerate((*names, ("speed_mps", EventKind.LIMIT, Phase.BEGAN)), 1)
    )
    for _ in range(2):
        journey.mark(events, recent)
    assert [(mark.x_m, mark.event.number) for mark in journey.marks] == [(50.0, 1)]
    drawing.update(view(snapshot(1, 0.0)), journey)
    assert drawing.picture.count("vi-mark") == 1
    assert "&lt;b&gt;DEVIATION" in drawing.picture
    journey.clear()
    drawing.update(view(snapshot(1, 0.0)), journey)
    assert "vi-mark" not in drawing.picture


@given(st.lists(st.tuples(st.floats(), st.floats(), st.floats()), min_size=1, max_size=12))
def test_whatever_the_positions_the_map_is_valid_and_finite(places: list[tuple[float, float, float]]) -> None:
    drawing, journey = MapDrawing(), Journey()
    trajectory = path([x for x, _, _ in places], [y for _, y, _ in places])
    for x_m, y_m, heading_rad in places:
        shown = snapshot(1, x_m, y_m, heading_rad)
        journey.add(shown)
        drawing.update(view(shown, trajectory), journey)
    for part in (drawing.ahead, drawing.route, drawing.track, drawing.moving, drawing.picture):
        if part:
            ElementTree.fromstring(part)
            assert not re.search(r"\b(nan|inf)\b", part)
