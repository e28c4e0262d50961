"""What is written down is what was, and other programs can read it."""

import csv
import string
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.bus.raw_socket import EFF_FLAG, ERR_FLAG, RTR_FLAG
from vehicle_iface.logs.candump import read_candump
from vehicle_iface.logs.frames import EXTENDED
from vehicle_iface.recorder.files import (
    SNAPSHOT_HEADER,
    format_counters,
    format_snapshot,
    parse_counters,
    parse_snapshot,
)
from vehicle_iface.recorder.frame_tap import format_frame
from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails, ShadowSummary, Spread

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
    text = format_snapshot(snapshot)
    assert text.count(b"\n") == 1
    assert text.endswith(b"\n")
    assert parse_snapshot(COLUMNS, text.decode().removesuffix("\n")) == snapshot


@given(snapshots)
def test_any_reader_of_csv_finds_each_value_in_its_column(snapshot: Snapshot) -> None:
    header, row = csv.reader([SNAPSHOT_HEADER.decode(), format_snapshot(snapshot).decode()])
    found = dict(zip(header, row, strict=True))
    assert float(found["x_m"]) == snapshot.x_m
    assert int(found["stamp_ns"]) == snapshot.stamp_ns
    assert found["sent"] == ("1" if snapshot.sent else "0")
    assert found["frame_id"] == snapshot.frame_id


def test_unknown_columns_are_ignored_and_missing_ones_have_defaults() -> None:
    found = parse_snapshot(["published_ns", "novelty", "reason", "controller_state"], "7,x,2,3")
    assert found == Snapshot(7, 3, 2)


def test_columns_that_were_renamed_are_read_from_older_recordings() -> None:
    old = ["published_ns", "controller_state", "reason", "has_wanted", "wanted_accel_mps2", "hands_over", "handover_ns"]
    found = parse_snapshot(old, "7,3,2,1,0.5,1,42")
    assert found == Snapshot(
        7, 3, 2, has_requested=True, requested_accel_mps2=0.5, handover_pending=True, handover_in_ns=42
    )


def test_counters_that_were_renamed_are_read_from_older_recordings() -> None:
    spread = Spread(mean=0.0, p50=0.0, p95=0.0, max=0.0)
    found = ShadowSummary(
        compared=7,
        takeovers=1,
        unmatched_commands=2,
        drops={},
        mismatches={"ACCEL_REQUEST": 3},
        accel_mps2=spread,
        front_wheel_angle_rad=spread,
    )
    details = LiveDetails(link=LinkDetails(state="UP"), shadow=found, tx_blocked={"0x123": 4})
    line = format_counters(5, details).decode()
    old = line.replace("unmatched_commands", "without_a_sample").replace("mismatches", "apart")
    old = old.replace("tx_blocked", "not_let_out")
    assert parse_counters(old) == parse_counters(line) == details
    assert parse_counters(line[:-9]) is None


@given(st.text(string.printable), st.lists(st.sampled_from([*COLUMNS, "x"]), max_size=5))
def test_a_damaged_row_is_no_snapshot(text: str, columns: list[str]) -> None:
    found = parse_snapshot(columns, text)
    assert found is None or isinstance(found, Snapshot)
    assert parse_snapshot(COLUMNS, text) is None


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
    classical = format_frame("vcan0", (0x123, bytes(range(8)), False, at_ns, 0, True), 0)
    extended = format_frame("vcan0", (0x123 | EFF_FLAG, b"\xff", False, at_ns, 0, False), 0)
    fd = format_frame("vcan0", (0x110, bytes(12), True, at_ns, 0, False), 0x05)
    assert classical == b"(1436509052.249713) vcan0 123#0001020304050607\n"
    assert extended == b"(1436509052.249713) vcan0 00000123#FF\n"
    assert fd == b"(1436509052.249713) vcan0 110##5" + b"00" * 12 + b"\n"
    stamp_ns = at_ns // 1000 * 1000
    assert sorted(read(tmp_path, classical, extended, fd)) == sorted(
        [(stamp_ns, 0x123, bytes(range(8))), (stamp_ns, 0x123 | EXTENDED, b"\xff"), (stamp_ns, 0x110, bytes(12))]
    )


def test_remote_and_error_frames_are_distinguished_from_data(tmp_path: Path) -> None:
    remote = format_frame("vcan0", (0x112 | RTR_FLAG, bytes(4), False, 1, 0, False), 0)
    error = format_frame("vcan0", (0x040 | ERR_FLAG, bytes(8), False, 1, 0, False), 0)
    assert remote == b"(0000000000.000000) vcan0 112#R4\n"
    assert error == b"(0000000000.000000) vcan0 20000040#0000000000000000\n"
    file = tmp_path / "frames.log"
    file.write_bytes(remote + error)
    (chunk,) = read_candump(file)
    assert (chunk.remote, chunk.errors, chunk.refused) == (1, 1, [])
