"""A recording answers as the loop's telemetry did at that instant."""

import json
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from viser import _messages
from websockets.sync.connection import Connection

from vehicle_iface.errors import ConfigError
from vehicle_iface.recorder import files
from vehicle_iface.telemetry import DrawnTrajectory, SessionInfo, Snapshot, WriterState
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.units import NS_PER_MS, NS_PER_S
from vehicle_iface_viewer.__main__ import main
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.app import App
from vehicle_iface_viewer.browser import ReplayBrowser
from vehicle_iface_viewer.feed import Feed
from vehicle_iface_viewer.host import Replays
from vehicle_iface_viewer.playback import Playback

from .test_access import camera, joined, packed, wait_for_answer, wait_until_closed

BEGIN_NS = 10**12
COUNT = 500
META = files.Meta(
    format=files.FORMAT,
    session=SessionInfo(channel="vcan0", bus="SocketCAN vcan0", route="figure8", recording="/somewhere"),
    wall_ns=1_795_331_353 * NS_PER_S,
    monotonic_ns=BEGIN_NS,
    frames="SocketCAN vcan0",
    command_line=[],
    versions={},
    sha256={},
)


def counted(samples: int) -> LiveDetails:
    return LiveDetails(link=LinkDetails(state="UP"), loop={"samples": samples})


def at_ns(number: int) -> int:
    """When the snapshot of that number was published: one each 10 ms, from 0 on."""
    return BEGIN_NS + number * 10 * NS_PER_MS


def snapshot(number: int) -> Snapshot:
    return Snapshot(
        at_ns(number),
        3,
        0,
        has_state=True,
        stamp_ns=at_ns(number) - NS_PER_MS,
        x_m=number / 10.0,
        samples=number,
        trajectory_version=1 + number // 10,
        sequence=number + 1,
    )


