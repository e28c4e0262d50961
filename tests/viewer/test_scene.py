"""The picture: everything bounded, nothing undrawable drawn, no node made twice."""

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st

from tests.narrowing import at_present
from vehicle_iface.telemetry import DrawnTrajectory, SessionInfo, Snapshot, VehicleShape, WriterState
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails
from vehicle_iface.telemetry.events import EventKind, LoopEvent
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer import shapes
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.journey import Journey, Mark
from vehicle_iface_viewer.panels.plots import Plots
from vehicle_iface_viewer.panels.side_panel import SidePanel
from vehicle_iface_viewer.recent import RecentSnapshots
from vehicle_iface_viewer.scene.guides import braking_arc
from vehicle_iface_viewer.scene.nodes import LIVE
from vehicle_iface_viewer.scene.scene import Scene
from vehicle_iface_viewer.scene.trajectory_path import select_drawable
from vehicle_iface_viewer.serving import open_server

SHAPE = VehicleShape(length_m=7.0, width_m=2.4, wheelbase_m=4.0, height_m=2.8, track_m=2.0, wheel_radius_m=0.5)
INFO = SessionInfo(channel="vcan0", bus="SocketCAN vcan0", shape=SHAPE)


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    opened = open_server(Access(port=0))
    yield opened
    opened.stop()


def path(x_m: npt.ArrayLike, y_m: npt.ArrayLike, version: int = 1) -> DrawnTrajectory:
    x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
    return DrawnTrajectory(
        version=version,
        stamp_ns=0,
        frame_id="map",
        original_count=len(x),
        x_m=x,
        y_m=y,
        heading_rad=np.zeros(len(x)),
        speed_mps=np.ones(len(x)),
        time_s=np.arange(len(x), dtype=np.float64),
    )


def view(k: int, x_m: float, y_m: float, trajectory: DrawnTrajectory | None = None, **changes: object) -> View:
    now_ns = k * NS_PER_S // 10
    snapshot = Snapshot(now_ns, 3, 0, has_state=True, stamp_ns=now_ns, x_m=x_m, y_m=y_m)
    snapshot = snapshot._replace(**changes)  # type: ignore[arg-type]
    return View(
        now_ns=now_ns,
        address="a",
        writer_state=WriterState.LIVE,
        session=1,
        info=INFO,
        snapshot=snapshot,
        trajectory=trajectory,
        details=LiveDetails(link=LinkDetails(state="UP"), loop={"k": k}),
    )


def test_a_long_drive_adds_no_node_no_message_and_no_point(server: viser.ViserServer) -> None:
    recent = RecentSnapshots(length_s=25.0)
    journey, panel, plots = Journey(), SidePanel(server.gui), Plots(server.gui, recent)
    scene = Scene(server.scene, LIVE, journey)
    sizes = []
    for k in range(1, 1501):
        along = path(np.arange(600.0) + k, np.zeros(600), version=k // 50)
        changes = {"has_reference": True, "has_lookahead": True, "lookahead_x_m": k + 5.0}
        now = view(k, 2.0 * k, math.sin(k), along if k % 50 == 0 else None, **changes)
        assert now.snapshot is not None
        journey.add(now.snapshot)
        scene.draw(now)
        recent.extend([now.snapshot])
        panel.show(now, k)
        plots.show(now, k, end_ns=recent.newest_ns, window_s=20.0)
        if k % 500 == 0:
            buffer = server._websock_server._broadcast_buffer
            sizes.append((len(server.scene._handle_from_node_name), len(buffer.message_from_id)))
            assert len(scene._trail._line.points) < 400
    assert sizes[0] == sizes[1] == sizes[2]
    for k in range(1501, 2501):  # round and round one place, where nothing is forgotten for being far away
        now = view(k, 3000.0 + 50.0 * math.cos(0.04 * k), 50.0 * math.sin(0.04 * k))
        assert now.snapshot is not None
        journey.add(now.snapshot)
        scene.draw(now)
    assert 250 < len(scene._trail._line.points) < 400
    assert 200 < len(scene._track._line.points) < 601


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e12, 1e300])
def test_a_value_that_cannot_be_drawn_is_hidden_and_returns(server: viser.ViserServer, bad: float) -> None:
    scene = Scene(server.scene, LIVE, Journey())
    assert scene.draw(view(1, 3.0, 4.0)) is not None
    assert at_present(scene._vehicle._frame.visible)
    assert scene.draw(view(2, bad, 4.0)) is None
    assert not at_present(scene._vehicle._frame.visible)
    assert scene.draw(view(3, 3.0, 4.0, heading_rad=bad if not math.isfinite(bad) else 0.0)) is not None
    scene.draw(view(4, 3.0, 4.0, path([bad, bad], [0.0, bad]), has_reference=True, spatial_reference_x_m=bad))
    assert not scene._path._line.visible
    assert not scene._markers._spatial.visible
    assert scene._markers._temporal.visible
    scene.draw(view(5, 3.0, 4.0, path([0.0, 1.0], [0.0, 1.0])))
    assert scene._vehicle._frame.visible
    assert scene._path._line.visible


