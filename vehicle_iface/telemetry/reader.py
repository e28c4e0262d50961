"""The reader's side of the telemetry.

Readers are other processes and hold no lock, so they may read a partial copy. Every record has its number and a CRC-32;
a record that does not match both is ignored. That is correct on every processor, whatever its memory ordering.
"""

import contextlib
import fcntl
import os
import stat
import sys
import zlib
from typing import Self

import msgspec
import numpy as np

from vehicle_iface.telemetry.address import paths_of
from vehicle_iface.telemetry.details import LiveDetails
from vehicle_iface.telemetry.events import LoopEvent
from vehicle_iface.telemetry.layout import (
    BAD_JSON,
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
from vehicle_iface.telemetry.snapshot import (
    MAX_POINTS,
    RING_LENGTH,
    DrawnTrajectory,
    SessionInfo,
    Snapshot,
    WriterState,
)


class TelemetryReader:
    """Reads the telemetry of a running loop. Call `poll` first, and again from time to time.

    No content of the file makes it raise; data that is not intact is None. It reads through the file descriptor instead
    of mapping the file: access to a mapped file that was truncated would kill the process.
    """

    def __init__(self, address: str) -> None:
        """`address`: the value of `run --telemetry`, a name or a path. Raises `ConfigError` for an invalid one."""
        self.address = address
        self._paths = paths_of(address)
        self.path = self._paths[0]
        self.writer_state = WriterState.ABSENT
        """State of the writer at the last `poll`."""
        self.problem = ""
        """Text for the user why the writer is not live; empty when it is."""
        self.session = 0
        """Identifier of the writer's run; sequence numbers restart with it. 0: none seen yet."""
        self.info: SessionInfo | None = None
        """Constant data of the present session; None before a writer was found."""
        self.dropped = 0
        """Snapshots of the present session that were overwritten before `since` read them."""
        self._file = -1
        self._inode = (0, 0)

    def poll(self) -> WriterState:
        """Check whether the file exists, is the same as before, and still has a writer."""
        found = self._stat_first()
        if found is None:
            return self._detach(WriterState.ABSENT, f"no telemetry at {self.path}")
        if self._file < 0 or self._inode != (found.st_dev, found.st_ino) or found.st_size != FILE_BYTES:
            self._attach()
        if self._file >= 0:
            self.writer_state, self.problem = self._check_writer()
        return self.writer_state

    def newest(self) -> Snapshot | None:
        """Return the newest intact snapshot; None when there is none."""
        head = self._head_sequence()
        if head is None:
            return None
        snapshot = self._slot(head)
        if snapshot is not None:
            return snapshot
        # The head became visible before its snapshot, or is damaged: search the ring.
        return max(self._all_slots(), key=lambda each: each.sequence, default=None)

    def since(self, sequence: int) -> list[Snapshot]:
        """Return the intact snapshots after `sequence`, oldest first; overwritten ones are counted in `dropped`."""
        newest = self.newest()
        if newest is None or newest.sequence <= sequence:
            return []
        first = max(sequence, newest.sequence - RING_LENGTH, 0) + 1
        if newest.sequence - first < 16:
            numbers = range(first, newest.sequence)
            found = [snapshot for n in numbers if (snapshot := self._slot(n)) is not None]
        else:
            found = [each for each in self._all_slots() if first <= each.sequence < newest.sequence]
            found.sort(key=lambda each: each.sequence)
        found.append(newest)
        self.dropped += newest.sequence - max(sequence, 0) - len(found)
        return found

    def trajectory(self, version: int) -> DrawnTrajectory | None:
        """Return the trajectory of that version; None when it is not available (any more)."""
        at = TRAJECTORY_AT + version % 2 * TRAJECTORY_STRIDE
        return unpack_trajectory(self._read(at, TRAJECTORY_BYTES + CRC.size), version)

    def details(self) -> LiveDetails | None:
        """Return the newest counters; None when there are none."""
        both = (self._read(DETAILS_AT + k * DETAILS_STRIDE, DETAILS_STRIDE) for k in (0, 1))
        return max((unpack_details(area) for area in both), key=lambda found: found[0])[1]

    def events(self, after: int = 0) -> list[LoopEvent]:
        """Return the events with a number above `after` that are still kept, oldest first, up to a missing one."""
        found: list[LoopEvent] = []
        first = self._event(after + 1)
        if first is None:  # overwritten, or not there yet
            area = self._read(EVENTS_AT, EVENT_SLOTS * EVENT_BYTES)
            slots = (unpack_event(area[at : at + EVENT_BYTES]) for at in range(0, len(area), EVENT_BYTES))
            first = min((one for one in slots if one is not None and one.number > after), key=_number, default=None)
        while first is not None:
            found.append(first)
            first = self._event(first.number + 1)
        return found

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            os.close(self._file)
        self._file = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _stat_first(self) -> os.stat_result | None:
        """Stat the first of the possible paths that exists, and set `path` to it."""
        for path in self._paths:
            with contextlib.suppress(OSError):
                found = os.stat(path)
                self.path = path
                return found
        self.path = self._paths[0]
        return None

    def _detach(self, state: WriterState, problem: str) -> WriterState:
        self.close()
        self.writer_state, self.problem = state, problem
        return state

    def _attach(self) -> None:
        """Open the present file, and keep it only when it is valid."""
        self.close()
        try:
            # Non-blocking: opening a pipe at this address would block for ever.
            self._file = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
            found = os.fstat(self._file)
        except OSError as error:
            self._detach(WriterState.UNREADABLE, f"{self.path}: {error.strerror}")
            return
        state, problem = self._validate(found)
        if state is not WriterState.LIVE:
            self._detach(state, f"{self.path}: {problem}")
            return
        self._inode = (found.st_dev, found.st_ino)

    def _validate(self, found: os.stat_result) -> tuple[WriterState, str]:
        if not stat.S_ISREG(found.st_mode):
            return WriterState.UNREADABLE, "not a file"
        if "/" not in self.address and found.st_uid != os.getuid():
            return WriterState.UNREADABLE, f"belongs to user {found.st_uid}, not to this one"
        header = self._read(0, HEADER.size + CRC.size)
        if header[:8] != MAGIC or len(header) < HEADER.size + CRC.size:
            return WriterState.UNREADABLE, "not a telemetry file"
        _, version, layout, session, _, _, length = HEADER.unpack_from(header)
        if (version, layout) != (VERSION, LAYOUT):
            return WriterState.OTHER_VERSION, "written by another version of this program"
        info = self._read(INFO_AT, min(length, JSON_BYTES))
        crc = CRC.unpack_from(header, HEADER.size)[0]
        if found.st_size != FILE_BYTES or zlib.crc32(info, zlib.crc32(header[: HEADER.size])) != crc:
            return WriterState.UNREADABLE, "damaged"
        try:
            self.info = msgspec.json.decode(info, type=SessionInfo)
        except BAD_JSON:
            return WriterState.UNREADABLE, "damaged"
        if session != self.session:
            self.session, self.dropped = session, 0
        return WriterState.LIVE, ""

    def _check_writer(self) -> tuple[WriterState, str]:
        if any(self._read(ENDED_AT, 8)):
            return WriterState.ENDED, "the loop has ended"
        try:
            # A live writer holds the lock, so this attempt cannot succeed against one.
            fcntl.flock(self._file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return WriterState.LIVE, ""
        fcntl.flock(self._file, fcntl.LOCK_UN)
        return WriterState.DEAD, "the loop terminated without closing its session"

    def _read(self, at: int, size: int) -> bytes:
        if self._file < 0:
            return b""
        try:
            return os.pread(self._file, size, at)
        except OSError:
            return b""

    def _head_sequence(self) -> int | None:
        head = self._read(HEAD_AT, 8)
        return int.from_bytes(head, sys.byteorder) if len(head) == 8 else None

    def _slot(self, sequence: int) -> Snapshot | None:
        slot = self._read(RING_AT + sequence % RING_LENGTH * SLOT_BYTES, SLOT_BYTES)
        return unpack_snapshot(slot, sequence)

    def _event(self, number: int) -> LoopEvent | None:
        slot = self._read(EVENTS_AT + number % EVENT_SLOTS * EVENT_BYTES, EVENT_BYTES)
        return unpack_event(slot, number)

    def _all_slots(self) -> list[Snapshot]:
        ring = self._read(RING_AT, RING_LENGTH * SLOT_BYTES)
        found = (unpack_snapshot(ring[at : at + SLOT_BYTES]) for at in range(0, len(ring), SLOT_BYTES))
        return [snapshot for snapshot in found if snapshot is not None]


def unpack_snapshot(slot: bytes, sequence: int | None = None) -> Snapshot | None:
    """Return the snapshot in a slot of the ring; None when it is empty, partly written, or not the requested one."""
    if len(slot) < RECORD.size + CRC.size:
        return None
    if zlib.crc32(slot[: RECORD.size]) != CRC.unpack_from(slot, RECORD.size)[0]:
        return None
    values = RECORD.unpack_from(slot)
    if values[-1] <= 0 or sequence not in (None, values[-1]):
        return None
    return Snapshot._make((*values[:-2], _text(values[-2]), values[-1]))


def unpack_event(slot: bytes, number: int | None = None) -> LoopEvent | None:
    """Return the event in a slot; None when it is empty, partly written, or not the requested one."""
    if len(slot) < EVENT.size:
        return None
    found, length = EVENT.unpack_from(slot)
    end = EVENT.size + min(length, EVENT_BYTES)
    if found <= 0 or number not in (None, found) or len(slot) < end + CRC.size:
        return None
    if zlib.crc32(slot[:end]) != CRC.unpack_from(slot, end)[0]:
        return None
    try:
        return msgspec.json.decode(slot[EVENT.size : end], type=LoopEvent)
    except BAD_JSON:
        return None


def _number(event: LoopEvent) -> int:
    return event.number


def _text(padded: bytes) -> str:
    return padded.rstrip(b"\0").decode(errors="replace")


def unpack_trajectory(area: bytes, version: int) -> DrawnTrajectory | None:
    if len(area) < TRAJECTORY_BYTES + CRC.size:
        return None
    if zlib.crc32(area[:TRAJECTORY_BYTES]) != CRC.unpack_from(area, TRAJECTORY_BYTES)[0]:
        return None
    found, stamp_ns, count, total, frame = TRAJECTORY.unpack_from(area)
    if found != version or not 0 <= count <= MAX_POINTS:
        return None
    points = np.frombuffer(area, offset=TRAJECTORY.size, count=MAX_POINTS * len(COLUMNS))
    columns = dict(zip(COLUMNS, points.reshape(len(COLUMNS), MAX_POINTS)[:, :count], strict=True))
    return DrawnTrajectory(version=version, stamp_ns=stamp_ns, frame_id=_text(frame), original_count=total, **columns)


def unpack_details(area: bytes) -> tuple[int, LiveDetails | None]:
    """Return the number of the details, from 1, and the details; 0 and None when they are incomplete."""
    if len(area) < DETAILS.size:
        return 0, None
    number, length = DETAILS.unpack_from(area)
    end = DETAILS.size + min(length, JSON_BYTES)
    if len(area) < end + CRC.size or zlib.crc32(area[:end]) != CRC.unpack_from(area, end)[0]:
        return 0, None
    try:
        return number, msgspec.json.decode(area[DETAILS.size : end], type=LiveDetails)
    except BAD_JSON:
        return 0, None
