"""The one-way door out of the loop: what it knows, in a file in memory that anybody of this user may read.

The writer never waits and makes no system call per snapshot: it packs one struct, sums it up and copies it
into the next place of a ring. Readers are other processes and hold no lock, so they may see half a copy;
every record carries its number and a CRC-32, and a record that does not fit both is not there. That holds on
every processor, whatever order it makes stores visible in.

Adding a field: write it into `Snapshot`, with a flag beside it when it can be missing. The layout and its
fingerprint follow from the annotations, and a reader of another layout says so instead of guessing.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import mmap
import os
import re
import stat
import struct
import sys
import tempfile
import zlib
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec
import numpy as np

from vehicle_iface import checks, clock
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.trajectory import FloatArray, Trajectory

RING_LENGTH = 512
"""Snapshots that a reader may be late before it misses one: 5 s at 100 Hz."""
MAX_POINTS = 512
"""Points of a trajectory that are published for drawing."""


class Snapshot(NamedTuple):
    """What the loop knew at the end of one pass. A group is valid where its flag says so."""

    # A plain tuple because it is packed in the loop: one call, no conversion per field.
    published_ns: int
    """When this was published, nanoseconds of the monotonic clock."""
    controller_state: int
    """A `ControllerState`."""
    reason: int
    """A `Reason`."""

    has_state: bool = False
    """A state was received at some time; `stamp_ns` says when."""
    stamp_ns: int = 0
    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    speed_mps: float = 0.0
    accel_mps2: float = 0.0
    yaw_rate_radps: float = 0.0
    lateral_speed_mps: float = 0.0
    front_wheel_angle_rad: float = 0.0
    rear_wheel_angle_rad: float = 0.0

    has_status: bool = False
    """The vehicle's own report was received."""
    vehicle_mode: int = 0
    """A `VehicleMode`."""
    gear: int = 0
    """A `Gear`; NO_REQUEST where the vehicle does not say."""

    trajectory_version: int = 0
    """Which trajectory is in force (`TelemetryWriter.publish_trajectory`); 0: none yet."""
    has_reference: bool = False
    """There are indices in the trajectory."""
    spatial_index: int = 0
    temporal_index: int = 0
    spatial_reference_x_m: float = 0.0
    spatial_reference_y_m: float = 0.0
    temporal_reference_x_m: float = 0.0
    temporal_reference_y_m: float = 0.0
    reference_speed_mps: float = 0.0
    lateral_error_m: float = 0.0
    """Of the vehicle against the reference: positive when it is to the left of it."""
    heading_error_rad: float = 0.0

    has_lookahead: bool = False
    lookahead_x_m: float = 0.0
    lookahead_y_m: float = 0.0

    has_wanted: bool = False
    """The controller computed a command."""
    wanted_accel_mps2: float = 0.0
    wanted_front_wheel_angle_rad: float = 0.0

    sent: bool = False
    """A command really left for the bus in this pass; `latency_ns` belongs to it."""
    sent_accel_mps2: float = 0.0
    sent_front_wheel_angle_rad: float = 0.0
    latency_ns: int = 0
    """From the receipt of the state to the command's departure."""

    samples: int = 0
    """Complete samples received since the start."""
    commands: int = 0
    """Commands sent since the start."""
    drops: int = 0
    """Frames dropped since the start, whatever the cause; `publish_details` has them by cause."""
    deadline_misses: int = 0

    hands_over: bool = False
    """Control is about to be given back."""
    handover_ns: int = 0
    """In so long at the earliest; 0 where only standstill is waited for."""

    frame_id: str = "map"
    """Frame of reference of all positions here."""
    sequence: int = 0
    """Counts snapshots of one session from 1. Given by the writer, whatever is written here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleShape:
    """What a vehicle looks like from above, for drawing. The origin is the rear axle's centre."""

    wheelbase_m: float = 2.7
    length_m: float = 4.5
    width_m: float = 1.85
    height_m: float = 1.5
    rear_overhang_m: float = 0.9
    track_m: float = 1.6
    wheel_radius_m: float = 0.33

    def __post_init__(self) -> None:
        for name in self.__slots__:
            checks.positive(name, getattr(self, name))


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionInfo:
    """What does not change while a loop runs."""

    channel: str
    bus: str
    """Which kind of bus this is, in words: "SocketCAN vcan0"."""
    bus_hint: str = ""
    """How to get a real one, where this is not."""
    profile: str = ""
    route: str = ""
    """The route's name or the trajectory file's."""
    arming: str = "listen-only"
    """"armed", "shadow" or "listen-only"."""
    period_s: float = 0.01
    recording: str = ""
    """The folder that a recorder writes this down in; empty when there is none."""
    shape: VehicleShape = VehicleShape()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnTrajectory:
    """A trajectory as published: at most `MAX_POINTS` of its points, always with the first and the last."""

    version: int
    stamp_ns: int
    frame_id: str
    original_count: int
    """Points that the real one has."""
    x_m: FloatArray
    """(n,)"""
    y_m: FloatArray
    """(n,)"""
    heading_rad: FloatArray
    """(n,)"""
    speed_mps: FloatArray
    """(n,)"""
    time_s: FloatArray
    """(n,) from `stamp_ns` on."""