def test_far_from_the_maps_origin_the_vehicle_still_moves_by_centimetres(server: viser.ViserServer) -> None:
    scene = Scene(server.scene, LIVE, Journey())
    places = []
    for k in range(5):
        scene.draw(view(k, 500_000.0 + 0.01 * k, 5_400_000.0))
        places.append(float(scene._vehicle._frame.position[0]))
    assert np.diff(places) == pytest.approx(0.01, abs=1e-6)


def test_a_session_brings_its_vehicles_shape(server: viser.ViserServer) -> None:
    scene = Scene(server.scene, LIVE, Journey())
    scene.draw(view(1, 0.0, 0.0))
    assert np.ptp(scene._vehicle._body.vertices[:, 0]) == pytest.approx(SHAPE.length_m)
    assert scene._vehicle._wheels[0].position == pytest.approx((SHAPE.wheelbase_m, SHAPE.track_m / 2, 0.5))
    assert np.ptp(scene._vehicle._wheels[0].vertices[:, 2]) == pytest.approx(2 * SHAPE.wheel_radius_m)


def test_left_is_left(server: viser.ViserServer) -> None:
    scene = Scene(server.scene, LIVE, Journey())
    scene.draw(view(1, 0.0, 0.0, heading_rad=math.pi / 2, front_wheel_angle_rad=0.3))
    assert scene._vehicle._frame.wxyz == pytest.approx((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    assert scene._vehicle._wheels[0].wxyz == pytest.approx((math.cos(0.15), 0.0, 0.0, math.sin(0.15)))
    assert scene._vehicle._wheels[2].wxyz == pytest.approx((1.0, 0.0, 0.0, 0.0))


def test_a_trajectory_in_another_frame_is_not_drawn(server: viser.ViserServer) -> None:
    scene = Scene(server.scene, LIVE, Journey())
    scene.draw(view(1, 0.0, 0.0, path([0.0, 1.0], [0.0, 0.0]), frame_id="odom"))
    assert not scene._path._line.visible


def moving(speed_mps: float, front_rad: float = 0.0) -> View:
    return view(1, 100.0, 200.0, speed_mps=speed_mps, front_wheel_angle_rad=front_rad, heading_rad=1.0)


def test_the_braking_distance_is_that_of_the_hardest_braking_ahead_of_the_vehicles_end() -> None:
    front_m = SHAPE.length_m - SHAPE.rear_overhang_m
    ahead = braking_arc(moving(12.0))
    assert ahead[0, :2] == pytest.approx((front_m, 0.0))
    assert ahead[-3, :2] == pytest.approx((front_m + 12.0**2 / (2 * 6.0), 0.0))
    assert ahead[-2:, 1] == pytest.approx((SHAPE.width_m / 2, -SHAPE.width_m / 2))
    back = braking_arc(moving(-6.0))
    assert back[-3, :2] == pytest.approx((-SHAPE.rear_overhang_m - 3.0, 0.0))
    left = braking_arc(moving(6.0, front_rad=0.3))
    radius_m = SHAPE.wheelbase_m / math.tan(0.3)
    assert np.hypot(left[:-2, 0], left[:-2, 1] - radius_m) == pytest.approx(radius_m)
    assert left[-3, 1] > 0.5


@pytest.mark.parametrize("speed_mps", [0.0, -0.1, math.nan, math.inf, 1e200])
def test_a_vehicle_at_rest_has_no_braking_distance_and_an_absurd_one_is_bounded(speed_mps: float) -> None:
    arc = braking_arc(moving(speed_mps, front_rad=math.nan))
    assert len(arc) == (18 if speed_mps == 1e200 else 0)
    assert (np.abs(arc) < 1000.0).all()


def test_the_error_line_joins_vehicle_and_reference(server: viser.ViserServer) -> None:
    scene = Scene(server.scene, LIVE, Journey())
    north = {"has_reference": True, "heading_rad": math.pi / 2, "spatial_reference_x_m": 3.0}
    scene.draw(view(2, 3.0, 4.0, None, **north, spatial_reference_y_m=5.0))
    assert at_present(scene._guides._error.visible)
    for k, y_m, ahead_m in ((3, 5.0, 1.0), (5, 5.01, 1.0), (7, 5.1, 1.1)):  # not sent again for a centimetre
        scene.draw(view(k, 3.0, 4.0, None, **north, spatial_reference_y_m=y_m))
        assert scene._guides._error.points[0, :, :2].ravel() == pytest.approx([ahead_m, 0.0, 0.0, 0.0], abs=1e-6)
    scene.draw(view(8, 3.0, 4.0, speed_mps=5.0))
    assert not at_present(scene._guides._error.visible)
    assert at_present(scene._guides._braking.visible)
    scene.draw(view(9, math.nan, 4.0))
    assert not at_present(scene._guides._braking.visible)


def test_stops_are_pins_at_their_places(server: viser.ViserServer) -> None:
    journey = Journey()
    scene = Scene(server.scene, LIVE, journey)
    scene.draw(view(1, 1000.0, 0.0))
    for number, kind in enumerate((EventKind.STOP, EventKind.MODE, EventKind.FAULT)):
        event = LoopEvent(number=number, at_ns=number, kind=kind, name="x")
        journey.marks.append(Mark(x_m=1000.0 + 10.0 * number, y_m=2.0, event=event))
    scene.draw(view(2, 1000.0, 0.0))
    tips = scene._marks._mesh.vertices[4::5, 0]
    assert tips.tolist() == [0.0, 20.0]
    assert scene._marks._mesh.visible


@given(st.lists(st.tuples(st.floats(), st.floats()), max_size=30))
def test_drawn_points_are_finite_and_near(points: list[tuple[float, float]]) -> None:
    drawn, speeds = select_drawable(path([x for x, _ in points], [y for _, y in points]), (0.0, 0.0))
    assert len(drawn) == len(speeds)
    assert (np.abs(drawn) < 1e6).all()


@pytest.mark.parametrize("make", [shapes.body, shapes.cabin, shapes.roof, lambda s: shapes.lamps(s, front=True)])
def test_parts_of_the_car_are_symmetric_and_within_its_size(make: object) -> None:
    vertices, faces = make(SHAPE)  # type: ignore[operator]
    assert faces.max() < len(vertices)
    assert vertices[:, 1].min() == pytest.approx(-vertices[:, 1].max())
    assert vertices[:, 1].max() <= SHAPE.width_m / 2 + 1e-9
    assert vertices[:, 2].min() >= 0.0
    assert vertices[:, 2].max() <= SHAPE.height_m + 1e-9


def test_slow_is_blue_and_fast_is_red() -> None:
    slow, fast = shapes.speed_color(np.array([0.0, 1.0])).astype(int)
    assert slow[2] > slow[0]
    assert fast[0] > fast[2]