def path(version: int) -> DrawnTrajectory:
    two = np.array([0.0, float(version)])
    columns = dict.fromkeys(("x_m", "y_m", "heading_rad", "speed_mps", "time_s"), two)
    return DrawnTrajectory(version=version, stamp_ns=0, frame_id="map", original_count=2, **columns)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Five seconds; trajectory 3 and the snapshots from 200 to 219 were lost."""
    (tmp_path / files.META).write_bytes(msgspec.json.encode(META))
    rows = [files.format_snapshot(snapshot(k)) for k in range(COUNT) if not 200 <= k < 220]
    (tmp_path / files.SNAPSHOTS).write_bytes(files.SNAPSHOT_HEADER + b"".join(rows))
    paths = [files.format_trajectory(path(version)) for version in range(1, 51) if version != 3]
    (tmp_path / files.TRAJECTORIES).write_bytes(b"".join(paths))
    counters = [files.format_counters(at_ns(50 * k), counted(k)) for k in range(10)]
    (tmp_path / files.COUNTERS).write_bytes(b"".join(counters))
    return tmp_path


@pytest.fixture
def recording(folder: Path) -> Iterator[Playback]:
    opened = Playback(str(folder))
    yield opened
    opened.close()


def test_at_its_own_speed_it_shows_what_was_at_that_instant(recording: Playback) -> None:
    for number in (0, 1, 7, 100, 199, 230, COUNT - 1):
        assert recording.advance(number * 10 * NS_PER_MS) == at_ns(number)
        assert recording.newest() == snapshot(number)._replace(sequence=number + 1)


def test_between_two_snapshots_and_where_some_are_lost_the_one_before_is_shown(recording: Playback) -> None:
    recording.advance(0)
    recording.advance(1055 * NS_PER_MS)
    assert recording.newest() == snapshot(105)
    recording.advance(2150 * NS_PER_MS)
    assert recording.newest() == snapshot(199)


def test_the_snapshots_between_two_times_are_all_that_were_not_lost(recording: Playback) -> None:
    found = recording.between(at_ns(195), at_ns(222))
    assert [each.published_ns for each in found] == [at_ns(k) for k in (196, 197, 198, 199, 220, 221, 222)]
    assert recording.between(at_ns(50), at_ns(50)) == []


def test_a_sample_of_the_drive_has_its_first_and_its_last_snapshot(recording: Playback) -> None:
    for count in (10, 400, 10_000):
        found = [each.published_ns for each in recording.sample(count)]
        assert (found[0], found[-1]) == (at_ns(0), at_ns(COUNT - 1))
        assert found == sorted(set(found))
        assert len(found) <= 2 * count + 1
    assert len(found) == COUNT - 20


def test_after_a_jump_while_paused_the_rates_are_those_of_the_second_before(recording: Playback) -> None:
    feed = Feed(recording)
    feed.read(recording.advance(0))
    recording.is_paused = True
    recording.seek(3.5)
    view = feed.read(recording.advance(1))
    assert view.sample_rate_hz == pytest.approx(100.0)


def event(number: int, at_s: float, kind: EventKind, phase: Phase = Phase.ONCE) -> LoopEvent:
    return LoopEvent(number=number, at_ns=at_ns(round(at_s * 100)), kind=kind, name="name", phase=phase)


EVENTS = [
    event(1, 0.5, EventKind.MODE),
    event(2, 2.0, EventKind.STOP, Phase.BEGAN),
    event(3, 2.5, EventKind.STOP, Phase.ENDED),
    event(5, 4.0, EventKind.STOP, Phase.BEGAN),
]


@pytest.fixture
def eventful(folder: Path) -> Iterator[Playback]:
    """Four events and a damaged line."""
    lines = [files.format_event(each) for each in EVENTS]
    (folder / files.EVENTS).write_bytes(b"".join([*lines[:2], b"{damaged\n", *lines[2:]]))
    opened = Playback(str(folder))
    yield opened
    opened.close()


def test_events_are_those_up_to_the_time_that_is_shown(recording: Playback, eventful: Playback) -> None:
    eventful.advance(0)
    assert eventful.events() == []
    eventful.advance(round(2.2 * NS_PER_S))
    assert eventful.events() == EVENTS[:2]
    assert eventful.events(1) == EVENTS[1:2]
    eventful.advance(9 * NS_PER_S)
    assert eventful.events(2) == EVENTS[2:]
    assert recording.events() == []
    feed = Feed(eventful)
    feed.read(eventful.advance(10 * NS_PER_S))
    assert list(feed.events) == EVENTS
    eventful.seek(1.0)
    feed.read(eventful.advance(11 * NS_PER_S))
    assert list(feed.events) == EVENTS[:1]


def test_a_jump_to_a_stop_shows_the_second_before_it(recording: Playback, eventful: Playback) -> None:
    eventful.is_paused = True
    places = []
    for step in (1, 1, 1, -1, -1):
        eventful.seek_event(step, stops_only=True)
        eventful.advance(0)
        places.append(round(eventful.at_s, 2))
    assert places == [1.0, 3.0, 3.0, 1.0, 1.0]
    eventful.seek_event(-1)
    eventful.advance(0)
    assert eventful.at_s == 0.0
    for at_s in (1.0, 3.0):  # the end of the stop is no event of its own
        eventful.seek_event(1)
        eventful.advance(0)
        assert eventful.at_s == pytest.approx(at_s)
    recording.seek_event(1)
    recording.advance(0)
    assert recording.session == 1


def test_steps_add_up_also_before_they_are_shown(recording: Playback) -> None:
    recording.is_paused = True
    places = []
    for steps in ((0.1, 0.1), (-0.1,), (-5.0,), (9.0, -0.1)):
        for step_s in steps:
            recording.step(step_s)
        recording.advance(0)
        places.append(round(recording.at_s, 3))
    assert places == [0.2, 0.1, 0.0, round(recording.length_s - 0.1, 3)]


def test_playback_stays_at_its_end_and_shows_it(recording: Playback) -> None:
    recording.advance(0)
    assert recording.advance(10 * NS_PER_S) == at_ns(COUNT - 1)
    assert recording.description.startswith("5.0 s of 5.0 s · at its end · recorded on 2026-11-22 at ")


def test_speed_and_pause(recording: Playback) -> None:
    recording.speed = 2.0
    recording.advance(0)
    recording.advance(NS_PER_S)
    assert recording.at_s == pytest.approx(2.0)
    recording.is_paused = True
    recording.advance(2 * NS_PER_S)
    assert recording.at_s == pytest.approx(2.0)
    assert "paused" in recording.description
    recording.is_paused = False
    recording.advance(3 * NS_PER_S)
    assert recording.at_s == pytest.approx(4.0)


def test_a_jump_is_a_new_session_so_that_nothing_of_another_time_stays_drawn(recording: Playback) -> None:
    feed = Feed(recording)
    recording.advance(0)
    first = feed.read(recording.advance(4 * NS_PER_S))
    recording.seek(1.0)
    second = feed.read(recording.advance(4 * NS_PER_S))
    assert first.session != second.session
    assert second.snapshot == snapshot(100)
    assert second.details == counted(2)
    assert second.trajectory is not None
    assert second.trajectory.version == 11


def test_the_feed_finds_everything_as_in_a_running_loop(recording: Playback) -> None:
    feed = Feed(recording)
    for tenth in range(20):
        view = feed.read(recording.advance(tenth * NS_PER_S // 10))
    assert view.writer_state is WriterState.LIVE
    assert not view.is_stale
    assert view.sample_rate_hz == pytest.approx(100.0)
    assert view.state_age_s == pytest.approx(0.001)
    assert view.details == counted(3)
    assert view.recorder is None
    assert view.trajectory is not None
    assert view.trajectory.x_m.tolist() == [0.0, 20.0]


def test_a_trajectory_that_was_lost_is_not_there(recording: Playback) -> None:
    assert recording.trajectory(3) is None
    assert recording.trajectory(0) is None
    assert recording.trajectory(51) is None
    found = recording.trajectory(4)
    assert found is not None
    assert found.version == 4


@given(cut=st.integers(0, 2000), noise=st.binary(max_size=40), place=st.integers(0, 10**6))
def test_a_truncated_or_damaged_recording_is_played_on(
    tmp_path_factory: pytest.TempPathFactory, cut: int, noise: bytes, place: int
) -> None:
    folder = tmp_path_factory.mktemp("damaged")
    (folder / files.META).write_bytes(msgspec.json.encode(META))
    for name, lines in (
        (files.SNAPSHOTS, [files.SNAPSHOT_HEADER, *(files.format_snapshot(snapshot(k)) for k in range(20))]),
        (files.TRAJECTORIES, [files.format_trajectory(path(version)) for version in (1, 2)]),
        (files.COUNTERS, [files.format_counters(at_ns(0), counted(1))]),
    ):
        whole = b"".join(lines)
        at = place % len(whole)
        (folder / name).write_bytes((whole[:at] + noise + whole[at:])[: max(0, len(whole) - cut)])
    try:
        recording = Playback(str(folder))
    except ConfigError:
        return
    feed = Feed(recording)
    for step in range(10):
        feed.read(recording.advance(step * 30 * NS_PER_MS))
        assert recording.description
    recording.close()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda folder: (folder / files.META).unlink(), "not a recording: meta.json: No such file"),
        (lambda folder: (folder / files.META).write_text("{"), "damaged"),
        (lambda folder: (folder / files.META).write_text(_other_format()), "of format 2; this version shows format 1"),
        (lambda folder: (folder / files.SNAPSHOTS).unlink(), "nothing to show"),
        (lambda folder: (folder / files.SNAPSHOTS).write_bytes(files.SNAPSHOT_HEADER + b"12"), "nothing to show"),
    ],
)
def test_a_damaged_recording_is_rejected_with_its_fault(folder: Path, change, complaint, capsys) -> None:  # type: ignore[no-untyped-def]
    change(folder)
    assert main([str(folder)]) == 2
    assert complaint in capsys.readouterr().err


def _other_format() -> str:
    return json.dumps(msgspec.to_builtins(META) | {"format": 2})


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--connect", "x"], "--connect is for a running loop"),
        (["--speed", "nan"], "--speed nan: must be within 0.1 … 10"),
        (["--speed", "11"], "--speed 11: must be within 0.1 … 10"),
        (["--from", "5.5"], "--from 5.5: must be within 0 … 5.0"),
        (["--from", "nan"], "--from nan: must be within 0 … 5.0"),
    ],
)
def test_options_that_do_not_fit_are_refused(folder: Path, arguments, complaint, capsys) -> None:  # type: ignore[no-untyped-def]
    assert main([str(folder), *arguments]) == 2
    assert complaint in capsys.readouterr().err


@pytest.fixture
def app(recording: Playback) -> Iterator[App]:
    opened = App(Access(port=0), recording)
    yield opened
    opened.close()


def host(app: App) -> Replays:
    assert isinstance(app._host, Replays)
    return app._host


def opened_browser(app: App, client: Connection, count: int = 1) -> ReplayBrowser:
    """The newest browser, when the viewer has noticed `count` of them."""
    client.send(packed(camera()))
    while len(browsers := app._update_visitors()) < count:
        wait_for_answer(client)
    assert isinstance(browsers[-1], ReplayBrowser)
    return browsers[-1]


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_its_page_shows_recording_above_everything(app: App) -> None:
    with joined(app.server) as client:
        browser = opened_browser(app, client)
        for tick in range(12):
            app.update(tick)
        banner = browser._showing._side_panel._banner.content
    assert banner.startswith('<div id="recording"')
    assert "RECORDING, NOT LIVE" in banner
    assert " s of 5.0 s" in banner


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_a_browser_may_pause_it_and_choose_place_and_speed_within_their_ranges(app: App) -> None:
    with joined(app.server) as client:
        browser = opened_browser(app, client)
        controls, playback = browser._controls, browser.playback
        pause, place, speed = (handle._impl.uuid for handle in (controls._pause, controls._time, controls._speed))
        for uuid, value in (
            *((pause, value) for value in (1, "true", None)),
            *((place, value) for value in (-1.0, 6.0, float("nan"), "2", True, None, [2.0])),
            *((speed, value) for value in (0.0, 11, "16×", "2", "x" * 1000)),
            ("another", True),
        ):
            client.send(packed(_messages.GuiUpdateMessage(uuid, {"value": value})))
        client.send(packed(_messages.GuiUpdateMessage(place, "value")))  # type: ignore[arg-type]
        client.send(b"\xc1")  # closes the connection, once all before it was read
        wait_until_closed(client)
    assert (playback.is_paused, playback.speed, playback._seek_s) == (False, 1.0, None)
    with joined(app.server) as client:
        browser = opened_browser(app, client)
        controls, playback = browser._controls, browser.playback
        pause, place, speed = (handle._impl.uuid for handle in (controls._pause, controls._time, controls._speed))
        for uuid, value in ((pause, True), (speed, "4×"), (place, 3.0)):
            client.send(packed(_messages.GuiUpdateMessage(uuid, {"value": value})))
        client.send(b"\xc1")
        wait_until_closed(client)
    browser.update(0, 1)
    assert (playback.is_paused, playback.speed) == (True, 4.0)
    assert playback.at_s == pytest.approx(3.0)
    assert controls._pause.value is True


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_each_browser_has_a_place_of_its_own_and_one_that_is_loaded_again_continues(app: App) -> None:
    with joined(app.server) as one:
        first = opened_browser(app, one)
        first.playback.is_paused = True
        with joined(app.server) as two:
            second = opened_browser(app, two, 2)
            first.playback.seek(1.0)
            second.playback.seek(4.0)
            for tick in range(8):
                app.update(tick)
            assert first.playback.at_s == 1.0
            assert second.playback.at_s >= 4.0
            for browser, words in ((first, "1.0 s of 5.0 s"), (second, "4.")):
                assert f">{words}" in browser._showing._side_panel._banner.content
        while len(app._update_visitors()) > 1:
            app.update(0)
        assert host(app).playback is second.playback
    with joined(app.server) as again:
        assert opened_browser(app, again).playback.at_s == host(app).playback.at_s


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_speeds_are_steps_from_a_quarter_to_eight(app: App) -> None:
    with joined(app.server) as client:
        controls = opened_browser(app, client)._controls
        for step, count, speed in ((1, 9, 8.0), (-1, 9, 0.25), (1, 3, 2.0)):
            for _ in range(count):
                controls._change_speed(step)
            assert controls._playback.speed == speed
        assert controls._speed.options == ("¼×", "½×", "1×", "● 2×", "4×", "8×")
        controls._set_speed(3.0)  # by an option of the command line
        controls._change_speed(-1)
        assert controls._playback.speed == 2.0
