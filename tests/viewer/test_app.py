"""Browsers come and go, and leave nothing behind."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.app import App
from vehicle_iface_viewer.box import Box
from vehicle_iface_viewer.browser import LiveBrowser
from vehicle_iface_viewer.cameras import Look
from vehicle_iface_viewer.live import LiveVisitor
from vehicle_iface_viewer.scene.nodes import Place

from .test_access import camera, joined, packed, wait_for_answer


@pytest.fixture
def app(tmp_path: Path) -> Iterator[App]:
    opened = App(Access(port=0), str(tmp_path / "loop"))
    yield opened
    opened.close()


def only_browser(app: App) -> LiveBrowser:
    (visitor,) = app._visitors.values()
    assert isinstance(visitor, LiveVisitor)
    assert visitor.browser is not None
    return visitor.browser


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_the_texts_do_not_wait_for_the_first_picture(app: App) -> None:
    with joined(app.server) as client:
        wait_for_answer(client)  # no camera was sent
        app.update(0)
        assert "NO LOOP" in only_browser(app)._showing._side_panel._banner.content


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_a_browser_that_left_is_forgotten(app: App) -> None:
    for _ in range(5):
        with joined(app.server) as client:
            client.send(packed(camera()))
            while not app._update_visitors():
                wait_for_answer(client)
            follower = only_browser(app)
            follower.camera.move(Place(1.0, 2.0, 0.5), None)
            assert tuple(follower.camera._frame.position) == (-1.0, -2.0, 0.0)
        while app._update_visitors():
            app.update(0)
    assert app._visitors == {}


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_each_camera_puts_the_world_where_its_name_says(app: App) -> None:
    with joined(app.server) as client:
        client.send(packed(camera()))
        while not app._update_visitors():
            wait_for_answer(client)
        browser = only_browser(app)
        view, place = browser.camera, Place(30.0, 40.0, 2.0)
        drive = Box(west=10.0, south=20.0, width=100.0, height=60.0)

        def shown(point: Place) -> tuple[float, float]:
            """Where a place of the scene is in the picture."""
            cos, sin = (f(2.0 * math.atan2(view._frame.wxyz[3], view._frame.wxyz[0])) for f in (math.cos, math.sin))
            x, y = float(view._frame.position[0]), float(view._frame.position[1])
            return x + cos * point.x_m - sin * point.y_m, y + sin * point.x_m + cos * point.y_m

        ahead = Place(30.0 + math.cos(2.0), 40.0 + math.sin(2.0), 2.0)
        for option, look in (("Top", (0.0, 0.0, 50.0)), ("Follow", (-11.0, -11.0, 12.0))):
            view.choose(option)
            view.move(place, drive)
            assert shown(place) == pytest.approx((0.0, 0.0))
            assert shown(ahead) == pytest.approx((math.cos(2.0), math.sin(2.0)))
            assert view._client.camera.position == pytest.approx(look, abs=0.1)
            assert f"● {option}" in view._buttons.options
        view._choose(Look.CHASE)
        view.move(place, drive)
        assert shown(place) == pytest.approx((0.0, 0.0))
        assert shown(ahead) == pytest.approx((1.0, 0.0))
        view._choose(Look.FIT)
        view.move(place, drive)
        assert shown(Place(60.0, 50.0, 0.0)) == pytest.approx((0.0, 0.0))
        assert view._client.camera.position[2] * math.tan(view._client.camera.fov / 2) >= 30.0
        for key in (Look.FOLLOW, Look.FOLLOW):  # the second time it stays
            view._choose(key)
            view.move(place, drive)
        view.move(Place(31.0, 41.0, 2.0), drive)
        assert shown(place) == pytest.approx((0.0, 0.0))
        view.choose("<b>Elsewhere")
        assert view._wanted is Look.STAY


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_without_a_loop_the_page_is_kept_up(app: App) -> None:
    with joined(app.server) as client:
        client.send(packed(camera()))
        while not app._update_visitors():
            wait_for_answer(client)
        for tick in range(10):
            app.update(tick)
        browser = only_browser(app)
        assert "NO LOOP" in browser._showing._side_panel._banner.content
