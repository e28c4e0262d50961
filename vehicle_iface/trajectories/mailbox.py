"""Trajectories set from outside the loop: from another thread, or from another process through a file.

The loop never waits for either: it takes what is there, the newest only.
"""

import logging
import os
import threading
import zipfile
import zlib
from collections import deque
from pathlib import Path

import numpy as np

from vehicle_iface.errors import InvalidValueError, TrajectoryFileError
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory

log = logging.getLogger(__name__)

LOOK_S = 0.02
"""How often the file is looked at."""
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
_NO_TRAJECTORY = (
    OSError,
    EOFError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    NotImplementedError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What NumPy raises for files that are not its own."""


class Mailbox:
    """Room for one trajectory; the newest replaces one that was not taken yet. Safe from any thread."""

    def __init__(self) -> None:
        self._newest: deque[Trajectory] = deque(maxlen=1)  # its operations are atomic

    def put(self, trajectory: Trajectory) -> None:
        """Leave a trajectory, stamped by whoever made it, for the loop's next pass."""
        self._newest.append(trajectory)

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:  # noqa: ARG002
        """What was put since the last call, as it is; None when nothing was."""
        return self._newest.popleft() if self._newest else None

    def restart(self) -> None:
        """Nothing to begin anew: whoever puts trajectories stamps them."""


class PostedTrajectories(Mailbox):
    """Trajectories that another process posts to a file (`post`). A thread reads and checks them.

    A file that is no trajectory is reported once and leaves the last one in force, and so does a path that
    cannot be looked at.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__()
        self._path = Path(path)
        self.refused = 0
        self.unreachable = 0
        """Looks at the path that failed; that nobody has posted yet is no failure."""
        self._unreachable_causes: set[int | None] = set()
        self._seen: tuple[int, int] | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="posted-trajectories", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop looking."""
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
            self._note_unreachable(error)
            return
        version = (found.st_ino, found.st_mtime_ns)
        if version == self._seen:
            return
        self._seen = version
        try:
            self.put(fetch(self._path))
        except TrajectoryFileError as error:
            self.refused += 1
            log.error("posted trajectory refused: %s", error)

    def _note_unreachable(self, error: OSError) -> None:
        """Count it, and say each cause once: the thread looks fifty times a second."""
        self.unreachable += 1
        if error.errno not in self._unreachable_causes:
            self._unreachable_causes.add(error.errno)
            log.error("posted trajectories: %s cannot be looked at: %s", self._path, error.strerror)


def post(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Give `trajectory` to the loop that was started with `--trajectory-post PATH`; whole or not at all."""
    target = Path(path)
    fresh = target.with_name(f".{target.name}.{os.getpid()}")
    with fresh.open("wb") as file:
        np.savez(
            file,
            stamp_ns=np.int64(trajectory.stamp_ns),
            frame_id=np.str_(trajectory.frame_id),
            **{name: getattr(trajectory, name) for name in _ARRAYS},
        )
    fresh.replace(target)


def fetch(path: str | os.PathLike[str]) -> Trajectory:
    """The trajectory in a posted file; `TrajectoryFileError` naming the file and what is wrong in it."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as content:
            return Trajectory(
                stamp_ns=int(content["stamp_ns"]),
                frame_id=str(content["frame_id"]),
                **{name: content[name] for name in _ARRAYS},
            )
    except _NO_TRAJECTORY as error:
        what = f"{error}" if isinstance(error, InvalidValueError) else f"not a posted trajectory ({error})"
        raise TrajectoryFileError(f"{os.fspath(path)}: {what}") from error
