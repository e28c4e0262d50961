"""Browsers come and go, and leave nothing behind."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.app import App

from .test_access import camera, joined, packed, wait_for_answer


@pytest.fixture
def app(tmp_path: Path) -> Iterator[App]:
    opened = App(Access(port=0), str(tmp_path / "loop"))
    yield opened
    opened.close()


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_a_browser_that_left_is_forgotten(app: App) -> None:
    for _ in range(5):
        with joined(app.server) as client:
            client.send(packed(camera()))
            while not app._update_clients():
                wait_for_answer(client)
            (follower,) = app._clients.values()
            follower.follow((1.0, 2.0))
            assert tuple(follower._frame.position) == (-1.0, -2.0, 0.0)
        while app._update_clients():
            app.update(0)
    assert app._clients == {}


def test_without_a_loop_the_page_is_kept_up(app: App) -> None:
    for tick in range(10):
        app.update(tick)
    assert "NO LOOP" in app._side_panel._banner.content
