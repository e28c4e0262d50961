"""Trajectory files: what is refused, where, and that everything else comes back as it was."""

import tempfile
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.errors import TrajectoryFileError
from vehicle_iface.trajectories import load_csv, save_csv
from vehicle_iface.trajectory import Trajectory

HEADER = "time_s,x_m,y_m,heading_rad,speed_mps\n"
ROW = "0.0,1.0,2.0,0.5,3.0\n"
FLOAT_FIELDS = ("x_m", "y_m", "heading_rad", "speed_mps", "accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "drive.csv"


def written(file: Path, text: str) -> Path:
    file.write_text(text, encoding="utf-8", newline="")
    return file


def test_a_plain_file_is_read_into_its_columns(file: Path) -> None:
    trajectory = load_csv(written(file, HEADER + ROW + "0.25,1.5,2.5,0.6,3.5\n"), stamp_ns=7)
    assert trajectory.stamp_ns == 7
    assert trajectory.frame_id == "map"
    assert trajectory.time_from_start_ns.tolist() == [0, 250_000_000]
    assert trajectory.x_m.tolist() == [1.0, 1.5]
    assert trajectory.speed_mps.tolist() == [3.0, 3.5]
    assert trajectory.accel_mps2.tolist() == [0.0, 0.0]


def test_columns_may_stand_in_any_order_and_the_optional_ones_follow(file: Path) -> None:
    text = "speed_mps, yaw_rate_radps, y_m, x_m, front_wheel_angle_rad, heading_rad, accel_mps2, time_s\n"
    trajectory = load_csv(written(file, text + "1, 2, 3, 4, 5, 6, 7, 8\n"))
    assert trajectory.time_from_start_ns.tolist() == [8_000_000_000]
    assert [float(getattr(trajectory, name)[0]) for name in FLOAT_FIELDS] == [4, 3, 6, 1, 7, 2, 5]


def test_comments_blank_lines_byte_order_mark_and_windows_line_ends_are_tolerated(file: Path) -> None:
    text = "\ufeff# a drive\r\n\r\n" + HEADER.strip() + "\r\n# in between\r\n" + ROW.strip() + "\r\n   \r\n"
    assert len(load_csv(written(file, text))) == 1


@pytest.mark.parametrize("comment", ["# frame_id: odom", "#frame_id:odom", "#  frame_id :  odom  "])
@pytest.mark.parametrize("place", ["before the header", "at the end"])
def test_a_comment_names_the_frame(file: Path, comment: str, place: str) -> None:
    lines = [comment + "\n", HEADER + ROW]
    text = "".join(lines if place == "before the header" else reversed(lines))
    assert load_csv(written(file, text)).frame_id == "odom"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", ["line 1", "empty"]),
        ("# only a comment\n\n", ["line 1", "empty"]),
        (HEADER, ["line 1", "no rows"]),
        ("# x\n" + HEADER + "\n# y\n", ["line 2", "no rows"]),
        (ROW, ["line 1", "header", "time_s,x_m"]),
        (HEADER + "0,abc,2,3,4\n", ["line 2", "column 2 (x_m)", "'abc'", "not a number"]),
        (HEADER + ROW + "# c\n\n1,1,2,,4\n", ["line 5", "column 4 (heading_rad)", "''", "not a number"]),
        (HEADER + "0,1,2,3,nan\n", ["line 2", "column 5 (speed_mps)", "'nan'", "not finite"]),
        (HEADER + "0,1,-Infinity,3,1\n", ["line 2", "column 3 (y_m)", "'-Infinity'", "not finite"]),
        (HEADER + "0,1e999,0,3,1\n", ["line 2", "column 2 (x_m)", "'1e999'", "too large"]),
        (HEADER + "0,0x10,0,3,1\n", ["line 2", "column 2 (x_m)", "'0x10'", "not a number"]),
        (HEADER + "0,1_0,0,3,1\n", ["line 2", "column 2 (x_m)", "'1_0'", "not a number"]),
        (HEADER + '0,"1",0,3,1\n', ["line 2", "column 2 (x_m)", "not a number"]),
        (HEADER + "0,1,2,3,4 # fast\n", ["line 2", "column 5 (speed_mps)", "'4 # fast'"]),
        (HEADER + "0,0,1,5,2,5,0,1,3,0\n", ["line 2", "10 cells", "decimal commas", "0.5, not 0,5"]),
        (HEADER + '0,"1,5",2,3,4\n', ["line 2", "decimal commas"]),
        (HEADER + "0;1,5;2,5;0,1;3\n", ["line 2", "separated by ';'"]),
        (HEADER.replace(",", ";") + ROW.replace(",", ";"), ["line 1", "separated by ';'", "','"]),
        (HEADER.replace(",", "\t") + ROW.replace(",", "\t"), ["line 1", "separated by a tab"]),
        (HEADER + "0,1,2,3\n", ["line 2", "column 5 (speed_mps)", "4 cells", "has 5"]),
        (HEADER + "0,1,2,3,4,\n", ["line 2", "column 6", "6 cells", "has 5"]),
        ("time_s,x_m,y_m,speed_mps\n0,1,2,3\n", ["line 1", "missing column heading_rad"]),
        (HEADER.strip() + ",jerk\n", ["line 1", "column 6", "unknown column 'jerk'", "accel_mps2"]),
        (HEADER.strip() + ",x_m\n", ["line 1", "column 6", "duplicate column 'x_m'"]),
        (HEADER + "1.5,1,2,3,4\n1.4,1,2,3,4\n", ["line 3", "column 1 (time_s)", "'1.4'", "'1.5'", "decrease"]),
        (HEADER + "-0.1,1,2,3,4\n", ["line 2", "column 1 (time_s)", "'-0.1'", "out of range"]),
        (HEADER + "1e10,1,2,3,4\n", ["line 2", "column 1 (time_s)", "'1e10'", "out of range"]),
        ("# frame_id:\n" + HEADER + ROW, ["line 1", "frame_id is empty"]),
        ("# frame_id: a\tb\n" + HEADER + ROW, ["line 1", "frame_id = 'a\\tb'"]),
        (f"# frame_id: {'a' * 65}\n" + HEADER + ROW, ["line 1", "at most 64 bytes"]),
        ("# frame_id: a\n# frame_id: b\n" + HEADER + ROW, ["line 2", "'b'", "'a'"]),
    ],
)
def test_a_bad_file_is_refused_with_file_line_and_column(file: Path, text: str, said: list[str]) -> None:
    with pytest.raises(TrajectoryFileError) as refusal:
        load_csv(written(file, text))
    message = str(refusal.value)
    assert message.startswith(str(file))
    for part in said:
        assert part in message, message


