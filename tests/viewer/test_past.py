"""The time that one browser looks back to: what is known of it, and what the picture shows."""

from collections.abc import Iterator

import numpy as np
import pytest
import viser

from tests.narrowing import at_present
from vehicle_iface.telemetry import DrawnTrajectory, Snapshot, WriterState
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.journey import Journey
from vehicle_iface_viewer.past import Past, view_at
from vehicle_iface_viewer.recent import RecentSnapshots
from vehicle_iface_viewer.serving import open_server

PERIOD_NS = NS_PER_S // 20
COUNT = 400


def snapshot(k: int) -> Snapshot:
    return Snapshot(
        (k + 1) * PERIOD_NS,
        3,
        0,
        has_state=True,
        stamp_ns=k * PERIOD_NS,
        x_m=0.5 * k,
        has_reference=True,
        spatial_reference_x_m=0.5 * k,
        spatial_reference_y_m=1.0,
        trajectory_version=1 + (k >= 200),
        frame_id="map",
        sequence=k + 1,
    )


@pytest.fixture
def recent() -> RecentSnapshots:
    kept = RecentSnapshots(length_s=60.0)
    kept.extend(map(snapshot, range(COUNT)))
    return kept


@pytest.fixture
def present() -> View:
    two = np.zeros(2)
    columns = dict.fromkeys(("x_m", "y_m", "heading_rad", "speed_mps", "time_s"), two)
    path = DrawnTrajectory(version=2, stamp_ns=0, frame_id="map", original_count=2, **columns)
    newest = snapshot(COUNT - 1)
    return View(
        now_ns=newest.published_ns,
        address="a",
        writer_state=WriterState.DEAD,
        session=7,
        snapshot=newest,
        trajectory=path,
    )


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    opened = open_server(Access(port=0))
    yield opened
    opened.stop()


def test_the_past_is_what_was_published_then(recent: RecentSnapshots, present: View) -> None:
    past = view_at(present, recent, snapshot(300).published_ns + 1)
    assert past.snapshot == snapshot(300)._replace(sequence=past.snapshot.sequence if past.snapshot else 0)
    assert (past.trajectory, past.is_stale) == (present.trajectory, False)
    assert view_at(present, recent, snapshot(100).published_ns).trajectory is None
    assert view_at(present, recent, -NS_PER_S).snapshot is None


def test_the_picture_of_the_past_moves_with_the_slider(
    server: viser.ViserServer, recent: RecentSnapshots, present: View
) -> None:
    # The scene of a server has the same nodes as that of a browser.
    past = Past(server, Journey())
    for k in (300, 100, 101):
        past.update(present, recent, snapshot(k).published_ns, 4)
        frame = past._scene._vehicle._frame
        assert at_present(frame.visible)
        assert past.place is not None
        assert past.place.x_m == pytest.approx(frame.position[0])
        assert past._scene._guides._error.points[0, 0, :2].tolist() == [0.0, 1.0]
        trail = past._scene._trail._line.points[:, :, 0]
        assert trail.max() <= past.place.x_m + 0.01
        assert trail.max() - trail.min() > 40.0  # the minute before it, at once
    assert past.map.picture
    past.update(present, recent, -NS_PER_S, 4)
    assert not at_present(frame.visible)
