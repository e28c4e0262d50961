"""What is written down is what was, and other programs can read it."""

import csv
import string
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.bus.raw_socket import EFF_FLAG, ERR_FLAG, RTR_FLAG
from vehicle_iface.codec.candump import EXTENDED, read_candump
from vehicle_iface.recorder.files import SNAPSHOT_HEADER, snapshot_line, snapshot_of
from vehicle_iface.recorder.frames import line
from vehicle_iface.runtime.telemetry import Snapshot

COLUMNS = SNAPSHOT_HEADER.decode().strip().split(",")
KINDS = {"int": st.integers(-(2**63), 2**63 - 1), "float": st.floats(allow_nan=False), "bool": st.booleans()}
FRAMES = st.sampled_from(("map", "odom", 'a,"b"', "Straße", "a b", "'"))
snapshots = st.tuples(
    *(
        FRAMES if name == "frame_id" else KINDS[str(kind.__forward_arg__)]
        for name, kind in Snapshot.__annotations__.items()
    )
).map(Snapshot._make)


@given(snapshots)
def test_a_snapshot_comes_back_as_it_went(snapshot: Snapshot) -> None:
    text = snapshot_line(snapshot)
    assert text.count(b"\n") == 1
    assert text.endswith(b"\n")
    assert snapshot_of(COLUMNS, text.decode().removesuffix("\n")) == snapshot


@given(snapshots)
def test_any_reader_of_csv_finds_each_value_in_its_column(snapshot: Snapshot) -> None:
    header, row = csv.reader([SNAPSHOT_HEADER.decode(), snapshot_line(snapshot).decode()])
    found = dict(zip(header, row, strict=True))
    assert float(found["x_m"]) == snapshot.x_m
    assert int(found["stamp_ns"]) == snapshot.stamp_ns
    assert found["sent"] == ("1" if snapshot.sent else "0")
    assert found["frame_id"] == snapshot.frame_id


def test_columns_of_another_version_are_passed_over_and_missing_ones_are_as_if_never_told() -> None:
    found = snapshot_of(["published_ns", "novelty", "reason", "controller_state"], "7,x,2,3")
    assert found == Snapshot(7, 3, 2)


@given(st.text(string.printable), st.lists(st.sampled_from([*COLUMNS, "x"]), max_size=5))
def test_a_damaged_row_is_no_snapshot(text: str, columns: list[str]) -> None:
    found = snapshot_of(columns, text)
    assert found is None or isinstance(found, Snapshot)
    assert snapshot_of(COLUMNS, text) is None


def read(tmp_path: Path, *lines: bytes) -> list[tuple[int, int, bytes]]:
    """Stamp, key and payload of each frame, by this project's own reader of candump's logs."""
    file = tmp_path / "frames.log"
    file.write_bytes(b"".join(lines))
    (chunk,) = read_candump(file)
    assert not chunk.refused
    return [
        (int(stamp_ns), int(key), bytes(data))
        for frames in chunk.frames
        for stamp_ns, key, data in zip(frames.stamps_ns, frames.keys, frames.data, strict=True)
    ]


def test_frames_are_lines_of_a_candump_log(tmp_path: Path) -> None:
    at_ns = 1_436_509_052_249_713_999
    classical = line("vcan0", (0x123, bytes(range(8)), False, at_ns, 0, True), 0)
    extended = line("vcan0", (0x123 | EFF_FLAG, b"\xff", False, at_ns, 0, False), 0)
    fd = line("vcan0", (0x110, bytes(12), True, at_ns, 0, False), 0x05)
    assert classical == b"(1436509052.249713) vcan0 123#0001020304050607\n"
    assert extended == b"(1436509052.249713) vcan0 00000123#FF\n"
    assert fd == b"(1436509052.249713) vcan0 110##5" + b"00" * 12 + b"\n"
    stamp_ns = at_ns // 1000 * 1000
    assert sorted(read(tmp_path, classical, extended, fd)) == sorted(
        [(stamp_ns, 0x123, bytes(range(8))), (stamp_ns, 0x123 | EXTENDED, b"\xff"), (stamp_ns, 0x110, bytes(12))]
    )


def test_remote_and_error_frames_are_told_from_data(tmp_path: Path) -> None:
    remote = line("vcan0", (0x112 | RTR_FLAG, bytes(4), False, 1, 0, False), 0)
    error = line("vcan0", (0x040 | ERR_FLAG, bytes(8), False, 1, 0, False), 0)
    assert remote == b"(0000000000.000000) vcan0 112#R4\n"
    assert error == b"(0000000000.000000) vcan0 20000040#0000000000000000\n"
    file = tmp_path / "frames.log"
    file.write_bytes(remote + error)
    (chunk,) = read_candump(file)
    assert (chunk.remote, chunk.errors, chunk.refused) == (1, 1, [])
