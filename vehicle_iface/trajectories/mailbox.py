"""Trajectories set from outside the loop: from another thread, or from another process through a file.

The loop never waits for them: it takes the newest trajectory that is there.
"""

import logging
import os
import struct
import threading
import zlib
from collections import deque
from pathlib import Path

import numpy as np

from vehicle_iface import checks
from vehicle_iface.errors import TrajectoryFileError
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory

log = logging.getLogger(__name__)

LOOK_S = 0.02
"""Period of checking the file."""
MAX_POINTS = 20_000
"""Maximum number of points: the trajectory is read while the vehicle drives, which takes 3 ms of a pass."""
_ARRAYS = (
    "time_from_start_ns",
    "x_m",
    "y_m",
    "heading_rad",
    "speed_mps",
    "accel_mps2",
    "yaw_rate_radps",
    "front_wheel_angle_rad",
)
MAGIC = b"VITRAJ01"
_HEAD = struct.Struct("@8sI4x")
"""Magic and the CRC-32 of all that follows."""
_SIZES = struct.Struct("@qII")
"""Stamp, number of points, bytes of the frame's name; then the name and the arrays, in this machine's byte order."""
_MAX_BYTES = _HEAD.size + _SIZES.size + checks.FRAME_ID_BYTES + MAX_POINTS * 8 * len(_ARRAYS)


class Mailbox:
    """Holds one trajectory; a new one replaces one that was not taken yet. Safe from any thread."""

    def __init__(self) -> None:
        self._newest: deque[Trajectory] = deque(maxlen=1)  # its operations are atomic

    def put(self, trajectory: Trajectory) -> None:
        """Set the trajectory, stamped by its planner, for the loop's next pass."""
        self._newest.append(trajectory)

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:  # noqa: ARG002
        """Return the trajectory that was put since the last call, unchanged; None if there is none."""
        return self._newest.popleft() if self._newest else None

    def restart(self) -> None:
        """Do nothing: trajectories are stamped by their planner."""


class MailboxFile(Mailbox):
    """Trajectories that another process writes to a file (`publish_trajectory`). A thread reads and checks them.

    A file that is not a trajectory, or a path that cannot be read, is logged once; the last trajectory stays in force.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__()
        self._path = Path(path)
        self.refused = 0
        self._unreachable_causes: set[int | None] = set()
        self._seen: tuple[int, int] | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="posted-trajectories", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading the file."""
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stop.wait(LOOK_S):
            self._look()

    def _look(self) -> None:
        try:
            found = self._path.stat()
        except FileNotFoundError:
            return
        except OSError as error:
            self._log_unreachable(error)
            return
        version = (found.st_ino, found.st_mtime_ns)
        if version == self._seen:
            return
        self._seen = version
        try:
            self.put(fetch(self._path))
        except TrajectoryFileError as error:
            self._refuse(str(error))
        except MemoryError:
            self._refuse(f"{self._path}: no memory for its {found.st_size} bytes")

    def _refuse(self, why: str) -> None:
        self.refused += 1
        log.error("mailbox trajectory rejected: %s", why)

    def _log_unreachable(self, error: OSError) -> None:
        """Log each cause once: the thread checks fifty times a second."""
        if error.errno not in self._unreachable_causes:
            self._unreachable_causes.add(error.errno)
            log.error("trajectory mailbox %s: cannot be read: %s", self._path, error.strerror)


def publish_trajectory(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Publish `trajectory` to the loop started with `--trajectory-mailbox PATH`. The file is replaced atomically.

    `trajectory.stamp_ns` is the time of its time 0, `time.monotonic_ns()` of this machine. Raises `TrajectoryFileError`
    when it has more than `MAX_POINTS`, `OSError` when the file cannot be written.
    """
    target = Path(path)
    if len(trajectory) > MAX_POINTS:
        raise TrajectoryFileError(f"{target}: {len(trajectory)} points: a mailbox takes at most {MAX_POINTS}")
    frame = trajectory.frame_id.encode()
    body = _SIZES.pack(trajectory.stamp_ns, len(trajectory), len(frame)) + frame
    body += b"".join(getattr(trajectory, name).tobytes() for name in _ARRAYS)
    fresh = target.with_name(f".{target.name}.{os.getpid()}")
    fresh.write_bytes(_HEAD.pack(MAGIC, zlib.crc32(body)) + body)
    fresh.replace(target)


def fetch(path: str | os.PathLike[str]) -> Trajectory:
    """Read the trajectory in a mailbox file. Raises `TrajectoryFileError` naming the file and its fault."""
    try:
        with Path(path).open("rb") as file:
            if os.fstat(file.fileno()).st_size > _MAX_BYTES:
                raise TrajectoryFileError(f"{os.fspath(path)}: a mailbox takes at most {MAX_POINTS} points")
            content = memoryview(file.read())
    except OSError as error:
        raise TrajectoryFileError(f"{os.fspath(path)}: cannot be read: {error.strerror}") from error
    body = content[_HEAD.size :]
    if len(body) < _SIZES.size or _HEAD.unpack_from(content) != (MAGIC, zlib.crc32(body)):
        raise TrajectoryFileError(f"{os.fspath(path)}: not a mailbox trajectory, or damaged")
    stamp_ns, points, frame_bytes = _SIZES.unpack_from(body)
    start = _SIZES.size + frame_bytes
    if len(body) != start + points * 8 * len(_ARRAYS):
        raise TrajectoryFileError(f"{os.fspath(path)}: {len(body)} bytes do not hold {points} points")
    kinds = (np.int64, *(np.float64 for _ in _ARRAYS[1:]))
    arrays = {
        name: np.frombuffer(body, dtype=kind, count=points, offset=start + 8 * points * k)
        for k, (name, kind) in enumerate(zip(_ARRAYS, kinds, strict=True))
    }
    try:
        frame_id = bytes(body[_SIZES.size : start]).decode()
        return Trajectory(stamp_ns=stamp_ns, frame_id=frame_id, **arrays)  # type: ignore[arg-type]
    except ValueError as error:  # InvalidValueError and UnicodeDecodeError are such
        raise TrajectoryFileError(f"{os.fspath(path)}: {error}") from error
