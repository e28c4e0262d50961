"""Keeps the seconds before and after each stop: as a folder that `vehicle-iface view` opens.

The newest lines stay in memory. When the loop stops, releases the vehicle or goes silent, or is killed, the last
`BEFORE_NS` and the next `AFTER_NS` are written. The oldest black boxes are removed when all are larger than the limit.
"""

import contextlib
import os
import shutil
from collections import deque
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from vehicle_iface import clock
from vehicle_iface.recorder import files
from vehicle_iface.recorder.folder import RecordingRequest, create_folder, empty_folder
from vehicle_iface.recorder.telemetry_tap import NewLines
from vehicle_iface.telemetry import SessionInfo
from vehicle_iface.telemetry.events import EventKind, Phase
from vehicle_iface.units import NS_PER_S

BEFORE_NS, AFTER_NS = 30 * NS_PER_S, 5 * NS_PER_S
LONGEST_NS = 60 * NS_PER_S
"""A box with one stop after the other ends so long after the first of them."""
PLANNED = ("SHUTDOWN", "PAST_END_SPACE", "PAST_END_TIME")
"""Stops for these reasons end a drive, and are kept in no black box."""
KILLED = "LOOP-KILLED"
LIMIT_BYTES = 100_000_000
_FILES = {
    "snapshots": files.SNAPSHOTS,
    "trajectories": files.TRAJECTORIES,
    "counters": files.COUNTERS,
    "events": files.EVENTS,
    "frames": files.FRAMES,
}


class BlackBox:
    """Keeps lines in memory and writes a folder for each stop. A disk that is full costs the box, not the drive."""

    def __init__(
        self,
        place: Path,
        request: RecordingRequest,
        info: SessionInfo,
        notify: Callable[[str], None],
        *,
        limit_bytes: int = LIMIT_BYTES,
    ) -> None:
        """`place` is the folder of the black boxes; it is made with the first of them."""
        self._place, self._request, self._info, self._notify = place, request, info, notify
        self._limit_bytes = limit_bytes
        self._lines: dict[str, deque[tuple[int, bytes]]] = {kind: deque() for kind in _FILES}
        self._cause = ""
        self._begin_ns = self._end_ns = 0
        self._is_dead = False
        self.kept = 0
        """Number of black boxes that were written."""
        self.lost = 0
        """Number of those that could not be."""

    def add(self, lines: NewLines, frames: Sequence[bytes], now_ns: int, *, is_loop_dead: bool = False) -> None:
        """Add what has arrived; write a box that is complete."""
        fresh = {
            "snapshots": lines.snapshots,
            "trajectories": lines.trajectories,
            "counters": lines.counters,
            "events": lines.events,
            "frames": frames,
        }
        for kind, added in fresh.items():
            self._lines[kind].extend((now_ns, line) for line in added)
        for line in lines.events:
            event = files.parse_event(line.decode())
            if event is not None and event.kind is EventKind.STOP and event.phase is Phase.BEGAN:
                self._note_stop(event.name, now_ns)
        if is_loop_dead and not self._is_dead:
            self._is_dead = True
            self._note_stop(KILLED, now_ns)
        if self._cause and now_ns >= self._end_ns:
            self.finish()
        if not self._cause:
            self._forget(now_ns - BEFORE_NS)

    def finish(self) -> None:
        """Write the box that has begun, if there is one, with what has come so far."""
        if not self._cause:
            return
        self._forget(self._begin_ns - BEFORE_NS)
        try:
            folder = self._write(f"{_format_time()}-{self._cause}")
        except OSError as error:
            self.lost += 1
            self._notify(f"black box {self._place}: cannot be written: {error.strerror or error}; the drive continues")
        else:
            self.kept += 1
            self._notify(f"{self._cause}: vehicle-iface view {folder}")
        self._cause = ""

    def _note_stop(self, reason: str, now_ns: int) -> None:
        if reason in PLANNED:
            return
        if not self._cause:
            self._cause, self._begin_ns = reason, now_ns
        self._end_ns = min(now_ns + AFTER_NS, self._begin_ns + LONGEST_NS)

    def _forget(self, before_ns: int) -> None:
        """Drop older lines; the newest trajectory before then stays, because it is in force."""
        for kind, kept in self._lines.items():
            least = 1 if kind == "trajectories" else 0
            while len(kept) > least and kept[least][0] < before_ns:
                kept.popleft()

    def _write(self, name: str) -> Path:
        self._place.mkdir(parents=True, exist_ok=True)
        folder = _find_free(self._place / name)
        try:
            create_folder(msgspec.structs.replace(self._request, folder=str(folder), input_files=[]), self._info)
            for kind, kept in self._lines.items():
                if kind != "frames" or self._request.channels:
                    header = files.SNAPSHOT_HEADER if kind == "snapshots" else b""
                    (folder / _FILES[kind]).write_bytes(header + b"".join(line for _, line in kept))
        except OSError:
            empty_folder(folder)
            with contextlib.suppress(OSError):
                folder.rmdir()
            raise
        self._remove_oldest(folder)
        return folder

    def _remove_oldest(self, newest: Path) -> None:
        """Remove the oldest boxes, never the newest one, until the others fit into the limit."""
        metas = sorted(self._place.glob(f"*/{files.META}"), key=lambda path: path.stat().st_mtime_ns)
        boxes = [meta.parent for meta in metas]
        sizes = {path: _size_bytes(path) for path in boxes}
        for path in boxes:
            if sum(sizes.values()) <= self._limit_bytes or path == newest:
                return
            shutil.rmtree(path, ignore_errors=True)
            del sizes[path]


def default_place() -> Path:
    """The folder of the black boxes of drives that are not recorded, of this user."""
    state = os.environ.get("XDG_STATE_HOME", "")
    return (Path(state) if state.startswith("/") else Path.home() / ".local/state") / "vehicle-iface" / "black-box"


def _format_time() -> str:
    return f"{datetime.fromtimestamp(clock.wall_ns() / NS_PER_S, UTC):%Y%m%d-%H%M%S}"


def _find_free(folder: Path) -> Path:
    """The folder, or with a number behind its name where it exists."""
    names = (folder, *(folder.with_name(f"{folder.name}-{number}") for number in range(2, 1000)))
    return next(path for path in names if not path.exists())


def _size_bytes(folder: Path) -> int:
    with contextlib.suppress(OSError):
        return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return 0
