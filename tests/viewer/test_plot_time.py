"""The time of one browser's plots: paused, back, and how it is said."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import viser

from vehicle_iface import Reason
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import Snapshot
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.app import App
from vehicle_iface_viewer.panels.plot_time import PlotTime
from vehicle_iface_viewer.recent import RecentSnapshots

from .test_access import camera, joined, packed, wait_for_answer


@pytest.fixture
def app(tmp_path: Path) -> Iterator[App]:
    opened = App(Access(port=0), str(tmp_path / "loop"))
    yield opened
    opened.close()


@pytest.fixture
def recent() -> RecentSnapshots:
    kept = RecentSnapshots(length_s=60.0)
    kept.extend(
        Snapshot(
            k * NS_PER_S // 10,
            ControllerState.ENGAGED if k < 200 else ControllerState.FAULT,
            Reason.NOMINAL if k < 200 else Reason.DEVIATION,
            has_state=True,
            speed_mps=k / 10,
        )
        for k in range(1, 301)
    )
    return kept


@pytest.fixture
def client(app: App) -> Iterator[viser.ClientHandle]:
    with joined(app.server) as browser:
        browser.send(packed(camera()))
        while not app.server.get_clients():
            wait_for_answer(browser)
        (found,) = app.server.get_clients().values()
        yield found


def test_the_present_is_shown_without_a_note(client: viser.ClientHandle, recent: RecentSnapshots) -> None:
    time = PlotTime(client, is_live=True)
    time.show(recent)
    assert time.end_ns(recent.newest_ns) == recent.newest_ns
    assert time._note.content == ""


def test_a_pause_stays_where_it_began_and_ends_in_the_present(client: viser.ClientHandle) -> None:
    time = PlotTime(client, is_live=True)
    time._set_pause(True)
    assert time.end_ns(5 * NS_PER_S) == time.end_ns(9 * NS_PER_S) == 5 * NS_PER_S
    time._set_back(2.0)
    assert time.end_ns(9 * NS_PER_S) == 3 * NS_PER_S
    time._set_back(0.0)
    time._set_pause(False)
    assert time.end_ns(9 * NS_PER_S) == 9 * NS_PER_S


def test_the_past_is_named_with_what_was_known_then(client: viser.ClientHandle, recent: RecentSnapshots) -> None:
    time = PlotTime(client, is_live=True)
    time._set_back(12.5)
    time.show(recent)
    assert "PLOTS END 12.5 s AGO" in time._note.content
    assert "ENGAGED · NOMINAL · speed 17.50 m/s" in time._note.content
    time._set_back(1.0)
    time.show(recent)
    assert "FAULT · DEVIATION · speed 29.00 m/s" in time._note.content
    time._set_back(600.0)
    time.show(recent)
    assert "nothing is kept of that time" in time._note.content
    time._set_back(0.0)
    time.show(recent)
    assert time._note.content == ""


def test_both_strips_show_how_far_back_the_plots_end(client: viser.ClientHandle) -> None:
    time = PlotTime(client, is_live=True)
    recent, long = time._sliders
    time._set_back(12.0, moved=recent)
    assert (long.value, time.end_ns(20 * NS_PER_S)) == (-12.0, 8 * NS_PER_S)
    time._set_back(400.0, moved=long)
    assert recent.value == -30.0
    time._set_back(0.0, moved=long)
    assert recent.value == 0.0


def test_a_recording_has_no_second_pause(client: viser.ClientHandle) -> None:
    before = len(client.gui._gui_input_handle_from_uuid)
    PlotTime(client, is_live=False)
    assert len(client.gui._gui_input_handle_from_uuid) == before + 1


def test_only_windows_of_the_list_are_taken(client: viser.ClientHandle) -> None:
    time = PlotTime(client, is_live=True)
    for name, window_s in (("120 s", 120.0), ("7 s", 120.0), ("10 s", 10.0)):
        time._set_window(name)
        assert time.window_s == window_s
