"""The one-way door: whole or not at all, newest always, and nothing that a file can hold upsets a reader."""

import errno
import math
import os
import signal
import stat
import struct
import subprocess
import sys
import tracemalloc
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import Trajectory
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.telemetry import (
    MAX_POINTS,
    RING_LENGTH,
    DrivingLimits,
    SessionInfo,
    Snapshot,
    TelemetryReader,
    TelemetryWriter,
    VehicleShape,
    WriterState,
    layout,
    telemetry_path,
)
from vehicle_iface.telemetry import reader as reader_module
from vehicle_iface.telemetry import writer as writer_module
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails

INFO = SessionInfo(channel="vcan0", bus="SocketCAN vcan0", profile="reference", route="figure8")
# by the code of the field in the record
_STRATEGIES = {
    "q": st.integers(-(2**63), 2**63 - 1),
    "d": st.floats(),
    "?": st.booleans(),
    "s": st.text("abcdefghijk_ä", max_size=12),
}


def counted(drops: int) -> LiveDetails:
    return LiveDetails(link=LinkDetails(state="UP"), drops={"bad CRC POSE": drops})


@pytest.fixture
def address(tmp_path: Path) -> str:
    return str(tmp_path / "loop")


@pytest.fixture
def writer(address: str) -> Iterator[TelemetryWriter]:
    with TelemetryWriter(address, INFO) as opened:
        yield opened


@pytest.fixture
def reader(writer: TelemetryWriter) -> Iterator[TelemetryReader]:
    with TelemetryReader(writer.address) as opened:
        assert opened.poll() is WriterState.LIVE
        yield opened


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> bytearray:
    """The bytes of a session with everything in it."""
    address = str(tmp_path_factory.mktemp("image") / "loop")
    with TelemetryWriter(address, INFO) as writer:
        writer.publish_trajectory(straight(20))
        for number in range(1, 4):
            writer.publish(numbered(number))
        writer.publish_details(counted(3))
        return bytearray(writer.path.read_bytes())


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch") / "loop"


def numbered(number: int) -> Snapshot:
    """A snapshot all of whose parts say the same number."""
    return Snapshot(number, number, number, has_state=True, x_m=float(number), frame_id=str(number), samples=number)


def straight(points: int) -> Trajectory:
    x_m = np.arange(points, dtype=np.float64)
    zeros = np.zeros(points)
    return Trajectory(
        stamp_ns=7,
        frame_id="odom",
        time_from_start_ns=np.arange(points) * 1000,
        x_m=x_m,
        y_m=-x_m,
        heading_rad=zeros,
        speed_mps=zeros + 2.0,
    )


def look_at_everything(reader: TelemetryReader) -> WriterState:
    link = reader.poll()
    reader.newest()
    reader.since(0)
    reader.since(2**63)
    for version in (0, 1, 2):
        reader.trajectory(version)
    reader.details()
    return link


def same(a: Snapshot, b: Snapshot) -> bool:
    return all(x == y or (x != x and y != y) for x, y in zip(a, b, strict=True))


@given(st.tuples(*(_STRATEGIES[code[-1]] for code in layout.FIELDS)))
def test_every_field_comes_out_as_it_went_in(values: tuple[object, ...]) -> None:
    snapshot = Snapshot._make(values)
    record = bytearray(layout.RECORD.size)
    layout.RECORD.pack_into(record, 0, *snapshot[:-2], snapshot.frame_id.encode(), 9)
    found = reader_module.unpack_snapshot(bytes(record) + struct.pack("=I", zlib.crc32(record)))
    assert found is not None
    assert same(found, snapshot._replace(sequence=9))


