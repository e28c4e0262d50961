"""What a browser has chosen: what it remembers, and what a hostile one may say."""

import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import viser
from viser import _messages as messages
from viser._gui_handles import _PlacementMixin

from vehicle_iface_viewer import browser_memory
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.app import App
from vehicle_iface_viewer.bus_table.bus_signals import BusSignals
from vehicle_iface_viewer.cameras import Camera
from vehicle_iface_viewer.panels.big_map import MAP, SCENE, BigMap
from vehicle_iface_viewer.panels.free_plot import NONE, FreePlot
from vehicle_iface_viewer.panels.left_panel import LeftPanel
from vehicle_iface_viewer.panels.map_drawing import MapDrawing
from vehicle_iface_viewer.panels.plot_time import PlotTime
from vehicle_iface_viewer.recent import RecentSnapshots
from vehicle_iface_viewer.settings import AS_BROWSER, Settings

from .test_access import camera, joined, packed, wait_for_answer

Answer = Callable[[Mapping[str, str]], None]
USUAL = {
    "theme": AS_BROWSER,
    "plots": "20 s",
    "free": "latency, ms",
    "and": NONE,
    "camera": "Follow",
    "picture": "",
    "filter": "",
}


@pytest.fixture
def client(tmp_path: Path) -> Iterator[viser.ClientHandle]:
    app = App(Access(port=0), str(tmp_path / "loop"))
    with joined(app.server) as browser:
        browser.send(packed(camera()))
        while not app.server.get_clients():
            wait_for_answer(browser)
        (found,) = app.server.get_clients().values()
        yield found
    app.close()


class Browser:
    """Settings of a browser, and what it was told to remember."""

    def __init__(self, client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch) -> None:
        self.answers: list[Answer] = []
        self.remembered: list[dict[str, str]] = []
        self.opened: list[str] = []
        self.widths: dict[str, float] = {}
        monkeypatch.setattr(browser_memory, "ask", lambda _, __, on_answer: self.answers.append(on_answer))
        monkeypatch.setattr(browser_memory, "remember", lambda _, values: self.remembered.append(dict(values)))
        monkeypatch.setattr(browser_memory, "keep_layout", lambda _, __, tab: self.opened.append(tab))
        monkeypatch.setattr(
            _PlacementMixin, "set_width", lambda panel, px: self.widths.update({panel._placement_uuid: px})
        )
        self.camera, self.big_map, self.left_panel = Camera(client), BigMap(client), LeftPanel(client, has_frames=True)
        self.time = PlotTime(client, is_live=True)
        self.plot = FreePlot(client, RecentSnapshots(length_s=10.0), BusSignals())
        self.settings = Settings(client, self.camera, self.big_map, self.left_panel, self.time, self.plot)
        self.widths.clear()

    def answer(self, **values: str) -> None:
        self.answers[0](values)
        self.settings.keep()


@pytest.fixture
def browser(client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch) -> Browser:
    return Browser(client, monkeypatch)


def test_what_the_browser_says_is_chosen_and_shown_in_its_controls(browser: Browser) -> None:
    browser.answer(theme="light", plots="120 s", free="drops", **{"and": "speed, m/s"})
    assert (browser.settings._is_dark, browser.settings._box.value) == (False, "light")
    assert (browser.time.window_s, browser.time._windows.value) == (120.0, "120 s")
    assert browser.plot.names == ("drops", "speed, m/s")
    assert [box.value for box in browser.plot._boxes] == ["drops", "speed, m/s"]
    assert browser.remembered == []


def test_the_layout_is_as_it_was_left(browser: Browser, client: viser.ClientHandle) -> None:
    browser.answer(camera="Top", filter="yaw", tab="Events", left="411", right="622")
    assert browser.camera.chosen == "Top"
    assert (browser.left_panel.search, browser.left_panel._box.value) == ("yaw", "yaw")
    assert browser.opened == ["Events"]
    left, right = browser.left_panel.panel, client.gui.main_panel
    assert browser.widths == {left._placement_uuid: 411, right._placement_uuid: 622}
    assert browser.remembered == []


