"""Files that another process posts trajectories in.

An even first byte: the rest is the file; an odd one: the rest is its body, and the head fits it.
Law: a trajectory, finite and in order, or `TrajectoryFileError`.
"""

import struct
import zlib
from collections.abc import Iterator

import numpy as np

from fuzzing.engine.input_bytes import scratch, written
from vehicle_iface import Trajectory
from vehicle_iface.errors import TrajectoryFileError
from vehicle_iface.trajectories.mailbox import MAGIC, fetch, publish_trajectory

LENGTH = 1024
_HEAD = struct.Struct("@8sI4x")


def run(data: bytes) -> None:
    content = data[1:]
    if data[:1] and data[0] & 1:
        content = _HEAD.pack(MAGIC, zlib.crc32(content)) + content
    try:
        trajectory = fetch(written("posted", content))
    except TrajectoryFileError:
        return
    assert (np.diff(trajectory.time_from_start_ns) >= 0).all()
    for name in ("x_m", "y_m", "heading_rad", "speed_mps", "accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad"):
        assert np.isfinite(getattr(trajectory, name)).all(), name


def seeds() -> Iterator[bytes]:
    for count in (0, 1, 3):
        number = np.arange(count, dtype=np.float64)
        trajectory = Trajectory(
            stamp_ns=7,
            frame_id="map",
            time_from_start_ns=np.arange(count),
            x_m=number,
            y_m=number,
            heading_rad=number,
            speed_mps=number,
        )
        path = scratch() / "seed"
        publish_trajectory(path, trajectory)
        content = path.read_bytes()
        yield b"\0" + content
        yield b"\x01" + content[_HEAD.size :]