def test_bytes_that_are_not_utf_8_are_refused_with_line_and_place(file: Path) -> None:
    file.write_bytes(HEADER.encode() + b"0,1,\xff,3,4\n")
    with pytest.raises(TrajectoryFileError, match=r"line 2: byte 0xff at character 5: .*UTF-8"):
        load_csv(file)


@pytest.mark.parametrize("name", ["nowhere.csv", ".", "nul\0byte"])
def test_a_file_that_cannot_be_read_is_refused_by_name(tmp_path: Path, name: str) -> None:
    with pytest.raises(TrajectoryFileError, match="cannot be read"):
        load_csv(tmp_path / name)


@pytest.mark.parametrize("name", ["no/such/folder.csv", "."])
def test_a_file_that_cannot_be_written_is_refused_by_name(tmp_path: Path, name: str) -> None:
    with pytest.raises(TrajectoryFileError, match="cannot be written"):
        save_csv(tmp_path / name, one_point())


def test_an_empty_trajectory_is_not_saved(file: Path) -> None:
    with pytest.raises(TrajectoryFileError, match="without points"):
        save_csv(file, Trajectory.empty(stamp_ns=0))
    assert not file.exists()


@pytest.mark.parametrize("frame", [" map", "map "])
def test_a_frame_that_a_comment_cannot_carry_is_not_saved(file: Path, frame: str) -> None:
    with pytest.raises(TrajectoryFileError, match="frame_id"):
        save_csv(file, one_point(frame))
    assert not file.exists()


def one_point(frame_id: str = "map") -> Trajectory:
    zero = np.zeros(1)
    times_ns = np.zeros(1, dtype=np.int64)
    return Trajectory(
        stamp_ns=0, frame_id=frame_id, time_from_start_ns=times_ns, x_m=zero, y_m=zero, heading_rad=zero, speed_mps=zero
    )


FINITE = st.floats(allow_nan=False, allow_infinity=False)
POINTS = st.lists(st.tuples(st.integers(0, 8 * 10**18), *[FINITE] * len(FLOAT_FIELDS)), min_size=1, max_size=8)
FRAMES = st.text(  # at most 64 bytes, two for each
    st.characters(min_codepoint=33, max_codepoint=0x2FF).filter(str.isprintable), min_size=1, max_size=32
)


@given(points=POINTS, frame_id=FRAMES.filter(lambda text: text == text.strip()))
def test_a_saved_trajectory_is_loaded_bit_for_bit(points: list[tuple[float, ...]], frame_id: str) -> None:
    times, *columns = zip(*sorted(points, key=lambda point: point[0]), strict=True)
    fields = {name: np.array(values) for name, values in zip(FLOAT_FIELDS, columns, strict=True)}
    saved = Trajectory(stamp_ns=1, frame_id=frame_id, time_from_start_ns=np.array(times, dtype=np.int64), **fields)
    with tempfile.TemporaryDirectory() as folder:
        save_csv(Path(folder) / "drive.csv", saved)
        loaded = load_csv(Path(folder) / "drive.csv", stamp_ns=1)
    assert loaded.frame_id == frame_id
    assert loaded.time_from_start_ns.tolist() == list(times)
    for name in FLOAT_FIELDS:
        assert getattr(loaded, name).tobytes() == getattr(saved, name).tobytes(), name


@given(time=st.decimals(0, 9 * 10**9, allow_nan=False, allow_infinity=False, places=11))
def test_decimal_seconds_become_the_nearest_nanosecond(time: Decimal) -> None:
    with tempfile.TemporaryDirectory() as folder:
        loaded = load_csv(written(Path(folder) / "drive.csv", HEADER + f"{time},0,0,0,0\n"))
    assert abs(Decimal(int(loaded.time_from_start_ns[0])) - time * 10**9) <= Decimal("0.5")


def test_a_million_rows_are_loaded(file: Path) -> None:
    count = 1_000_000
    written(file, HEADER + "".join(f"{i / 100:.2f},{i / 16},-1.5,0.1,5\n" for i in range(count)))
    trajectory = load_csv(file)
    assert len(trajectory) == count
    assert np.array_equal(trajectory.time_from_start_ns, np.arange(count) * 10_000_000)
    assert float(trajectory.x_m[-1]) == (count - 1) / 16