def test_the_newest_snapshot_is_numbered_and_whole(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    assert reader.newest() is None
    for number in (1, 2, 3):
        writer.publish(numbered(number))
    assert reader.newest() == numbered(3)._replace(sequence=3)


def test_a_reader_that_looks_often_misses_nothing(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    seen: list[Snapshot] = []
    for number in range(1, 3 * RING_LENGTH):
        writer.publish(numbered(number))
        if number % 7 == 0:
            seen += reader.since(seen[-1].sequence if seen else 0)
    assert [s.sequence for s in seen] == list(range(1, len(seen) + 1))
    assert all(s.samples == s.sequence for s in seen)
    assert reader.dropped == 0


def test_a_late_reader_gets_the_ring_and_the_number_of_dropped_snapshots(
    writer: TelemetryWriter, reader: TelemetryReader
) -> None:
    for number in range(1, 2 * RING_LENGTH + 11):
        writer.publish(numbered(number))
    found = reader.since(5)
    assert [s.sequence for s in found] == list(range(RING_LENGTH + 11, 2 * RING_LENGTH + 11))
    assert reader.dropped == RING_LENGTH + 10 - 5
    assert reader.since(found[-1].sequence) == []


def test_the_session_describes_itself(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    assert reader.info == INFO
    assert reader.session != 0
    assert stat.S_IMODE(writer.path.stat().st_mode) == 0o600


@pytest.mark.parametrize("points", [0, 1, 2, MAX_POINTS, MAX_POINTS + 1, 1_000_000])
def test_a_drawn_trajectory_has_the_first_point_and_the_last(
    writer: TelemetryWriter, reader: TelemetryReader, points: int
) -> None:
    version = writer.publish_trajectory(straight(points))
    drawn = reader.trajectory(version)
    assert drawn is not None
    assert (drawn.version, drawn.stamp_ns, drawn.frame_id) == (version, 7, "odom")
    assert drawn.original_count == points
    assert len(drawn.x_m) == min(points, MAX_POINTS)
    if points:
        assert (drawn.x_m[0], drawn.x_m[-1]) == (0.0, points - 1.0)
        assert np.array_equal(drawn.y_m, -drawn.x_m)
        assert drawn.time_s[-1] == pytest.approx((points - 1) * 1e-6)
        assert (np.diff(drawn.x_m) >= 1.0).all()


def test_a_trajectory_is_found_by_its_version_alone(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    versions = [writer.publish_trajectory(t) for t in (straight(3), straight(4), None)]
    assert versions == [1, 2, 3]
    assert reader.trajectory(1) is None
    assert [len(t.x_m) for v in (2, 3) if (t := reader.trajectory(v)) is not None] == [4, 0]


def test_the_newest_details_are_shown(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    assert reader.details() is None
    for count in range(5):
        writer.publish_details(counted(count))
        assert reader.details() == counted(count)


def test_details_that_are_too_long_are_shortened_to_sums(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    rates = {f"0x{k:03X} unknown": 1.0 for k in range(2048)}
    link = LinkDetails(state="UP", load_percent=1.0, frames_per_s=2048.0, rates_hz=rates)
    writer.publish_details(LiveDetails(link=link, drops={"bad CRC POSE": 3, "bad CRC SPEED": 4}, loop={"samples": 7}))
    details = reader.details()
    assert details is not None
    assert details.link == LinkDetails(state="UP")
    assert (details.drops, details.loop, details.lost) == ({"all": 7}, {"all": 7}, {"all": 0})


def test_publishing_for_long_takes_no_more_memory(writer: TelemetryWriter) -> None:
    snapshot, trajectory = numbered(1), straight(5000)
    tracemalloc.start()
    try:
        sizes = []
        for _ in range(4):
            for _ in range(2000):
                writer.publish(snapshot)
            writer.publish_trajectory(trajectory)
            writer.publish_details(counted(1))
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert sizes[-1] - sizes[0] < 2000
    assert writer.path.stat().st_size == layout.FILE_BYTES


def test_a_torn_snapshot_is_not_there(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    writer.publish(numbered(1))
    writer.publish(numbered(2))
    at = layout.RING_AT + 2 * layout.SLOT_BYTES
    with writer.path.open("r+b", buffering=0) as file:
        for offset in range(0, layout.RECORD.size, 5):
            byte = os.pread(file.fileno(), 1, at + offset)
            os.pwrite(file.fileno(), bytes([byte[0] ^ 0x40]), at + offset)
            assert reader.newest() == numbered(1)._replace(sequence=1)
            os.pwrite(file.fileno(), byte, at + offset)
    assert reader.newest() == numbered(2)._replace(sequence=2)


@pytest.mark.parametrize("head", [0, 1, 3, 4, RING_LENGTH + 2, 2**63, 2**64 - 1])
def test_a_wrong_head_index_does_not_hide_the_newest_snapshot(
    writer: TelemetryWriter, reader: TelemetryReader, head: int
) -> None:
    for number in (1, 2, 3):
        writer.publish(numbered(number))
    writer._head[0] = head
    newest = reader.newest()
    assert newest is not None
    assert newest.sequence in ((1, 3) if head == 1 else (3,))


def test_a_torn_trajectory_leaves_the_one_before_it(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    writer.publish_trajectory(straight(3))
    writer.publish_trajectory(straight(4))
    at = layout.TRAJECTORY_AT + 100
    writer._view[at] ^= 1
    assert reader.trajectory(2) is None
    drawn = reader.trajectory(1)
    assert drawn is not None
    assert len(drawn.x_m) == 3


_HASTY_WRITER = """
import sys
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryWriter
with TelemetryWriter(sys.argv[1], SessionInfo(channel="a", bus="b")) as writer:
    for n in range(1, 10**9):
        writer.publish(Snapshot(n, n, n, has_state=True, x_m=float(n), frame_id=str(n), samples=n))
        if n == 1:
            print("ready", flush=True)
"""


@pytest.fixture
def hasty(address: str) -> Iterator[subprocess.Popen[str]]:
    """Another process that publishes as fast as it can."""
    with subprocess.Popen([sys.executable, "-c", _HASTY_WRITER, address], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        try:
            yield process
        finally:
            process.kill()


def test_a_reader_of_a_hasty_writer_sees_whole_snapshots_in_order(hasty: subprocess.Popen[str], address: str) -> None:
    assert hasty.poll() is None
    with TelemetryReader(address) as reader:
        assert reader.poll() is WriterState.LIVE
        last = 0
        for _ in range(3000):
            found = reader.since(last)
            for s in found:
                assert s.published_ns == s.reason == s.samples == s.sequence == int(s.frame_id) == s.x_m
            numbers = [s.sequence for s in found]
            assert numbers == sorted(set(numbers))
            assert not numbers or numbers[0] > last
            last = numbers[-1] if numbers else last
        assert last > 0


def test_a_second_writer_is_rejected_with_a_remedy(writer: TelemetryWriter) -> None:
    with pytest.raises(ConfigError, match=r"another loop writes to .*loop; end it, or choose another address"):
        TelemetryWriter(writer.address, INFO)
    writer.publish(numbered(1))
    with TelemetryReader(writer.address) as reader:
        assert reader.poll() is WriterState.LIVE
        assert reader.newest() is not None


def test_a_killed_writer_is_seen_and_its_address_taken_over(hasty: subprocess.Popen[str], address: str) -> None:
    with TelemetryReader(address) as reader:
        assert reader.poll() is WriterState.LIVE
        old_session = reader.session
        hasty.send_signal(signal.SIGKILL)
        hasty.wait()
        assert reader.poll() is WriterState.DEAD
        assert "terminated without closing its session" in reader.problem
        assert reader.newest() is not None
        with TelemetryWriter(address, INFO) as successor:
            assert reader.poll() is WriterState.LIVE
            assert reader.session not in (0, old_session)
            assert (reader.newest(), reader.dropped) == (None, 0)
            successor.publish(numbered(1))
            assert reader.newest() == numbered(1)._replace(sequence=1)


def test_a_closed_session_goes_on_being_readable(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    writer.publish(numbered(1))
    writer.close()
    writer.close()
    assert reader.poll() is WriterState.ENDED
    assert reader.newest() == numbered(1)._replace(sequence=1)
    with TelemetryWriter(writer.address, INFO):
        assert reader.poll() is WriterState.LIVE
        assert reader.newest() is None


def test_readers_that_check_for_a_writer_do_not_keep_one_out(address: str) -> None:
    TelemetryWriter(address, INFO).close()
    with TelemetryReader(address) as reader:
        for _ in range(20):
            reader.poll()
            TelemetryWriter(address, INFO).close()


def test_a_file_that_is_not_telemetry_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "letter"
    path.write_text("dear reader")
    with pytest.raises(ConfigError, match="is not a telemetry file; it is not overwritten"):
        TelemetryWriter(str(path), INFO)
    assert path.read_text() == "dear reader"


def test_a_file_that_cannot_be_made_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot create .*No such file"):
        TelemetryWriter(str(tmp_path / "nowhere" / "loop"), INFO)


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Two folders in the place of memory and the temporary folder; `room` is how many bytes fit into the first."""
    (tmp_path / "memory").mkdir()
    (tmp_path / "temporary").mkdir()
    places = tuple(tmp_path / folder / "loop" for folder in ("memory", "temporary"))
    for module in (reader_module, writer_module):
        monkeypatch.setattr(module, "paths_of", lambda _: places)
    limits = {"room": 0}
    reserve = os.posix_fallocate

    def reserve_in(file: int, offset: int, length: int) -> None:
        if length > limits["room"] and "/memory/" in os.readlink(f"/proc/self/fd/{file}"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        reserve(file, offset, length)

    monkeypatch.setattr(os, "posix_fallocate", reserve_in)
    return limits


def test_full_memory_is_passed_over_and_readers_find_the_file_all_the_same(
    tmp_path: Path, memory: dict[str, int]
) -> None:
    with TelemetryReader("loop") as reader:
        assert reader.poll() is WriterState.ABSENT
        with TelemetryWriter("loop", INFO) as writer:
            assert writer.path.parent.name == "temporary"
            writer.publish(numbered(1))
            assert reader.poll() is WriterState.LIVE
            assert (reader.newest() or numbered(0)).x_m == 1.0
            assert list((tmp_path / "memory").iterdir()) == []
            memory["room"] = 1 << 30
            with pytest.raises(ConfigError, match="another loop writes to"):
                TelemetryWriter("loop", INFO)
        assert reader.poll() is WriterState.ENDED
        with TelemetryWriter("loop", INFO) as writer:
            assert writer.path.parent.name == "memory"
            assert reader.poll() is WriterState.LIVE
            assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.usefixtures("memory")
def test_the_last_folder_is_named_when_all_are_full(monkeypatch: pytest.MonkeyPatch) -> None:
    def reserve_nothing(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", reserve_nothing)
    with pytest.raises(ConfigError, match=r"cannot create .*temporary/loop: No space left"):
        TelemetryWriter("loop", INFO)


def test_a_frame_name_that_would_be_cut_is_refused_with_the_limit(
    writer: TelemetryWriter, reader: TelemetryReader
) -> None:
    writer.publish(Snapshot(1, 2, 3, frame_id="ä" * 32))
    assert (reader.newest() or numbered(0)).frame_id == "ä" * 32
    with pytest.raises(InvalidValueError, match="must be at most 64 bytes"):
        writer.publish(Snapshot(2, 2, 3, frame_id="ä" * 32 + "b"))
    newest = reader.newest()
    assert newest is not None
    assert (newest.sequence, newest.published_ns) == (1, 1)


def test_no_drafts_are_left_behind(writer: TelemetryWriter) -> None:
    assert [p.name for p in writer.path.parent.iterdir()] == ["loop"]


def test_a_bare_name_is_a_file_of_this_user_in_memory() -> None:
    path = telemetry_path("default")
    assert path.name == f"vehicle-iface-{os.getuid()}-default"
    assert telemetry_path("./default") == Path("default")


@pytest.mark.parametrize("name", ["", "..", "-x", "a b", "a\nb", "x" * 65, "ä"])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="telemetry address"):
        telemetry_path(name)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_a_shape_has_positive_sizes(bad: float) -> None:
    with pytest.raises(InvalidValueError, match="length_m"):
        VehicleShape(length_m=bad)


@pytest.mark.parametrize(
    ("name", "bad"), [("speed_max_mps", 0.0), ("heading_stop_rad", math.inf), ("accel_min_mps2", 1.0)]
)
def test_limits_that_are_no_range_are_refused(name: str, bad: float) -> None:
    with pytest.raises(InvalidValueError, match=name):
        DrivingLimits(**{name: bad})


def test_nothing_there_is_absent(address: str) -> None:
    with TelemetryReader(address) as reader:
        assert look_at_everything(reader) is WriterState.ABSENT
        assert address in reader.problem


def test_a_removed_file_is_absent(writer: TelemetryWriter, reader: TelemetryReader) -> None:
    writer.path.unlink()
    assert look_at_everything(reader) is WriterState.ABSENT


def test_another_version_is_recognised(scratch: Path, image: bytearray) -> None:
    for at in (8, 16):  # the version, the layout
        other = bytearray(image)
        other[at] ^= 1
        assert _judged(scratch, bytes(other)) is WriterState.OTHER_VERSION


@pytest.mark.parametrize("kept", [0, 7, 8, 40, 4000, 50_000, -1])
def test_a_file_cut_short_is_unreadable(scratch: Path, image: bytearray, kept: int) -> None:
    assert _judged(scratch, bytes(image[:kept])) is WriterState.UNREADABLE


def test_a_file_truncated_while_it_is_read_does_not_kill_the_reader(
    writer: TelemetryWriter, reader: TelemetryReader
) -> None:
    writer.publish(numbered(1))
    os.truncate(writer.path, 100)
    assert (reader.newest(), reader.since(0), reader.trajectory(1), reader.details()) == (None, [], None, None)
    assert reader.poll() is WriterState.UNREADABLE
    os.truncate(writer.path, layout.FILE_BYTES)  # or closing the writer would touch what is gone


@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo, lambda path: os.symlink("/dev/zero", path)])
def test_a_path_without_a_regular_file_is_unreadable(tmp_path: Path, make: Callable[[Path], None]) -> None:
    path = tmp_path / "odd"
    make(path)
    with TelemetryReader(str(path)) as reader:
        assert look_at_everything(reader) is WriterState.UNREADABLE


@given(
    changes=st.lists(st.tuples(st.integers(0, layout.FILE_BYTES - 1), st.integers(0, 255)), max_size=40),
    early=st.lists(st.tuples(st.integers(0, 6000), st.integers(0, 255)), max_size=20),
)
def test_no_bytes_upset_a_reader(
    scratch: Path, image: bytearray, changes: list[tuple[int, int]], early: list[tuple[int, int]]
) -> None:
    hostile = bytearray(image)
    for at, byte in changes + early:
        hostile[at] = byte
    assert _judged(scratch, bytes(hostile)) in set(WriterState)


@given(garbage=st.binary(max_size=3000))
def test_no_garbage_upsets_a_reader(scratch: Path, garbage: bytes) -> None:
    assert _judged(scratch, garbage) is WriterState.UNREADABLE


@given(values=st.binary(min_size=layout.RECORD.size, max_size=layout.RECORD.size))
def test_a_forged_snapshot_with_a_good_sum_is_only_numbers(values: bytes) -> None:
    found = reader_module.unpack_snapshot(values + struct.pack("=I", zlib.crc32(values)))
    assert found is None or isinstance(found, Snapshot)


@pytest.mark.parametrize(
    "text",
    [
        b"[]",
        b"{}",
        b'{"channel": 1, "bus": ""}',
        b"\xff",
        b"[" * 20_000,
        b'{"channel":"","bus":"","shape":{"width_m":-1}}',
    ],
)
def test_forged_texts_with_a_good_sum_are_unreadable(scratch: Path, image: bytearray, text: bytes) -> None:
    forged = bytearray(image)
    header = bytearray(forged[: layout.HEADER.size])
    header[-8:] = struct.pack("=Q", len(text))
    forged[: len(header)] = header
    forged[len(header) : len(header) + 4] = struct.pack("=I", zlib.crc32(text, zlib.crc32(header)))
    forged[layout.INFO_AT : layout.INFO_AT + len(text)] = text
    assert _judged(scratch, bytes(forged)) is WriterState.UNREADABLE


@pytest.mark.parametrize(
    "text", [b"[1]", b"{", b"\xff", b"[" * 20_000, b"null", b'{"link": {"state": 3}}', b'{"drops": {}}']
)
def test_forged_details_with_a_good_sum_are_nothing(text: bytes) -> None:
    body = layout.DETAILS.pack(1, len(text)) + text
    assert reader_module.unpack_details(body + struct.pack("=I", zlib.crc32(body))) == (0, None)


def _judged(path: Path, content: bytes) -> WriterState:
    path.write_bytes(content)
    with TelemetryReader(str(path)) as reader:
        return look_at_everything(reader)
