"""The loop's side of the telemetry.

The writer never waits and makes no system call for a snapshot: it packs one struct, computes its CRC and copies both
into the next slot of a ring.
"""

import contextlib
import errno
import fcntl
import mmap
import os
import stat
import sys
import zlib
from pathlib import Path
from typing import Self

import msgspec
import numpy as np

from vehicle_iface import clock
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.telemetry.address import paths_of
from vehicle_iface.telemetry.details import LiveDetails
from vehicle_iface.telemetry.events import LoopEvent
from vehicle_iface.telemetry.layout import (
    COLUMNS,
    CRC,
    DETAILS,
    DETAILS_AT,
    DETAILS_STRIDE,
    ENDED_AT,
    EVENT,
    EVENT_BYTES,
    EVENT_SLOTS,
    EVENTS_AT,
    FILE_BYTES,
    FRAME_BYTES,
    HEAD_AT,
    HEADER,
    INFO_AT,
    JSON_BYTES,
    LAYOUT,
    MAGIC,
    RECORD,
    RING_AT,
    SLOT_BYTES,
    TRAJECTORY,
    TRAJECTORY_AT,
    TRAJECTORY_BYTES,
    TRAJECTORY_STRIDE,
    VERSION,
)
from vehicle_iface.telemetry.snapshot import MAX_POINTS, RING_LENGTH, SessionInfo, Snapshot
from vehicle_iface.trajectory import Trajectory

_FULL = (errno.ENOSPC, errno.EDQUOT)
_TAKEOVER_TRIES = 20
_TAKEOVER_PAUSE_NS = 10_000_000


class TelemetryWriter:
    """Publishes telemetry. One writer at a time per address; a file whose writer is gone is replaced.

    Raises `ConfigError` when another writer has the address, or when the file cannot be made.
    """

    def __init__(self, address: str, info: SessionInfo) -> None:
        self.address = address
        self.path, self._map, self._file = _create(paths_of(address), address, info)
        view = memoryview(self._map)
        self._slots = [view[at : at + RECORD.size + CRC.size] for at in range(RING_AT, TRAJECTORY_AT, SLOT_BYTES)]
        # Item assignment through a cast view is one aligned 8-byte store; struct would store byte by byte.
        self._head = view[HEAD_AT : HEAD_AT + 8].cast("Q")
        self._ended = view[ENDED_AT : ENDED_AT + 8].cast("Q")
        self._view = view
        self._scratch = bytearray(RECORD.size + CRC.size)
        self._body = memoryview(self._scratch)[: RECORD.size]
        self._frame_id, self._frame = "", b""
        self._sequence = 0
        # Memory that is there already: a trajectory may be accepted when there is no more.
        self._trajectory = bytearray(TRAJECTORY_BYTES + CRC.size)
        points = np.frombuffer(self._trajectory, offset=TRAJECTORY.size, count=len(COLUMNS) * MAX_POINTS)
        self._points = points.reshape(len(COLUMNS), MAX_POINTS)
        self._trajectory_version = 0
        self._details_number = 0

    def publish(self, snapshot: Snapshot) -> None:
        """Publish `snapshot` as the newest. Its `sequence` is replaced by the next number."""
        if snapshot.frame_id != self._frame_id:
            self._frame, self._frame_id = _frame_bytes(snapshot.frame_id), snapshot.frame_id
        sequence = self._sequence = self._sequence + 1
        RECORD.pack_into(self._scratch, 0, *snapshot[:-2], self._frame, sequence)
        CRC.pack_into(self._scratch, RECORD.size, zlib.crc32(self._body))
        self._slots[sequence % RING_LENGTH][:] = self._scratch
        self._head[0] = sequence

    def publish_trajectory(self, trajectory: Trajectory | None) -> int:
        """Publish `trajectory` (None: there is none) and return its version, for snapshots to refer to."""
        version = self._trajectory_version = self._trajectory_version + 1
        self._pack_trajectory(version, Trajectory.empty(stamp_ns=0) if trajectory is None else trajectory)
        record = self._trajectory
        at = TRAJECTORY_AT + version % 2 * TRAJECTORY_STRIDE
        # Two areas in turn: while one is being written, the one before it can still be read.
        self._view[at : at + len(record)] = record
        return version

    def _pack_trajectory(self, version: int, trajectory: Trajectory) -> None:
        total, points, record = len(trajectory), self._points, self._trajectory
        count = min(total, MAX_POINTS)
        # Evenly by index, in integers: 0 and total − 1 are always among them.
        chosen = np.arange(count) * (total - 1) // max(count - 1, 1)
        for row, name in zip(points, COLUMNS[:-1], strict=False):
            np.take(getattr(trajectory, name), chosen, out=row[:count], mode="clip")
        points[-1, :count] = trajectory.time_from_start_ns[chosen] * 1e-9
        points[:, count:] = 0.0
        frame = _frame_bytes(trajectory.frame_id)
        TRAJECTORY.pack_into(record, 0, version, trajectory.stamp_ns, count, total, frame)
        CRC.pack_into(record, TRAJECTORY_BYTES, zlib.crc32(memoryview(record)[:TRAJECTORY_BYTES]))

    def publish_details(self, details: LiveDetails) -> None:
        """Publish all counters, shortened where their JSON is over 32 KiB. Too slow for each pass: it encodes JSON."""
        text = msgspec.json.encode(details)
        if len(text) > JSON_BYTES:
            text = msgspec.json.encode(details.shortened())
        number = self._details_number = self._details_number + 1
        body = DETAILS.pack(number, len(text)) + text
        at = DETAILS_AT + number % 2 * DETAILS_STRIDE
        self._view[at : at + len(body) + CRC.size] = body + CRC.pack(zlib.crc32(body))

    def publish_event(self, event: LoopEvent) -> None:
        """Publish an event; its text is shortened where its JSON does not fit into `EVENT_BYTES`."""
        text, room = msgspec.json.encode(event), EVENT_BYTES - EVENT.size - CRC.size
        if len(text) > room:
            kept = event.text[: max(0, len(event.text) - (len(text) - room) - 1)]
            while len(text) > room:
                text = msgspec.json.encode(msgspec.structs.replace(event, name=event.name[:64], text=kept + "…"))
                kept = kept[: len(kept) // 2]
        body = EVENT.pack(event.number, len(text)) + text
        at = EVENTS_AT + event.number % EVENT_SLOTS * EVENT_BYTES
        self._view[at : at + len(body) + CRC.size] = body + CRC.pack(zlib.crc32(body))

    def close(self) -> None:
        """Close the session: readers keep the last data and see that the loop has ended. May be called twice."""
        if self._map.closed:
            return
        self._ended[0] = 1
        for view in (*self._slots, self._head, self._ended, self._view):
            view.release()
        self._map.close()
        os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _create(paths: tuple[Path, ...], address: str, info: SessionInfo) -> tuple[Path, mmap.mmap, int]:
    """Create a locked file at the first path with room for it; return its path, map and descriptor.

    Raises `ConfigError` when another writer has the address, at whichever path.
    """
    for other in paths[1:]:
        with contextlib.suppress(OSError):
            if os.lstat(other).st_uid == os.getuid():  # another user's file is not in the way yet
                _remove_stale(other, address)
    for path in paths:
        try:
            return path, *_create_at(path, address, info)
        except OSError as error:
            if error.errno not in _FULL or path is paths[-1]:
                raise ConfigError(f"telemetry {address!r}: cannot create {path}: {error.strerror}") from None
    raise AssertionError("an address has at least one path")


def _create_at(path: Path, address: str, info: SessionInfo) -> tuple[mmap.mmap, int]:
    """Create a locked, mapped file at `path`; one whose writer is gone is replaced."""
    for _ in range(_TAKEOVER_TRIES):
        _remove_stale(path, address)
        file = _create_file(path, info)
        if file is not None:
            flags = mmap.MAP_SHARED | getattr(mmap, "MAP_POPULATE", 0)
            return mmap.mmap(file, FILE_BYTES, flags=flags), file
    raise _address_in_use_error(path, address)


def _address_in_use_error(path: Path, address: str) -> ConfigError:
    return ConfigError(
        f"telemetry {address!r}: another loop writes to {path}; end it, or choose another address with --telemetry"
    )


def _remove_stale(path: Path, address: str) -> None:
    """Remove the file that a dead writer left at `path`; `ConfigError` while a live one holds it."""
    try:
        file = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except FileNotFoundError:
        return
    try:
        found = os.fstat(file)
        if not stat.S_ISREG(found.st_mode) or (found.st_size and os.pread(file, 8, 0) != MAGIC):
            raise ConfigError(f"telemetry {address!r}: {path} is not a telemetry file; it is not overwritten")
        if not _try_lock(file):
            raise _address_in_use_error(path, address)
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.stat(path), found):
                os.unlink(path)
    finally:
        os.close(file)