class WriterState(Enum):
    """What a reader finds at its address."""

    ABSENT = "absent"
    """Nothing there: no loop was started, or the machine was."""
    LIVE = "live"
    """A session whose writer has not said goodbye. Whether its data is young is for the stamps to say."""
    ENDED = "ended"
    """The writer closed it in order."""
    DEAD = "dead"
    """The writer is gone and closed nothing."""
    OTHER_VERSION = "other version"
    """Written by a program with another layout."""
    UNREADABLE = "unreadable"
    """Not a telemetry file, damaged, cut short, or not ours to read."""


def _layout() -> bytes:
    """A fingerprint of everything that both sides must agree on."""
    words = (sys.byteorder, RING_LENGTH, MAX_POINTS, _JSON_BYTES, *Snapshot.__annotations__.items(), _CODES)
    text = repr(words).encode()
    return struct.pack("=II", zlib.crc32(text), zlib.adler32(text))  # hashlib would bring OpenSSL: 3.5 MB


_MAGIC = b"VEHIFTLM"
_VERSION = 1
_FRAME_BYTES = checks.FRAME_ID_BYTES
_JSON_BYTES = 32768
_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps", "time_s")
_CODES = {"int": "q", "float": "d", "bool": "?", "str": f"{_FRAME_BYTES}s"}
_FIELDS = tuple(_CODES[str(getattr(a, "__forward_arg__", a))] for a in Snapshot.__annotations__.values())
_CRC = struct.Struct("=I")
# Native alignment: numbers stand on their own boundaries, and both sides are on the same machine.
_RECORD = struct.Struct("@" + "".join(_FIELDS))
_SLOT_BYTES = -(-(_RECORD.size + _CRC.size) // 64) * 64
_HEADER = struct.Struct("@8sQ8sQQqQ")  # magic, version, layout, session, pid, start_ns, length of the info
_TRAJECTORY = struct.Struct(f"@qqqq{_FRAME_BYTES}s")  # version, stamp_ns, points here, points of the original, frame
_TRAJECTORY_BYTES = _TRAJECTORY.size + MAX_POINTS * len(_COLUMNS) * 8
_DETAILS = struct.Struct("@QQ")  # number, length

_HEAD_AT = 4096 - 64
_ENDED_AT = 4096 - 8
_INFO_AT = 4096
_RING_AT = _INFO_AT + _JSON_BYTES
_TRAJECTORY_AT = _RING_AT + RING_LENGTH * _SLOT_BYTES
_TRAJECTORY_STRIDE = -(-(_TRAJECTORY_BYTES + _CRC.size) // 64) * 64
_DETAILS_AT = _TRAJECTORY_AT + 2 * _TRAJECTORY_STRIDE
_DETAILS_STRIDE = _DETAILS.size + _JSON_BYTES + 64
_FILE_BYTES = -(-(_DETAILS_AT + 2 * _DETAILS_STRIDE) // 4096) * 4096
_LAYOUT = _layout()

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_FULL = (errno.ENOSPC, errno.EDQUOT)
_BAD_JSON = (msgspec.MsgspecError, ValueError, RecursionError)
_TAKEOVER_TRIES = 20
_TAKEOVER_PAUSE_NS = 10_000_000


def telemetry_path(address: str) -> Path:
    """Where `address` is: a bare name is a file of this user in memory, anything with a slash is a path.

    Raises `ConfigError` for what is neither.
    """
    return _paths(address)[0]


def _paths(address: str) -> tuple[Path, ...]:
    """Where `address` may be, in the order in which it is looked for: memory that is full is passed over."""
    if "/" in address:
        return (Path(address),)
    if not _NAME.fullmatch(address):
        raise ConfigError(
            f"telemetry address {address!r}: must be a path with a '/', or a name of up to 64 letters, "
            "digits, '_', '.' and '-'"
        )
    memory = Path("/dev/shm")
    folders = [memory] if memory.is_dir() and os.access(memory, os.W_OK) else []
    with contextlib.suppress(FileNotFoundError):  # there may be none that this user may write to
        folders.append(Path(tempfile.gettempdir()))
    if not folders:
        raise ConfigError(
            f"telemetry address {address!r}: neither {memory} nor a folder for temporary files is writable"
        )
    return tuple(folder / f"vehicle-iface-{os.getuid()}-{address}" for folder in folders)


class TelemetryWriter:
    """The loop's end. One at a time per address; a file whose writer is gone is replaced.

    Raises `ConfigError` when another writer has the address, or when the file cannot be made.
    """

    def __init__(self, address: str, info: SessionInfo) -> None:
        self.address = address
        self.path, self._map, self._file = _created(_paths(address), address, info)
        view = memoryview(self._map)
        self._slots = [view[at : at + _RECORD.size + _CRC.size] for at in range(_RING_AT, _TRAJECTORY_AT, _SLOT_BYTES)]
        # Item assignment through a cast view is one aligned 8-byte store; struct would store byte by byte.
        self._head = view[_HEAD_AT : _HEAD_AT + 8].cast("Q")
        self._ended = view[_ENDED_AT : _ENDED_AT + 8].cast("Q")
        self._view = view
        self._scratch = bytearray(_RECORD.size + _CRC.size)
        self._body = memoryview(self._scratch)[: _RECORD.size]
        self._sequence = 0
        self._trajectory_version = 0
        self._details_number = 0

    def publish(self, snapshot: Snapshot) -> None:
        """Make `snapshot` the newest. Its `sequence` is replaced by the next number."""
        frame = _frame_bytes(snapshot.frame_id)
        sequence = self._sequence = self._sequence + 1
        _RECORD.pack_into(self._scratch, 0, *snapshot[:-2], frame, sequence)
        _CRC.pack_into(self._scratch, _RECORD.size, zlib.crc32(self._body))
        self._slots[sequence % RING_LENGTH][:] = self._scratch
        self._head[0] = sequence

    def publish_trajectory(self, trajectory: Trajectory | None) -> int:
        """Show `trajectory` (None: there is none) and return its version, for snapshots to refer to."""
        version = self._trajectory_version = self._trajectory_version + 1
        record = _packed_trajectory(version, trajectory)
        at = _TRAJECTORY_AT + version % 2 * _TRAJECTORY_STRIDE
        # Two places in turn: while one is being written, the one before it can still be read.
        self._view[at : at + len(record)] = record
        return version

    def publish_details(self, details: dict[str, Any]) -> None:
        """Show counters and the like: what JSON can say in 32 KiB. For now and then, not for each pass."""
        text = msgspec.json.encode(details)
        if len(text) > _JSON_BYTES:
            text = msgspec.json.encode({"too long to show, bytes": len(text)})
        number = self._details_number = self._details_number + 1
        body = _DETAILS.pack(number, len(text)) + text
        at = _DETAILS_AT + number % 2 * _DETAILS_STRIDE
        self._view[at : at + len(body) + _CRC.size] = body + _CRC.pack(zlib.crc32(body))

    def close(self) -> None:
        """Say goodbye: readers go on seeing the last data, and that it is the last. Twice does no harm."""
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


class TelemetryReader:
    """A reader's end: it looks and copes with whatever it finds; nothing in the file makes it raise.

    It reads through the file descriptor instead of mapping the file: a map of a file that somebody cuts short
    kills the process that touches it.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._paths = _paths(address)
        self.path = self._paths[0]
        self.link = WriterState.ABSENT
        """What the last `poll` found."""
        self.problem = ""
        """Why the link is not live, in words."""
        self.session = 0
        """Changes with each run of a writer, and then all sequence numbers start again. 0: none seen yet."""
        self.info: SessionInfo | None = None
        """What the present session said about itself."""
        self.missed = 0
        """Snapshots of the present session that `since` was too late for."""
        self._file = -1
        self._inode = (0, 0)

    def poll(self) -> WriterState:
        """Look whether the file is there, is the same one as before, and is still being written."""
        found = self._found()
        if found is None:
            return self._lost(WriterState.ABSENT, f"no telemetry at {self.path}")
        if self._file < 0 or self._inode != (found.st_dev, found.st_ino) or found.st_size != _FILE_BYTES:
            self._attach()
        if self._file >= 0:
            self.link, self.problem = self._writer_link()
        return self.link

    def newest(self) -> Snapshot | None:
        """The newest whole snapshot; None when there is none."""
        head = self._head_sequence()
        if head is None:
            return None
        snapshot = self._slot(head)
        if snapshot is not None:
            return snapshot
        # The head was visible before its snapshot, or is no head at all: the ring itself knows.
        return max(self._all_slots(), key=lambda each: each.sequence, default=None)

    def since(self, sequence: int) -> list[Snapshot]:
        """All whole snapshots after number `sequence`, oldest first; what is lost is added to `missed`."""
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
        self.missed += newest.sequence - max(sequence, 0) - len(found)
        return found

    def trajectory(self, version: int) -> DrawnTrajectory | None:
        """The trajectory of that version; None when it is not, or no longer, there."""
        at = _TRAJECTORY_AT + version % 2 * _TRAJECTORY_STRIDE
        return _unpacked_trajectory(self._read(at, _TRAJECTORY_BYTES + _CRC.size), version)

    def details(self) -> dict[str, Any]:
        """The newest counters; empty when there are none."""
        both = (self._read(_DETAILS_AT + k * _DETAILS_STRIDE, _DETAILS_STRIDE) for k in (0, 1))
        return max((_unpacked_details(area) for area in both), key=lambda found: found[0])[1]

    def close(self) -> None:
        """Let go of the file."""
        if self._file >= 0:
            os.close(self._file)
        self._file = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _found(self) -> os.stat_result | None:
        """The first place at which there is something; `path` is where."""
        for path in self._paths:
            with contextlib.suppress(OSError):
                found = os.stat(path)
                self.path = path
                return found
        self.path = self._paths[0]
        return None

    def _lost(self, link: WriterState, problem: str) -> WriterState:
        self.close()
        self.link, self.problem = link, problem
        return link

    def _attach(self) -> None:
        """Open what is there now, and believe it only when all of it fits."""
        self.close()
        try:
            # Not blocking: a pipe at this address would hold up the open for ever.
            self._file = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
            found = os.fstat(self._file)
        except OSError as error:
            self._lost(WriterState.UNREADABLE, f"{self.path}: {error.strerror}")
            return
        link, problem = self._judged(found)
        if link is not WriterState.LIVE:
            self._lost(link, f"{self.path}: {problem}")
            return
        self._inode = (found.st_dev, found.st_ino)

    def _judged(self, found: os.stat_result) -> tuple[WriterState, str]:
        if not stat.S_ISREG(found.st_mode):
            return WriterState.UNREADABLE, "not a file"
        if "/" not in self.address and found.st_uid != os.getuid():
            return WriterState.UNREADABLE, f"belongs to user {found.st_uid}, not to this one"
        header = self._read(0, _HEADER.size + _CRC.size)
        if header[:8] != _MAGIC or len(header) < _HEADER.size + _CRC.size:
            return WriterState.UNREADABLE, "not a telemetry file"
        _, version, layout, session, _, _, length = _HEADER.unpack_from(header)
        if (version, layout) != (_VERSION, _LAYOUT):
            return WriterState.OTHER_VERSION, "written by another version of this program"
        info = self._read(_INFO_AT, min(length, _JSON_BYTES))
        crc = _CRC.unpack_from(header, _HEADER.size)[0]
        if found.st_size != _FILE_BYTES or zlib.crc32(info, zlib.crc32(header[: _HEADER.size])) != crc:
            return WriterState.UNREADABLE, "damaged"
        try:
            self.info = msgspec.json.decode(info, type=SessionInfo)
        except _BAD_JSON:
            return WriterState.UNREADABLE, "damaged"
        if session != self.session:
            self.session, self.missed = session, 0
        return WriterState.LIVE, ""

    def _writer_link(self) -> tuple[WriterState, str]:
        if any(self._read(_ENDED_AT, 8)):
            return WriterState.ENDED, "the loop has ended"
        try:
            # A living writer holds the lock, so asking for a share of it cannot disturb one.
            fcntl.flock(self._file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return WriterState.LIVE, ""
        fcntl.flock(self._file, fcntl.LOCK_UN)
        return WriterState.DEAD, "the loop is gone without a goodbye"

    def _read(self, at: int, size: int) -> bytes:
        if self._file < 0:
            return b""
        try:
            return os.pread(self._file, size, at)
        except OSError:
            return b""

    def _head_sequence(self) -> int | None:
        head = self._read(_HEAD_AT, 8)
        return int.from_bytes(head, sys.byteorder) if len(head) == 8 else None

    def _slot(self, sequence: int) -> Snapshot | None:
        slot = self._read(_RING_AT + sequence % RING_LENGTH * _SLOT_BYTES, _SLOT_BYTES)
        return _unpacked(slot, sequence)

    def _all_slots(self) -> list[Snapshot]:
        ring = self._read(_RING_AT, RING_LENGTH * _SLOT_BYTES)
        found = (_unpacked(ring[at : at + _SLOT_BYTES]) for at in range(0, len(ring), _SLOT_BYTES))
        return [snapshot for snapshot in found if snapshot is not None]


def _created(paths: tuple[Path, ...], address: str, info: SessionInfo) -> tuple[Path, mmap.mmap, int]:
    """A new locked file in the first place with room for it, mapped; where it is, and no other writer anywhere."""
    for other in paths[1:]:
        with contextlib.suppress(OSError):
            if os.lstat(other).st_uid == os.getuid():  # a stranger's file is in nobody's way yet
                _remove_stale(other, address)
    for path in paths:
        try:
            return path, *_created_at(path, address, info)
        except OSError as error:
            if error.errno not in _FULL or path is paths[-1]:
                raise ConfigError(f"telemetry {address!r}: cannot make {path}: {error.strerror}") from None
    raise AssertionError("an address has a place")


def _created_at(path: Path, address: str, info: SessionInfo) -> tuple[mmap.mmap, int]:
    """A new locked file at `path`, mapped, in the place of one whose writer is gone."""
    for _ in range(_TAKEOVER_TRIES):
        _remove_stale(path, address)
        file = _new_file(path, info)
        if file is not None:
            flags = mmap.MAP_SHARED | getattr(mmap, "MAP_POPULATE", 0)
            return mmap.mmap(file, _FILE_BYTES, flags=flags), file
    raise _taken(path, address)


def _taken(path: Path, address: str) -> ConfigError:
    return ConfigError(
        f"telemetry {address!r}: another loop writes to {path}; end it, or choose another address with --telemetry"
    )


def _remove_stale(path: Path, address: str) -> None:
    """Remove what a dead writer left at `path`; refuse while a living one holds it."""
    try:
        file = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except FileNotFoundError:
        return
    try:
        found = os.fstat(file)
        if not stat.S_ISREG(found.st_mode) or (found.st_size and os.pread(file, 8, 0) != _MAGIC):
            raise ConfigError(f"telemetry {address!r}: {path} is something else; it is not overwritten")
        if not _locked(file):
            raise _taken(path, address)
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.stat(path), found):
                os.unlink(path)
    finally:
        os.close(file)


def _locked(file: int) -> bool:
    """Take the writer's lock; readers that ask who is alive hold it for microseconds, so try for a moment."""
    for _ in range(_TAKEOVER_TRIES):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            clock.sleep_until(clock.monotonic_ns() + _TAKEOVER_PAUSE_NS)
        else:
            return True
    return False


def _new_file(path: Path, info: SessionInfo) -> int | None:
    """A whole, locked file under its name at once; None when somebody else was faster."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    file = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Reserve it all now: a full tmpfs would otherwise kill the loop at its first touch of a missing page.
        os.posix_fallocate(file, 0, _FILE_BYTES)
        text = msgspec.json.encode(info)
        if len(text) > _JSON_BYTES:
            raise ConfigError(f"session info of {len(text)} bytes: at most {_JSON_BYTES}")
        session = int.from_bytes(os.urandom(8), sys.byteorder) | 1
        header = _HEADER.pack(_MAGIC, _VERSION, _LAYOUT, session, os.getpid(), clock.monotonic_ns(), len(text))
        os.pwrite(file, header + _CRC.pack(zlib.crc32(text, zlib.crc32(header))), 0)
        os.pwrite(file, text, _INFO_AT)
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


def _unpacked(slot: bytes, sequence: int | None = None) -> Snapshot | None:
    """The snapshot in a slot of the ring; None when it is empty, torn, or not the one asked for."""
    if len(slot) < _RECORD.size + _CRC.size:
        return None
    if zlib.crc32(slot[: _RECORD.size]) != _CRC.unpack_from(slot, _RECORD.size)[0]:
        return None
    values = _RECORD.unpack_from(slot)
    if values[-1] <= 0 or sequence not in (None, values[-1]):
        return None
    return Snapshot._make((*values[:-2], _text(values[-2]), values[-1]))


def _frame_bytes(frame_id: str) -> bytes:
    """A frame's name for its fixed place; one that would be cut there is refused."""
    encoded = frame_id.encode()
    if len(encoded) > _FRAME_BYTES:
        raise InvalidValueError(f"frame_id = {frame_id!r}: must be at most {_FRAME_BYTES} bytes in UTF-8")
    return encoded


def _text(padded: bytes) -> str:
    return padded.rstrip(b"\0").decode(errors="replace")


def _packed_trajectory(version: int, trajectory: Trajectory | None) -> bytes:
    if trajectory is None:
        trajectory = Trajectory.empty(stamp_ns=0)
    total = len(trajectory)
    count = min(total, MAX_POINTS)
    # Evenly by index, in whole numbers: 0 and total − 1 are hit exactly.
    chosen = np.arange(count) * (total - 1) // max(count - 1, 1)
    points = np.zeros((len(_COLUMNS), MAX_POINTS))  # (columns, points)
    for row, name in zip(points, _COLUMNS[:-1], strict=False):
        row[:count] = getattr(trajectory, name)[chosen]
    points[-1, :count] = trajectory.time_from_start_ns[chosen] * 1e-9
    frame = _frame_bytes(trajectory.frame_id)
    body = _TRAJECTORY.pack(version, trajectory.stamp_ns, count, total, frame) + points.tobytes()
    return body + _CRC.pack(zlib.crc32(body))


def _unpacked_trajectory(area: bytes, version: int) -> DrawnTrajectory | None:
    if len(area) < _TRAJECTORY_BYTES + _CRC.size:
        return None
    if zlib.crc32(area[:_TRAJECTORY_BYTES]) != _CRC.unpack_from(area, _TRAJECTORY_BYTES)[0]:
        return None
    found, stamp_ns, count, total, frame = _TRAJECTORY.unpack_from(area)
    if found != version or not 0 <= count <= MAX_POINTS:
        return None
    points = np.frombuffer(area, offset=_TRAJECTORY.size, count=MAX_POINTS * len(_COLUMNS))
    columns = dict(zip(_COLUMNS, points.reshape(len(_COLUMNS), MAX_POINTS)[:, :count], strict=True))
    return DrawnTrajectory(version=version, stamp_ns=stamp_ns, frame_id=_text(frame), original_count=total, **columns)


def _unpacked_details(area: bytes) -> tuple[int, dict[str, Any]]:
    if len(area) < _DETAILS.size:
        return 0, {}
    number, length = _DETAILS.unpack_from(area)
    end = _DETAILS.size + min(length, _JSON_BYTES)
    if len(area) < end + _CRC.size or zlib.crc32(area[:end]) != _CRC.unpack_from(area, end)[0]:
        return 0, {}
    try:
        found = msgspec.json.decode(area[_DETAILS.size : end])
    except _BAD_JSON:
        return 0, {}
    return (number, found) if isinstance(found, dict) else (0, {})
