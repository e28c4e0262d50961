"""What the page receives: the newest, how old it is, and how fast it comes."""

from collections.abc import Iterator

import numpy as np
import pytest

from vehicle_iface import Trajectory
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryWriter, WriterState
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails
from vehicle_iface.telemetry.events import EventKind, LoopEvent
from vehicle_iface.units import NS_PER_MS, NS_PER_S
from vehicle_iface_viewer.feed import Feed, LiveTelemetry

INFO = SessionInfo(channel="vcan0", bus="SocketCAN vcan0")
ZEROS = np.zeros(3)
PATH = Trajectory(stamp_ns=0, time_from_start_ns=np.arange(3), x_m=ZEROS, y_m=ZEROS, heading_rad=ZEROS, speed_mps=ZEROS)


def counted(samples: int) -> LiveDetails:
    return LiveDetails(link=LinkDetails(state="UP"), loop={"samples": samples})


@pytest.fixture
def writer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TelemetryWriter]:
    with TelemetryWriter(str(tmp_path_factory.mktemp("feed") / "loop"), INFO) as opened:
        yield opened


@pytest.fixture
def feed(writer: TelemetryWriter) -> Iterator[Feed]:
    with LiveTelemetry(writer.address) as reader:
        yield Feed(reader)


def test_without_a_loop_the_view_reports_it(tmp_path_factory: pytest.TempPathFactory) -> None:
    with LiveTelemetry(str(tmp_path_factory.mktemp("feed") / "loop")) as reader:
        view = Feed(reader).read(5)
    assert (view.writer_state, view.snapshot, view.is_stale) == (WriterState.ABSENT, None, True)


def test_rates_are_counts_over_the_time_between(writer: TelemetryWriter, feed: Feed) -> None:
    for k in range(200):
        now_ns = k * 10 * NS_PER_MS
        writer.publish(Snapshot(now_ns, 3, 0, samples=k, commands=k // 2))
        view = feed.read(now_ns)
    assert view.sample_rate_hz == pytest.approx(100.0)
    assert view.command_rate_hz == pytest.approx(50.0, abs=1.0)


def test_data_grows_old_and_keeps_being_shown(writer: TelemetryWriter, feed: Feed) -> None:
    writer.publish(Snapshot(NS_PER_S, 3, 0, has_state=True, stamp_ns=NS_PER_S - 7 * NS_PER_MS, samples=1))
    young, old = feed.read(NS_PER_S), feed.read(NS_PER_S + 1200 * NS_PER_MS)
    assert (young.is_stale, old.is_stale) == (False, True)
    assert old.data_age_s == pytest.approx(1.2)
    assert old.state_age_s == pytest.approx(1.207)
    assert old.snapshot == young.snapshot
    assert old.sample_rate_hz is None


def test_a_snapshot_newer_than_the_pages_clock_reading_has_age_zero(writer: TelemetryWriter, feed: Feed) -> None:
    writer.publish(Snapshot(NS_PER_S, 3, 0, has_state=True, stamp_ns=NS_PER_S - 7 * NS_PER_MS, samples=1))
    view = feed.read(NS_PER_S - 8 * NS_PER_MS)
    assert (view.data_age_s, view.state_age_s) == (0.0, 0.007)


def test_the_trajectory_is_that_of_the_snapshot(writer: TelemetryWriter, feed: Feed) -> None:
    writer.publish(Snapshot(1, 3, 0))
    assert feed.read(1).trajectory is None
    version = writer.publish_trajectory(PATH)
    writer.publish(Snapshot(2, 3, 0, trajectory_version=version))
    first = feed.read(2).trajectory
    assert first is not None
    assert first.version == version
    assert feed.read(3).trajectory is first


def test_a_new_session_starts_afresh(writer: TelemetryWriter, feed: Feed) -> None:
    writer.publish(Snapshot(1, 3, 0, trajectory_version=writer.publish_trajectory(PATH)))
    first = feed.read(1)
    writer.close()
    assert feed.read(2).writer_state is WriterState.ENDED
    assert feed.read(2).snapshot == first.snapshot
    with TelemetryWriter(writer.address, INFO) as successor:
        again = feed.read(3)
        assert (again.writer_state, again.snapshot, again.trajectory) == (WriterState.LIVE, None, None)
        assert again.session != first.session
        successor.publish(Snapshot(4, 1, 0))
        assert feed.read(4).snapshot == Snapshot(4, 1, 0, sequence=1)


def test_details_are_read_now_and_then(writer: TelemetryWriter, feed: Feed) -> None:
    writer.publish_details(counted(1))
    assert feed.read(0).details == counted(1)
    writer.publish_details(counted(2))
    assert feed.read(1).details == counted(1)
    assert feed.read(NS_PER_S).details == counted(2)


def test_a_viewer_that_is_started_late_has_the_last_seconds(writer: TelemetryWriter, feed: Feed) -> None:
    for k in range(1, 701):
        writer.publish(Snapshot(k * 10 * NS_PER_MS, 3, 0, speed_mps=k / 10))
    feed.read(7 * NS_PER_S)
    rows = feed.recent.between(0, 8 * NS_PER_S)
    assert rows["speed_mps"].tolist() == [k / 10 for k in range(700 - 511, 701)]


def test_every_snapshot_is_kept_once_and_a_new_session_begins_with_none(writer: TelemetryWriter, feed: Feed) -> None:
    for k in range(1, 31):
        writer.publish(Snapshot(k * 10 * NS_PER_MS, 3, 0, speed_mps=k / 10))
        if k % 3 == 0:
            feed.read(k * 10 * NS_PER_MS)
    assert len(feed.recent.between(0, NS_PER_S)) == 30
    writer.close()
    with TelemetryWriter(writer.address, INFO) as successor:
        successor.publish(Snapshot(2 * NS_PER_S, 1, 0))
        feed.read(2 * NS_PER_S)
        assert len(feed.recent.between(0, 3 * NS_PER_S)) == 1


def test_events_are_kept_once_in_their_order_and_those_of_a_session_only(writer: TelemetryWriter, feed: Feed) -> None:
    events = [LoopEvent(number=k, at_ns=k, kind=EventKind.REQUEST, name=f"request {k}") for k in range(1, 6)]
    for k, event in enumerate(events):
        writer.publish_event(event)
        feed.read(k * NS_PER_S)
    assert list(feed.events) == events
    writer.close()
    with TelemetryWriter(writer.address, INFO) as successor:
        feed.read(10 * NS_PER_S)
        assert list(feed.events) == []
        successor.publish_event(events[0])
        feed.read(20 * NS_PER_S)
        assert list(feed.events) == events[:1]