@pytest.mark.parametrize(
    ("answer", "has_map", "has_scene"),
    [
        ({"draws": "software"}, True, False),
        ({"draws": "software", "picture": SCENE}, False, True),
        ({"draws": "gpu"}, False, True),
        ({"draws": "gpu", "picture": MAP}, True, False),
        ({"draws": "<b>", "picture": "<b>"}, False, True),
    ],
)
def test_without_a_gpu_the_map_is_shown_unless_the_user_has_chosen(
    browser: Browser, answer: dict[str, str], *, has_map: bool, has_scene: bool
) -> None:
    shown = browser.big_map
    shown.show(MapDrawing())
    assert (shown.is_shown, shown.draws_scene) == (False, False)  # it is not known yet
    browser.answer(**answer)
    shown.show(MapDrawing())
    assert (shown.is_shown, shown.draws_scene) == (has_map, has_scene)
    assert ('id="big-map"' in shown._html.content) is has_map
    assert ("without a GPU" in shown._html.content) is (has_map and answer["draws"] == "software")
    assert f"● {MAP if has_map else SCENE}" in shown._buttons.options
    shown.choose(f"● {SCENE}")
    browser.settings.keep()
    assert shown.draws_scene
    assert browser.remembered == ([] if answer.get("picture") == SCENE else [USUAL | {"picture": SCENE}])


def test_a_browser_that_says_nothing_is_taken_to_have_a_gpu(browser: Browser) -> None:
    for _ in range(50):
        assert not browser.big_map.draws_scene
        browser.big_map.show(MapDrawing())
    assert browser.big_map.draws_scene


@pytest.mark.parametrize("width", ["199", "1201", "-300", "3e2", "99999999999", "", "³⁰⁰", "NaN"])
def test_a_width_that_cannot_be_is_ignored(browser: Browser, width: str) -> None:
    browser.answer(left=width, right=width, camera="Sideways", filter="x" * 500)
    assert browser.widths == {}
    assert browser.camera.chosen == "Follow"
    assert len(browser.left_panel.search) == 40


def test_what_does_not_exist_is_ignored(browser: Browser) -> None:
    browser.answer(theme="<b>", plots="-1 s", free=NONE, prefers="x", **{"and": "../../etc"})
    assert browser.settings._is_dark
    assert (browser.time.window, browser.plot.names) == ("20 s", ("latency, ms", NONE))
    assert browser.plot.wanted == ("latency, ms", "../../etc")  # remembered: it may be a signal of another day
    assert browser.remembered == []


@pytest.mark.parametrize(
    ("theme", "prefers", "is_dark"),
    [(AS_BROWSER, "light", False), (AS_BROWSER, "dark", True), ("dark", "light", True), ("light", "dark", False)],
)
def test_the_theme_is_the_browsers_unless_one_is_chosen(
    browser: Browser, theme: str, prefers: str, is_dark: bool
) -> None:
    browser.answer(theme=theme, prefers=prefers)
    assert browser.settings._is_dark == is_dark


def test_a_choice_is_remembered_once_and_only_after_the_browser_has_answered(browser: Browser) -> None:
    browser.plot.choose(0, "drops")
    browser.settings.keep()
    assert browser.remembered == []
    browser.answer()
    browser.time.choose_window("30 s")
    for _ in range(2):
        browser.settings.keep()
    assert browser.remembered == [USUAL | {"plots": "30 s", "free": "drops"}]


def test_only_a_short_answer_to_the_question_is_taken(
    client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[Mapping[str, str]] = []
    monkeypatch.setattr(uuid, "uuid4", lambda: "7")
    browser_memory.ask(client, ("theme",), found.append)
    message = messages.LocalStorageGetItemResponseMessage
    receive: Any
    (receive,) = client._websock_connection._incoming_handlers[message]
    receive(1, message(request_uuid="8", value="theme=light", error=None))
    assert found == []
    receive(1, message(request_uuid="7", value="theme=light&token=secret&prefers=dark", error=None))
    assert found == [{"theme": "light", "prefers": "dark"}]
    for value in ("theme=" + "x" * 2000, None):
        browser_memory.ask(client, ("theme",), found.append)
        (receive,) = client._websock_connection._incoming_handlers[message]
        receive(1, message(request_uuid="7", value=value, error=None))
    assert len(found) == 1
