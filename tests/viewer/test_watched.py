"""A drive is read once, whoever watches."""

from pathlib import Path

from vehicle_iface import clock
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryWriter
from vehicle_iface_viewer.feed import LiveTelemetry
from vehicle_iface_viewer.watched import Watched

INFO = SessionInfo(channel="vcan0", bus="SocketCAN vcan0")


def test_the_way_of_a_run_is_kept_and_that_of_the_next_one_begins_anew(tmp_path: Path) -> None:
    address = str(tmp_path / "loop")
    watched = Watched(LiveTelemetry(address))
    for x_m in (0.0, 100.0):
        with TelemetryWriter(address, INFO) as writer:
            for k in range(12):
                now_ns = clock.monotonic_ns()
                writer.publish(Snapshot(now_ns, 3, 0, has_state=True, stamp_ns=now_ns, x_m=x_m + k))
                view = watched.update(now_ns, k)
        assert watched.journey.track.positions_m()[:, 0].tolist() == [x_m + k for k in range(12)]
        assert watched.map.picture
        assert view.snapshot is not None
        assert watched.view is view
    watched.close()