def _try_lock(file: int) -> bool:
    """Take the writer's lock. Readers that test for a live writer hold it for microseconds, so retry."""
    for _ in range(_TAKEOVER_TRIES):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            clock.sleep_until(clock.monotonic_ns() + _TAKEOVER_PAUSE_NS)
        else:
            return True
    return False


def _create_file(path: Path, info: SessionInfo) -> int | None:
    """Create a complete, locked file at `path` atomically; None when another writer was faster."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    file = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Reserve all of it now: on a full tmpfs, the first access to a missing page would kill the loop.
        os.posix_fallocate(file, 0, FILE_BYTES)
        text = msgspec.json.encode(info)
        if len(text) > JSON_BYTES:
            raise ConfigError(f"session info of {len(text)} bytes: at most {JSON_BYTES}")
        session = int.from_bytes(os.urandom(8), sys.byteorder) | 1
        header = HEADER.pack(MAGIC, VERSION, LAYOUT, session, os.getpid(), clock.monotonic_ns(), len(text))
        os.pwrite(file, header + CRC.pack(zlib.crc32(text, zlib.crc32(header))), 0)
        os.pwrite(file, text, INFO_AT)
        os.link(draft, path)
    except FileExistsError:
        os.close(file)
        return None
    except BaseException:
        os.close(file)
        raise
    finally:
        os.unlink(draft)
    return file


def _frame_bytes(frame_id: str) -> bytes:
    """Encode `frame_id` for its fixed-size field; `InvalidValueError` when it is too long."""
    encoded = frame_id.encode()
    if len(encoded) > FRAME_BYTES:
        raise InvalidValueError(f"frame_id = {frame_id!r}: must be at most {FRAME_BYTES} bytes in UTF-8")
    return encoded
