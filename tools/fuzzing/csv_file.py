"""Trajectories as CSV files.

Law: a trajectory or `TrajectoryFileError`; what was read can be saved, and is the same when it is read again.
"""

from collections.abc import Iterator

import numpy as np

from fuzzing.engine.input_bytes import scratch, written
from vehicle_iface.errors import TrajectoryFileError
from vehicle_iface.trajectories.csv_file import OPTIONAL_COLUMNS, REQUIRED_COLUMNS, load_csv, save_csv

LENGTH = 2048
_COLUMNS = ("time_from_start_ns", *REQUIRED_COLUMNS[1:], *OPTIONAL_COLUMNS)


def run(data: bytes) -> None:
    try:
        trajectory = load_csv(written("trajectory.csv", data))
    except TrajectoryFileError:
        return
    assert len(trajectory)
    again = scratch() / "again.csv"
    save_csv(again, trajectory)
    same = load_csv(again)
    assert same.frame_id == trajectory.frame_id
    for column in _COLUMNS:
        values = getattr(trajectory, column)
        assert np.isfinite(values).all(), column
        assert np.array_equal(values, getattr(same, column)), column


def seeds() -> Iterator[bytes]:
    head = ",".join(REQUIRED_COLUMNS)
    yield f"# frame_id: odom\n{head}\n0.0,1.5,-2.0,0.1,0.0\n0.1,1.6,-2.0,0.1,1e-3\n".encode()
    yield f"{head},{','.join(OPTIONAL_COLUMNS)}\r\n0,0,0,0,0,0,0,0\r\n1.5,1,0,0,0,.5,-0.,+3E2\r\n".encode()
    yield f"\ufeff{head}\n\n# so\n0,1,1,1,1\n9000000000,1,1,1,1\n".encode()
    yield f"{head}\n0.0000000005,1,1,1,1\n1000000.0000000015,1,1,1,1\n".encode()
    yield b"time_s;x_m;y_m;heading_rad;speed_mps\n0,5;1;1;1;1\n"
    yield f"{head}\n0,nan,1,1,1\n".encode()
    yield f"{head}\n0,0,5,1,1,1\n".encode()
