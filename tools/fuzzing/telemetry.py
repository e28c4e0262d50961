"""Telemetry files, as the viewer and the recorder find them.

Law: nothing in the file makes the reader raise, and what it gives has the types that it says.
"""

from fuzzing.engine import tampered
from vehicle_iface.telemetry import DrawnTrajectory, Snapshot, TelemetryReader, WriterState
from vehicle_iface.telemetry.details import LiveDetails

LENGTH = 1024
seeds = tampered.seeds


def run(data: bytes) -> None:
    with TelemetryReader(str(tampered.tampered(data))) as reader:
        for _ in range(2):
            assert isinstance(reader.poll(), WriterState)
            newest = reader.newest()
            assert newest is None or isinstance(newest, Snapshot)
            since = [snapshot.sequence for snapshot in reader.since(0)]
            assert since == sorted(since)
            assert isinstance(reader.details(), LiveDetails | None)
            for version in (0, 1, newest.trajectory_version if newest is not None else 2):
                drawn = reader.trajectory(version)
                assert drawn is None or isinstance(drawn, DrawnTrajectory)
        assert reader.dropped >= 0
